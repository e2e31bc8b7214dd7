"""Gives each frame the pose of its own time, between the two poses that bracket it: never the nearest, never beyond."""

from collections import Counter, deque
from dataclasses import dataclass

from probewatch.appliance.core.times import MOST_APART_NS
from probewatch.appliance.types import StampedPair
from probewatch.drivers.rigid import interpolate
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp

NO_POSE = "no pose before the frame"
GAP = "poses too far apart"
NOT_OK = "pose not usable: "
NEVER = "no pose after the frame"
REASONS = (NO_POSE, GAP, NEVER, *(NOT_OK + status.value for status in PoseStatus if status is not PoseStatus.OK))
"""Reasons why frames have no pose; a technician reads them beside the counts of a scan."""


@dataclass(frozen=True, slots=True)
class Unpaired:
    """Represents a frame that got no pose, and why; reasons are the keys of the report."""

    frame: Frame
    reason: str


class Pairing:
    """Holds frames until a pose at or after frame time + latency has come.

    Each stream comes in the order of its stamps, as `StampGate` lets it in.

    latency_ns > 0 where the tracker is late: the pose stamped t + latency belongs to the image stamped t. max_gap_ns:
    distance beyond which two poses do not bracket. max_wait_ns: age, against the newest frame, beyond which a frame is
    given up. It is longer than a tracker may be silent before it is lost, and short, since all frames that wait are
    registered in one step when it returns: at 30 fps .7 s are 21 pictures, .2 s of work (`make bench`). max_waiting:
    the largest number of frames that wait, for memory.
    """

    def __init__(self, max_gap_ns: int = MOST_APART_NS, max_wait_ns: int = 700_000_000, max_waiting: int = 64) -> None:
        self._max_gap_ns = max_gap_ns
        self._max_wait_ns = max_wait_ns
        self._max_waiting = max_waiting
        self._poses: deque[Pose] = deque()
        self._frames: deque[Frame] = deque()
        self.latency_ns = 0
        self.unpaired: Counter[str] = Counter()

    def step(self, sample: Frame | Pose) -> tuple[StampedPair | Unpaired, ...]:
        """Takes the next sample; returns every frame whose fate it settles, in frame order."""
        refused = self._admit(sample)
        settled = [*refused, *self._settle()]
        for item in settled:
            if isinstance(item, Unpaired):
                self.unpaired[item.reason] += 1
        return tuple(settled)

    def finish(self) -> tuple[Unpaired, ...]:
        """Ends the stream; returns the frames still waiting, which stay without a pose."""
        left = tuple(Unpaired(frame, NEVER) for frame in self._frames)
        self._frames.clear()
        self.unpaired.update(item.reason for item in left)
        return left

    def forget_frames(self, since_ns: int) -> None:
        """Discards the frames that wait with a stamp at or after since_ns, which were stamped wrongly."""
        while self._frames and self._frames[-1].stamp.t_ns >= since_ns:
            self.unpaired[NEVER] += 1
            self._frames.pop()

    def forget_poses(self, since_ns: int) -> None:
        """Discards the poses at or after since_ns, which were stamped wrongly."""
        while self._poses and self._poses[-1].stamp.t_ns >= since_ns:
            self._poses.pop()

    def _admit(self, sample: Frame | Pose) -> list[Unpaired]:
        if isinstance(sample, Pose):
            self._poses.append(sample)
            return []
        self._frames.append(sample)
        given_up = []
        while self._waits_too_long(sample.stamp.t_ns):
            given_up.append(Unpaired(self._frames.popleft(), NEVER))
        return given_up

    def _waits_too_long(self, now_ns: int) -> bool:
        too_old = now_ns - self._frames[0].stamp.t_ns > self._max_wait_ns
        return too_old or len(self._frames) > self._max_waiting

    def _settle(self) -> list[StampedPair | Unpaired]:
        settled: list[StampedPair | Unpaired] = []
        while self._frames and self._poses and self._poses[-1].stamp.t_ns >= self._pose_time(self._frames[0]):
            settled.append(self._pair(self._frames.popleft()))
        return settled

    def _pose_time(self, frame: Frame) -> int:
        return frame.stamp.t_ns + self.latency_ns

    def _pair(self, frame: Frame) -> StampedPair | Unpaired:
        wanted_ns = self._pose_time(frame)
        while len(self._poses) >= 2 and self._poses[1].stamp.t_ns <= wanted_ns:
            self._poses.popleft()
        before, after = self._poses[0], self._poses[min(1, len(self._poses) - 1)]
        if before.stamp.t_ns > wanted_ns:
            return Unpaired(frame, NO_POSE)
        if before.stamp.t_ns == wanted_ns:
            after = before
        return self._between(frame, before, after, wanted_ns)

    def _between(self, frame: Frame, before: Pose, after: Pose, wanted_ns: int) -> StampedPair | Unpaired:
        for pose in (before, after):
            if pose.status is not PoseStatus.OK:
                return Unpaired(frame, NOT_OK + pose.status.value)
        gap_ns = after.stamp.t_ns - before.stamp.t_ns
        if gap_ns > self._max_gap_ns:
            return Unpaired(frame, GAP)
        assert before.matrix is not None
        assert after.matrix is not None
        fraction = (wanted_ns - before.stamp.t_ns) / gap_ns if gap_ns else 0.0
        matrix = interpolate(before.matrix, after.matrix, fraction)
        err_ns = max(frame.stamp.err_ns, before.stamp.err_ns, after.stamp.err_ns)
        return StampedPair(Stamp(frame.stamp.t_ns, err_ns), frame, matrix, gap_ns)
