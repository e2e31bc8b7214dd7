"""A configured calibration file that was changed takes no effect by itself, and no person should believe that it
did."""

from probewatch.appliance.supervision.watchers.device_health import DeviceHealth
from probewatch.appliance.types import Check, Fault, VerdictKind

REPORTS_FAULTS = (Fault.CALIBRATION_FILE,)


def calibration_file(health: DeviceHealth) -> Check:
    """calibration-file while the configured file is neither in force nor the one a person last decided about."""
    changed = health.calibration_file_changed
    verdict = VerdictKind.FAULT if changed else VerdictKind.OK
    return Check("calibration file", Fault.CALIBRATION_FILE, float(changed), 0.0, "", 1.0, verdict)
