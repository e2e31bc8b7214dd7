"""Describes what the hardware process knows about its devices at one tick, and how long each may be silent."""

from dataclasses import dataclass

from probewatch.appliance.limits import TRACKER_STALE_MS
from probewatch.appliance.types import Check, Fault, VerdictKind
from probewatch.drivers.samples import MarkerBody, PoseStatus


@dataclass(frozen=True, slots=True)
class Replies:
    """Holds what a tracker's replies have reported so far; times in ns, None where there was none.

    reply_ns: last one in which the probe's tool was not DISABLED, whatever it saw. fresh_ns: last one that was neither
    STALE nor FAULT. pose_ns: last one with a pose. status: that of the last one.
    """

    reply_ns: int | None = None
    fresh_ns: int | None = None
    pose_ns: int | None = None
    status: PoseStatus | None = None

    def noted(self, status: PoseStatus, at_ns: int) -> "Replies":
        """Returns the replies with one of that status at at_ns added."""
        return Replies(
            reply_ns=self.reply_ns if status is PoseStatus.DISABLED else at_ns,
            fresh_ns=self.fresh_ns if status in (PoseStatus.STALE, PoseStatus.FAULT) else at_ns,
            pose_ns=at_ns if status is PoseStatus.OK else self.pose_ns,
            status=status,
        )


@dataclass(frozen=True, slots=True)
class DeviceHealth:
    """Holds the state of the devices at one tick. Arrival times are ns of the host clock; None where there was none
    since the start.

    replies: of the tracker. heartbeat_ns: last report of the present estimator process. output_ns: last write of the
    output that lags most. damage: hazard classes of the alarm log that no person has acknowledged. log_waits_ns: age of
    its oldest entry that is not on the disk yet. calibration_file_changed: the configured file is neither in force nor
    decided about. calibration_overdue: a date of the reference in force has passed. body: how well the tracker
    measures, median of the last second; None for a tracker that does not report it.
    """

    started_ns: int
    frame_ns: int | None = None
    replies: Replies = Replies()
    heartbeat_ns: int | None = None
    output_ns: int | None = None
    damage: tuple[Fault, ...] = ()
    log_waits_ns: int = 0
    calibration_file_changed: bool = False
    calibration_overdue: bool = False
    body: MarkerBody | None = None


@dataclass(frozen=True, slots=True)
class Timeouts:
    """Holds how long each silence is tolerated, ns."""

    video_ns: int = 500_000_000
    tracker_ns: int = 500_000_000
    stale_ns: int = round(TRACKER_STALE_MS * 1e6)
    out_of_sight_ns: int = 3_000_000_000
    estimator_ns: int = 1_000_000_000
    output_ns: int = 500_000_000
    log_ns: int = 2_000_000_000


def silence(name: str, fault: Fault, age_ns: int, limit_ns: int, failed: VerdictKind = VerdictKind.FAULT) -> Check:
    """Returns the check of an age in ms: `failed` beyond the limit, OK up to it."""
    verdict = failed if age_ns > limit_ns else VerdictKind.OK
    return Check(name, fault, age_ns / 1e6, 0.0, "ms", limit_ns / 1e6, verdict)
