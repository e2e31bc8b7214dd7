"""Watches the alarm log: what is read back must be what was written, and what happens now must be written."""

from probewatch.appliance.supervision.watchers.device_health import DeviceHealth, Timeouts, silence
from probewatch.appliance.types import Check, Fault, VerdictKind

REPORTS_FAULTS = (Fault.LOG_DAMAGED, Fault.MEMORY_DAMAGED, Fault.LOG_NOT_WRITTEN)


def alarm_log_integrity(health: DeviceHealth) -> Check:
    """memory-damaged or log-damaged until all damage is acknowledged; the value counts its kinds."""
    fault = health.damage[0] if health.damage else Fault.LOG_DAMAGED
    verdict = VerdictKind.FAULT if health.damage else VerdictKind.OK
    return Check("alarm log integrity", fault, float(len(health.damage)), 0.0, "", 1.0, verdict)


def alarm_log_written(health: DeviceHealth, timeouts: Timeouts) -> Check:
    """log-not-written when an entry has waited for the disk longer than timeouts.log_ns.

    A full or stalled disk takes no alarm away, but what happens now may be lost with the power.
    """
    return silence("alarm log written", Fault.LOG_NOT_WRITTEN, health.log_waits_ns, timeouts.log_ns)
