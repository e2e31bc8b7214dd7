"""A full or stalled disk takes no alarm away, but what happens now may be lost with the power."""

from appliance.supervision.watchers.facts import Facts, Patience, silence
from appliance.types import Check, Fault


def alarm_log_written(facts: Facts, patience: Patience) -> Check:
    """log-not-written when an entry has waited for the disk longer than patience.log_ns."""
    return silence("alarm log written", Fault.LOG_NOT_WRITTEN, facts.log_waits_ns, patience.log_ns)
