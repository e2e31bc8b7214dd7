"""The device watchers, in the order in which a technician would look."""

from appliance.limits import Limits
from appliance.supervision.watchers.alarm_log_integrity import alarm_log_integrity
from appliance.supervision.watchers.alarm_log_written import alarm_log_written
from appliance.supervision.watchers.calibration_file import calibration_file
from appliance.supervision.watchers.estimator_presence import estimator_presence
from appliance.supervision.watchers.facts import Facts, Patience
from appliance.supervision.watchers.field_indicator import field_indicator
from appliance.supervision.watchers.line_of_sight import line_of_sight
from appliance.supervision.watchers.marker_fit import marker_fit
from appliance.supervision.watchers.marker_geometry import marker_geometry
from appliance.supervision.watchers.output_presence import output_presence
from appliance.supervision.watchers.tracker_alert import tracker_alert
from appliance.supervision.watchers.tracker_freshness import tracker_freshness
from appliance.supervision.watchers.tracker_presence import tracker_presence
from appliance.supervision.watchers.video_presence import video_presence
from appliance.types import Check

_WATCHERS = (
    output_presence,
    video_presence,
    tracker_alert,
    tracker_presence,
    tracker_freshness,
    estimator_presence,
    line_of_sight,
)
_QUALITY_WATCHERS = (marker_fit, marker_geometry, field_indicator)


def watch_devices(now_ns: int, facts: Facts, patience: Patience, limits: Limits | None = None) -> tuple[Check, ...]:
    """One Check per watcher, failing or not. limits: None for the default ones."""
    bounds = limits or Limits()
    checks = tuple(watcher(now_ns, facts, patience) for watcher in _WATCHERS)
    quality = tuple(watcher(facts, bounds) for watcher in _QUALITY_WATCHERS)
    return (
        *checks,
        *quality,
        alarm_log_integrity(facts),
        alarm_log_written(facts, patience),
        calibration_file(facts),
    )
