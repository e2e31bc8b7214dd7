"""Every alarm output must have taken a state lately; one that cannot be driven cannot alarm."""

from appliance.supervision.watchers.facts import Facts, Patience, presence
from appliance.types import Check, Fault


def output_presence(now_ns: int, facts: Facts, patience: Patience) -> Check:
    """output-failed when some output has completed no write for patience.output_ns."""
    return presence(
        "output presence", Fault.OUTPUT_FAILED, now_ns, facts.started_ns, facts.output_ns, patience.output_ns
    )
