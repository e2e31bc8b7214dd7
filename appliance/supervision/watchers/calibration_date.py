"""Whether a date of the calibration in force has passed. It is watched all the same, and shown to everybody; with
`[calibration] overdue = "expires"` it cannot be verified any more, so that the contact opens.
"""

from probewatch.appliance.supervision.watchers.device_health import DeviceHealth
from probewatch.appliance.types import Check, Fault, VerdictKind

REPORTS_FAULTS = (Fault.CALIBRATION_DUE,)


def calibration_date(health: DeviceHealth) -> Check:
    """calibration-due while the reference in force is overdue or has expired."""
    passed = health.calibration_overdue
    verdict = VerdictKind.FAULT if passed else VerdictKind.OK
    return Check("calibration date", Fault.CALIBRATION_DUE, float(passed), 0.0, "", 1.0, verdict)
