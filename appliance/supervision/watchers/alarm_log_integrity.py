"""What was written down must be what is read back: damage to the alarm's memory or log stands until acknowledged."""

from appliance.supervision.watchers.facts import Facts
from appliance.types import Check, Fault, VerdictKind


def alarm_log_integrity(facts: Facts) -> Check:
    """memory-damaged or log-damaged while some damage has not been acknowledged; the value counts its kinds."""
    fault = facts.damage[0] if facts.damage else Fault.LOG_DAMAGED
    verdict = VerdictKind.FAULT if facts.damage else VerdictKind.OK
    return Check("alarm log integrity", fault, float(len(facts.damage)), 0.0, "", 1.0, verdict)
