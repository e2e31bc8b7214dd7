"""What a tracker that answers says of its own poses: a fault, an old measurement, or that it does not see the probe."""

from probewatch.appliance.supervision.watchers.device_health import DeviceHealth, Timeouts, silence
from probewatch.appliance.types import Check, Fault, VerdictKind
from probewatch.drivers.samples import PoseStatus

REPORTS_FAULTS = (Fault.TRACKER_ALERT, Fault.TRACKER_STALE, Fault.LINE_OF_SIGHT, Fault.POSE_UNUSABLE)

_UNSEEN = (PoseStatus.MISSING, PoseStatus.OUT_OF_VOLUME, PoseStatus.PARTIAL)


def tracker_alert(now_ns: int, health: DeviceHealth, timeouts: Timeouts) -> Check:
    """tracker-alert when the reply is FAULT, and none has been fresh for timeouts.tracker_ns.

    It says of itself that its poses cannot be believed: bumped, too hot, faulty, disturbed.
    """
    age_ns = _without_fresh_ns(now_ns, health) if health.replies.status is PoseStatus.FAULT else 0
    return silence("tracker alert", Fault.TRACKER_ALERT, age_ns, timeouts.tracker_ns)


def tracker_freshness(now_ns: int, health: DeviceHealth, timeouts: Timeouts) -> Check:
    """tracker-stale when the reply is STALE, and none has been fresh for timeouts.stale_ns.

    Old measurements are worse than silence: nothing looks wrong.
    """
    age_ns = _without_fresh_ns(now_ns, health) if health.replies.status is PoseStatus.STALE else 0
    return silence("tracker freshness", Fault.TRACKER_STALE, age_ns, timeouts.stale_ns)


def line_of_sight(now_ns: int, health: DeviceHealth, timeouts: Timeouts) -> Check:
    """NOT_VERIFIED when the tracker has answered without a pose for timeouts.out_of_sight_ns.

    A probe laid aside or hidden is no fault of a device, but nothing can be verified meanwhile.
    """
    age_ns = _without_pose_ns(now_ns, health) if health.replies.status in _UNSEEN else 0
    return silence("line of sight", Fault.LINE_OF_SIGHT, age_ns, timeouts.out_of_sight_ns, VerdictKind.NOT_VERIFIED)


def pose_usable(now_ns: int, health: DeviceHealth, timeouts: Timeouts) -> Check:
    """NOT_VERIFIED when the reply is NOT_UNDERSTOOD, and there has been no pose for timeouts.tracker_ns.

    An unknown status, or a matrix that is not rigid, is no fault that the tracker reports.
    """
    age_ns = _without_pose_ns(now_ns, health) if health.replies.status is PoseStatus.NOT_UNDERSTOOD else 0
    return silence("pose usable", Fault.POSE_UNUSABLE, age_ns, timeouts.tracker_ns, VerdictKind.NOT_VERIFIED)


def _without_pose_ns(now_ns: int, health: DeviceHealth) -> int:
    """How long ago the last pose, or the start, was."""
    return now_ns - (health.started_ns if health.replies.pose_ns is None else health.replies.pose_ns)


def _without_fresh_ns(now_ns: int, health: DeviceHealth) -> int:
    """How long ago the last fresh reply, or the start, was."""
    return now_ns - (health.started_ns if health.replies.fresh_ns is None else health.replies.fresh_ns)
