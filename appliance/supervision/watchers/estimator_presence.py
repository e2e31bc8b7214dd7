"""The estimator speaks at least ten times a second, even when it has nothing to conclude."""

from appliance.supervision.watchers.facts import Facts, Patience, presence
from appliance.types import Check, Fault


def estimator_presence(now_ns: int, facts: Facts, patience: Patience) -> Check:
    """estimator-silent when no heartbeat has arrived for patience.estimator_ns, or its process has died."""
    last_ns = facts.heartbeat_ns
    return presence(
        "estimator presence", Fault.ESTIMATOR_SILENT, now_ns, facts.started_ns, last_ns, patience.estimator_ns
    )
