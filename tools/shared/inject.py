"""Injects faults into a recording, sample by sample, as the simulated cart would show them live."""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace

from probewatch.drivers.samples import Frame, Pose, PoseStatus, Sample, Stamp
from probewatch.drivers.twins.faults import LATENCY_S, Schedule, spoil_image, spoil_pose

_LATENCY_NS = round(LATENCY_S * 1e9)
"""ns by which poses come late, as from the simulated tracker."""


def inject(samples: Iterable[Sample], schedule: Schedule, origin_ns: int) -> Iterator[Sample]:
    """Yields the samples in time order, with the faults injected; the schedule's seconds count from origin_ns (ns of
    the samples' clock).

    With the fault latency, the tracker reports the pose of LATENCY_S earlier as that of t, so its poses come late.
    """
    spoiler = _Spoiler(schedule, origin_ns)
    late: deque[Pose] = deque()
    for sample in samples:
        while late and late[0].stamp.t_ns <= sample.stamp.t_ns:
            yield from spoiler.pose(late.popleft())
        if isinstance(sample, Frame):
            yield from spoiler.frame(sample)
            continue
        if "latency" not in spoiler.active(sample.stamp.t_ns):
            yield from spoiler.pose(sample)
        shifted = Stamp(sample.stamp.t_ns + _LATENCY_NS, sample.stamp.err_ns)
        if "latency" in spoiler.active(shifted.t_ns):
            late.append(replace(sample, stamp=shifted))
    for pose in late:
        yield from spoiler.pose(pose)


class _Spoiler:
    """Injects the faults that are active into single samples, and keeps what a frozen picture or a stale tracker
    repeats.
    """

    def __init__(self, schedule: Schedule, origin_ns: int) -> None:
        self._schedule, self._origin_ns = schedule, origin_ns
        self._shown: Frame | None = None
        self._measured: Pose | None = None

    def active(self, t_ns: int) -> frozenset[str]:
        return self._schedule.active((t_ns - self._origin_ns) / 1e9)

    def frame(self, frame: Frame) -> Iterator[Frame]:
        active = self.active(frame.stamp.t_ns)
        if "freeze-video" not in active or self._shown is None:
            self._shown = frame
        if "lose-video" not in active:
            yield replace(frame, image=spoil_image(self._shown.image, active))

    def pose(self, pose: Pose) -> Iterator[Pose]:
        active = self.active(pose.stamp.t_ns)
        if "stale-tracker" not in active or self._measured is None:
            self._measured = pose
        if "lose-tracker" in active:
            return
        if self._measured is not pose:
            reason = "the tracker repeats an old measurement"
            pose = replace(pose, sequence=self._measured.sequence, matrix=None, status=PoseStatus.STALE, reason=reason)
        yield pose if pose.matrix is None else replace(pose, matrix=spoil_pose(pose.matrix, active))
