"""What was written down must be what is read back, and what happens now must be written down."""

from appliance.supervision.watchers.facts import Facts, Timeouts, silence
from appliance.types import Check, Fault, VerdictKind

FINDS = (Fault.LOG_DAMAGED, Fault.MEMORY_DAMAGED, Fault.LOG_NOT_WRITTEN)


def alarm_log_integrity(facts: Facts) -> Check:
    """memory-damaged or log-damaged until all damage is acknowledged; the value counts its kinds."""
    fault = facts.damage[0] if facts.damage else Fault.LOG_DAMAGED
    verdict = VerdictKind.FAULT if facts.damage else VerdictKind.OK
    return Check("alarm log integrity", fault, float(len(facts.damage)), 0.0, "", 1.0, verdict)


def alarm_log_written(facts: Facts, timeouts: Timeouts) -> Check:
    """log-not-written when an entry has waited for the disk longer than timeouts.log_ns.

    A full or stalled disk takes no alarm away, but what happens now may be lost with the power.
    """
    return silence("alarm log written", Fault.LOG_NOT_WRITTEN, facts.log_waits_ns, timeouts.log_ns)
