"""The device watchers, in the order in which a technician would look."""

from probewatch.appliance.limits import Limits
from probewatch.appliance.supervision.watchers.alarm_log import alarm_log_integrity, alarm_log_written
from probewatch.appliance.supervision.watchers.calibration_date import calibration_date
from probewatch.appliance.supervision.watchers.calibration_file import calibration_file
from probewatch.appliance.supervision.watchers.device_health import DeviceHealth, Timeouts
from probewatch.appliance.supervision.watchers.measurement_quality import field_indicator, marker_fit, marker_geometry
from probewatch.appliance.supervision.watchers.presence import (
    estimator_presence,
    output_presence,
    tracker_presence,
    video_presence,
)
from probewatch.appliance.supervision.watchers.tracker_status import (
    line_of_sight,
    pose_usable,
    tracker_alert,
    tracker_freshness,
)
from probewatch.appliance.types import Check

_WATCHERS = (
    output_presence,
    video_presence,
    tracker_alert,
    tracker_presence,
    tracker_freshness,
    estimator_presence,
    line_of_sight,
    pose_usable,
)
_QUALITY_WATCHERS = (marker_fit, marker_geometry, field_indicator)


def watch_devices(
    now_ns: int, health: DeviceHealth, timeouts: Timeouts, limits: Limits | None = None
) -> tuple[Check, ...]:
    """One Check per watcher, failing or not. limits: None for the default ones."""
    bounds = limits or Limits()
    checks = tuple(watcher(now_ns, health, timeouts) for watcher in _WATCHERS)
    quality = tuple(watcher(health, bounds) for watcher in _QUALITY_WATCHERS)
    return (
        *checks,
        *quality,
        alarm_log_integrity(health),
        alarm_log_written(health, timeouts),
        calibration_file(health),
        calibration_date(health),
    )
