"""Checks whether every device and every process is still there and does its work. `watch_devices` checks in the order
in which a technician would look.
"""

from math import nan

from probewatch.appliance.limits import Limits
from probewatch.appliance.supervision.device_health import DeviceHealth, Timeouts, silence
from probewatch.appliance.types import Check, Fault, VerdictKind
from probewatch.drivers.samples import PoseStatus

REPORTS_FAULTS = (
    *(Fault.OUTPUT_FAILED, Fault.VIDEO_LOST, Fault.TRACKER_LOST, Fault.ESTIMATOR_SILENT),
    *(Fault.TRACKER_ALERT, Fault.TRACKER_STALE, Fault.LINE_OF_SIGHT, Fault.POSE_UNUSABLE),
    *(Fault.MARKER_BODY, Fault.FIELD_DISTORTION, Fault.CALIBRATION_FILE, Fault.CALIBRATION_DUE),
    *(Fault.LOG_DAMAGED, Fault.MEMORY_DAMAGED, Fault.LOG_NOT_WRITTEN),
)
_UNSEEN = (PoseStatus.MISSING, PoseStatus.OUT_OF_VOLUME, PoseStatus.PARTIAL)


def output_presence(now_ns: int, health: DeviceHealth, timeouts: Timeouts) -> Check:
    """Reports output-failed when some output has completed no write for timeouts.output_ns: it cannot alarm."""
    return _presence(
        "output presence", Fault.OUTPUT_FAILED, now_ns, health.started_ns, health.output_ns, timeouts.output_ns
    )


def video_presence(now_ns: int, health: DeviceHealth, timeouts: Timeouts) -> Check:
    """Reports video-lost when no picture has arrived for timeouts.video_ns."""
    return _presence("video presence", Fault.VIDEO_LOST, now_ns, health.started_ns, health.frame_ns, timeouts.video_ns)


def tracker_presence(now_ns: int, health: DeviceHealth, timeouts: Timeouts) -> Check:
    """Reports tracker-lost when no reply for the probe's tool has come for timeouts.tracker_ns.

    A reply without a pose counts.
    """
    last_ns = health.replies.reply_ns
    return _presence("tracker presence", Fault.TRACKER_LOST, now_ns, health.started_ns, last_ns, timeouts.tracker_ns)


def estimator_presence(now_ns: int, health: DeviceHealth, timeouts: Timeouts) -> Check:
    """Reports estimator-silent when the estimator has sent no report for timeouts.estimator_ns, or its process has
    died.

    It reports at least ten times a second, even when it has nothing to conclude.
    """
    last_ns = health.heartbeat_ns
    return _presence(
        "estimator presence", Fault.ESTIMATOR_SILENT, now_ns, health.started_ns, last_ns, timeouts.estimator_ns
    )


def _presence(name: str, fault: Fault, now_ns: int, started_ns: int, last_ns: int | None, limit_ns: int) -> Check:
    """Returns the check of a presence. What never came has failed; its age counts from the start."""
    if last_ns is None:
        return Check(name, fault, (now_ns - started_ns) / 1e6, 0.0, "ms", limit_ns / 1e6, VerdictKind.FAULT)
    return silence(name, fault, now_ns - last_ns, limit_ns)


def tracker_alert(now_ns: int, health: DeviceHealth, timeouts: Timeouts) -> Check:
    """Reports tracker-alert when the reply is FAULT, and none has been fresh for timeouts.tracker_ns.

    The tracker then reports that its poses cannot be trusted: bumped, too hot, faulty, disturbed.
    """
    age_ns = _without_fresh_ns(now_ns, health) if health.replies.status is PoseStatus.FAULT else 0
    return silence("tracker alert", Fault.TRACKER_ALERT, age_ns, timeouts.tracker_ns)


def tracker_freshness(now_ns: int, health: DeviceHealth, timeouts: Timeouts) -> Check:
    """Reports tracker-stale when the reply is STALE, and none has been fresh for timeouts.stale_ns.

    Old measurements are worse than silence, because nothing looks wrong.
    """
    age_ns = _without_fresh_ns(now_ns, health) if health.replies.status is PoseStatus.STALE else 0
    return silence("tracker freshness", Fault.TRACKER_STALE, age_ns, timeouts.stale_ns)


def line_of_sight(now_ns: int, health: DeviceHealth, timeouts: Timeouts) -> Check:
    """Reports NOT_VERIFIED when the tracker has replied without a pose for timeouts.out_of_sight_ns.

    A probe that is put down or hidden is no fault of a device, but nothing can be verified meanwhile.
    """
    age_ns = _without_pose_ns(now_ns, health) if health.replies.status in _UNSEEN else 0
    return silence("line of sight", Fault.LINE_OF_SIGHT, age_ns, timeouts.out_of_sight_ns, VerdictKind.NOT_VERIFIED)


def pose_usable(now_ns: int, health: DeviceHealth, timeouts: Timeouts) -> Check:
    """Reports NOT_VERIFIED when the reply is NOT_UNDERSTOOD, and there has been no pose for timeouts.tracker_ns.

    An unknown status, or a matrix that is not rigid, is not a fault that the tracker reports.
    """
    age_ns = _without_pose_ns(now_ns, health) if health.replies.status is PoseStatus.NOT_UNDERSTOOD else 0
    return silence("pose usable", Fault.POSE_UNUSABLE, age_ns, timeouts.tracker_ns, VerdictKind.NOT_VERIFIED)


def _without_pose_ns(now_ns: int, health: DeviceHealth) -> int:
    """Returns the time since the last pose, or since the start."""
    return now_ns - (health.started_ns if health.replies.pose_ns is None else health.replies.pose_ns)


def _without_fresh_ns(now_ns: int, health: DeviceHealth) -> int:
    """Returns the time since the last fresh reply, or since the start."""
    return now_ns - (health.started_ns if health.replies.fresh_ns is None else health.replies.fresh_ns)


def marker_fit(health: DeviceHealth, limits: Limits) -> Check:
    """Reports marker-body when the markers fit the reported pose worse than limits.marker_fit_mm.

    Causes are dirt, a reflection, a bent body, or the wrong definition. An electromagnetic tracker has no such figure.
    """
    value_mm = None if health.body is None else health.body.fit_mm
    return _quality("marker fit", Fault.MARKER_BODY, value_mm, "mm", limits.marker_fit_mm)


def marker_geometry(health: DeviceHealth, limits: Limits) -> Check:
    """Reports marker-body when the markers differ from the tool's definition by more than limits.marker_shape_mm.

    Then one is loose, or the body is bent.
    """
    value_mm = None if health.body is None else health.body.shape_mm
    return _quality("marker geometry", Fault.MARKER_BODY, value_mm, "mm", limits.marker_shape_mm)


def field_indicator(health: DeviceHealth, limits: Limits) -> Check:
    """Reports field-distortion when the indicator value of an electromagnetic tracker exceeds limits.field_indicator.

    Metal near it bends its poses slowly; this value is the only sign.
    """
    value = None if health.body is None else health.body.indicator
    return _quality("field indicator", Fault.FIELD_DISTORTION, value, "", limits.field_indicator)


def _quality(name: str, fault: Fault, value: float | None, unit: str, limit: float) -> Check:
    if value is None:
        return Check(name, fault, nan, nan, unit, limit, VerdictKind.NOT_VERIFIED)
    return Check(name, fault, value, 0.0, unit, limit, VerdictKind.FAULT if value > limit else VerdictKind.OK)


def calibration_file(health: DeviceHealth) -> Check:
    """Reports calibration-file while the configured file is neither in force nor the one that a person last decided
    about.

    A file that was changed takes no effect by itself, and nobody should believe that it did.
    """
    changed = health.calibration_file_changed
    verdict = VerdictKind.FAULT if changed else VerdictKind.OK
    return Check("calibration file", Fault.CALIBRATION_FILE, float(changed), 0.0, "", 1.0, verdict)


def calibration_date(health: DeviceHealth) -> Check:
    """Reports calibration-due while the reference in force is overdue or has expired. Monitoring continues; with
    `[calibration] overdue = "expires"` the reference cannot be verified any more, so that the contact opens.
    """
    passed = health.calibration_overdue
    verdict = VerdictKind.FAULT if passed else VerdictKind.OK
    return Check("calibration date", Fault.CALIBRATION_DUE, float(passed), 0.0, "", 1.0, verdict)


def alarm_log_integrity(health: DeviceHealth) -> Check:
    """Reports memory-damaged or log-damaged until all damage is acknowledged; the value is the number of its kinds."""
    fault = health.damage[0] if health.damage else Fault.LOG_DAMAGED
    verdict = VerdictKind.FAULT if health.damage else VerdictKind.OK
    return Check("alarm log integrity", fault, float(len(health.damage)), 0.0, "", 1.0, verdict)


def alarm_log_written(health: DeviceHealth, timeouts: Timeouts) -> Check:
    """Reports log-not-written when an entry has waited for the disk longer than timeouts.log_ns.

    A full or stalled disk suppresses no alarm, but what happens now may be lost with the power.
    """
    return silence("alarm log written", Fault.LOG_NOT_WRITTEN, health.log_waits_ns, timeouts.log_ns)


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
    """Returns one Check per watcher, failing or not. limits: None for the default ones."""
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
