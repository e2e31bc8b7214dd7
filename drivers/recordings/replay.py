"""Plays recordings as `replay:` devices: frames and poses, all at once in time order or at their own pace.

Where each frame carries its own transform, pose and frame get the same stamp, and the pose comes first. Entries whose
time does not increase, and pictures that the recorder marked as invalid, are left out and counted.
"""

import heapq
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.closable import Closable
from probewatch.drivers.errors import DeviceLost, RecordingError
from probewatch.drivers.recordings import REPLAY
from probewatch.drivers.recordings.advice import in_url
from probewatch.drivers.recordings.film import Film
from probewatch.drivers.recordings.metaimage import MetaImage
from probewatch.drivers.recordings.sequence import Sequence, read_sequence
from probewatch.drivers.recordings.transform_names import transform_names, witness_name
from probewatch.drivers.recordings.unread import fields_unread, turned_note, unread_note
from probewatch.drivers.samples import Frame, Matrix4, Pose, PoseStatus, Sample, Stamp
from probewatch.drivers.trackers.plus_transform import TransformReading, is_identity, without_identity

_STAMP_ERR_NS = 500
"""Half of the last digit that PLUS prints, ns; a recording states nothing more about the error of its stamps."""

_MAX_DISORDER = 0.1
"""Share of entries out of time order above which the recording is refused, as its clock cannot be trusted."""

SLOWEST_NS = 2_000_000_000
"""Largest median time between two entries, ns: the line takes entries further apart for a leap of the clock, so that
nothing would be paired. Times in ms or µs are recognised by it."""

_POSE_DISORDER = "pose time does not increase"

ENDED = "the recording has ended"
"""Reason that a device reports once it has played all of its recording."""

UNORIENTED = "a film does not say how its pictures lie: taken as MF; if they lie otherwise, give --orientation"

_S = TypeVar("_S", Frame, Pose)


@dataclass(frozen=True, slots=True)
class Recording:
    """Represents the pictures and poses of one session, from one file or from two that share a clock.

    tool, reference: names of the transforms that make a pose; reference is None where tool is used alone, and tool is
    None where the session has no poses. witness: name of the transform of a second body on the probe, in the same frame
    as tool; None where there is none. frame_order, pose_order: (t_ns, index) of the entries that are passed on, in time
    order. left_out: reason → number of frames that are not passed on. poses_left_out: the same for poses, where they
    have times of their own. orientation: the one that was named for the pictures, None where none was. at_origin: True
    where the reference is the identity throughout, as where it is the tracker's own frame.
    """

    pictures: Sequence
    poses: Sequence
    tool: str | None
    reference: str | None
    frame_order: tuple[tuple[int, int], ...]
    pose_order: tuple[tuple[int, int], ...]
    left_out: dict[str, int]
    poses_left_out: dict[str, int] = field(default_factory=dict)
    witness: str | None = None
    orientation: str | None = None
    at_origin: bool = False

    @property
    def size_px(self) -> tuple[int, int] | None:
        """Returns (width, height) of the pictures, None where there are none."""
        return self.pictures.size_px

    @property
    def remarks(self) -> list[str]:
        """Returns what was left out, a line for each reason."""
        each = (("pictures", self.left_out), ("poses", self.poses_left_out))
        return [f"{number} {what} left out: {why}" for what, found in each for why, number in found.items()]

    @property
    def notes(self) -> list[str]:
        """Returns how the pictures were turned, or that no orientation is known, and what of the files is not read."""
        return list(filter(None, (self._picture_note, *map(self._unread_note, self._files))))

    @property
    def _files(self) -> list[Sequence]:
        return [self.pictures] if self.poses is self.pictures else [self.pictures, self.poses]

    @property
    def _picture_note(self) -> str:
        if isinstance(self.pictures, Film) and self.orientation is None:
            return UNORIENTED
        if not isinstance(self.pictures, MetaImage) or self.size_px is None:
            return ""
        return turned_note(self.pictures.orientation, self.orientation)

    def _unread_note(self, file: Sequence) -> str:
        if not isinstance(file, MetaImage):
            return ""
        names = (self.tool, self.reference, self.witness) if file is self.poses else ()
        note = unread_note(fields_unread(file.unread, file.frames, filter(None, names)))
        return f"{file.path.name}: {note}" if note and self.poses is not self.pictures else note

    @property
    def start_ns(self) -> int:
        """Returns the earliest stamp of the session, ns of the recording's clock."""
        return min((order[0][0] for order in (self.frame_order, self.pose_order) if order), default=0)

    @property
    def overlap_ns(self) -> tuple[int, int]:
        """Returns the (first, last) stamp between which both devices were recorded; last < first where never."""
        if not self.frame_order or not self.pose_order:
            return self.start_ns, self.start_ns - 1
        first_ns = max(self.frame_order[0][0], self.pose_order[0][0])
        return first_ns, min(self.frame_order[-1][0], self.pose_order[-1][0])

    def __len__(self) -> int:
        return len(self.frame_order) + len(self.pose_order)

    def samples(self) -> Iterator[Sample]:
        """Yields all in time order, stamps in ns of the recording's clock. Raises RecordingError for damaged data."""
        streams: tuple[Iterator[Sample], ...] = (self.pose_samples(), self.frame_samples())
        yield from heapq.merge(*streams, key=lambda sample: sample.stamp.t_ns)

    def frame_samples(self) -> Iterator[Frame]:
        """Yields the pictures alone. Raises RecordingError for damaged data."""
        order = {index: t_ns for t_ns, index in self.frame_order}
        for index, image in enumerate(self.pictures.pictures()):
            if index in order:
                yield Frame(Stamp(order[index], _STAMP_ERR_NS), self.pictures.sequence(index), image)

    def pose_samples(self) -> Iterator[Pose]:
        """Yields the poses alone, those that the tracker did not measure marked as such. Raises RecordingError."""
        for t_ns, index in self.pose_order:
            reading = self._reading(index)
            stamp, sequence = Stamp(t_ns, _STAMP_ERR_NS), self.poses.sequence(index)
            witness = None if reading.matrix is None else self._witnessed(index)
            yield Pose(stamp, sequence, reading.matrix, np.nan, reading.status, reading.reason, witness)

    def _witnessed(self, index: int) -> Matrix4 | None:
        if self.witness is None:
            return None
        return self._fixed(self.transform(index, self.witness), index).matrix

    def transform(self, index: int, name: str) -> TransformReading:
        """Returns a transform of one entry, without a matrix where none was measured. Raises RecordingError."""
        reading = self.poses.transform(index, name)
        return reading if self.at_origin and name == self.reference else without_identity(reading, name)

    def _reading(self, index: int) -> TransformReading:
        """Returns probe → reference tool: inv(ReferenceToTracker) · ProbeToTracker where two transforms make it."""
        assert self.tool is not None
        return self._fixed(self.transform(index, self.tool), index)

    def _fixed(self, tool: TransformReading, index: int) -> TransformReading:
        if self.reference is None or tool.matrix is None:
            return tool
        reference = self.transform(index, self.reference)
        if reference.matrix is None:
            return reference
        return TransformReading(_inverse(reference.matrix) @ tool.matrix, PoseStatus.OK)


def open_recording(
    path: Path,
    *,
    poses: Path | None = None,
    probe: str | None = None,
    reference: str | None = None,
    witness: str | None = None,
    orientation: str | None = None,
    need_poses: bool = True,
) -> Recording:
    """Opens a session and checks its headers. poses: a second sequence whose transforms are used instead.

    The pose is <probe>To<reference> where that was recorded; otherwise it is composed over the tracker, or else it is
    <probe>ToTracker. probe is "Probe" and reference is "Reference" unless named; the reference "Tracker" asks for poses
    without a reference tool. A second body on the probe, in the same frame as the probe, is "Witness" unless named;
    only where it is named must it be there. Raises RecordingError, also where need_poses is True and the transforms are
    missing.
    """
    pictures = read_sequence(path, orientation)
    pose_source = pictures if poses is None else read_sequence(poses)
    tool, fixed = transform_names(pose_source, probe or "Probe", reference, need_poses)
    frame_order, disordered = _in_time_order(pictures) if pictures.size_px else ((), 0)
    shown = tuple(entry for entry in frame_order if pictures.image_ok(entry[1]))
    left_out = {
        "picture time does not increase": disordered,
        "picture marked invalid": len(frame_order) - len(shown),
        "the film is cut: its header counts more pictures": pictures.lacking if isinstance(pictures, Film) else 0,
    }
    pose_order, poses_disordered = _in_time_order(pose_source) if tool else ((), 0)
    has_own_times = pose_source is not pictures or not pictures.size_px
    _check_overlap(shown, pose_order, pose_source)
    return Recording(
        pictures=pictures,
        poses=pose_source,
        tool=tool,
        reference=fixed,
        frame_order=shown,
        pose_order=pose_order,
        left_out={reason: number for reason, number in left_out.items() if number},
        poses_left_out={_POSE_DISORDER: poses_disordered} if poses_disordered and has_own_times else {},
        witness=witness_name(pose_source, tool, fixed, probe or "Probe", witness),
        orientation=orientation,
        at_origin=fixed is not None and _is_origin(pose_source, fixed),
    )


def _is_origin(poses: Sequence, name: str) -> bool:
    """Returns whether the transform is the identity wherever it has a matrix."""
    readings = (poses.transform(index, name) for index in range(len(poses)))
    return all(is_identity(reading) for reading in readings if reading.matrix is not None)


def _check_overlap(pictures: tuple[tuple[int, int], ...], poses: tuple[tuple[int, int], ...], source: Sequence) -> None:
    if pictures and poses and (poses[-1][0] < pictures[0][0] or pictures[-1][0] < poses[0][0]):
        spans = (f"{order[0][0] / 1e9:.3f} to {order[-1][0] / 1e9:.3f} s" for order in (poses, pictures))
        what = "has poses of {}, the pictures are of {}: no picture has a pose".format(*spans)
        raise RecordingError(what, str(source.path), "Give both times by one clock; that of a film begins with 0")


def open_video(target: str, options: dict[str, str], clock: HostClock) -> "Player[Frame]":
    """Opens the pictures of `replay:FILE`; Player describes their pace.

    Raises ConfigurationError for options, RecordingError for the file.
    """
    recording, start_s = _from_url(target, options, need_poses=False)
    if recording.size_px is None:
        raise RecordingError("holds no pictures", target, "Give a recording with pictures as the video device")
    return Player(recording.frame_samples, recording.start_ns, start_s, clock, target)


def open_tracker(target: str, options: dict[str, str], clock: HostClock) -> "Player[Pose]":
    """Opens the poses of `replay:FILE`; Player describes their pace.

    Raises ConfigurationError for options, RecordingError for the file.
    """
    recording, start_s = _from_url(target, options, need_poses=True)
    return Player(recording.pose_samples, recording.start_ns, start_s, clock, target)


class Player(Closable, Generic[_S]):
    """Returns samples when they fall due on the host clock, with stamps of that clock.

    The session starts start_s after the clock's origin, for the video and the tracker alike, so that two devices opened
    from one URL stay in step. Samples that fell due before the device was opened are skipped, as with a camera.
    """

    def __init__(
        self, samples: Callable[[], Iterator[_S]], start_ns: int, start_s: float, clock: HostClock, where: str
    ) -> None:
        self._shift_ns = clock.origin_ns + round(start_s * 1e9) - start_ns
        self._clock, self._where = clock, where
        opened_ns = clock.now_ns() - self._shift_ns
        self._samples: Generator[_S, None, None] = (sample for sample in samples() if sample.stamp.t_ns >= opened_ns)
        self._waiting: _S | None = None

    def close(self) -> None:
        """Closes the stream of samples."""
        self._samples.close()

    def read(self, timeout_s: float) -> _S | None:
        """Returns the next sample; None if none is due within timeout_s. Raises DeviceLost at the end or at damage."""
        sample = self._waiting or self._next()
        self._waiting = sample
        deadline_ns = self._clock.now_ns() + round(timeout_s * 1e9)
        due_ns = sample.stamp.t_ns + self._shift_ns
        self._clock.sleep_until(min(due_ns, deadline_ns))
        if due_ns > deadline_ns:
            return None
        self._waiting = None
        return replace(sample, stamp=Stamp(due_ns, sample.stamp.err_ns))

    def _next(self) -> _S:
        try:
            return next(self._samples)
        except StopIteration:
            raise DeviceLost(ENDED, self._where, "Start the service again to replay it") from None
        except RecordingError as error:
            raise DeviceLost(error.what, error.where, error.remedy) from error


def checked(target: str, options: dict[str, str]) -> float:
    """Returns the time, s, after which the recording begins. Raises ConfigurationError that names the option."""
    return REPLAY.given(options, f"replay:{target}").number("start_s")


def _from_url(target: str, options: dict[str, str], need_poses: bool) -> tuple[Recording, float]:
    start_s = checked(target, options)
    try:
        recording = open_recording(
            Path(target),
            poses=Path(options["poses"]) if "poses" in options else None,
            probe=options.get("probe"),
            reference=options.get("reference"),
            witness=options.get("witness") if need_poses else None,
            orientation=options.get("orientation"),
            need_poses=need_poses,
        )
    except RecordingError as error:
        raise RecordingError(error.what, error.where, in_url(error.remedy)) from None
    return recording, start_s


def _in_time_order(sequence: Sequence) -> tuple[tuple[tuple[int, int], ...], int]:
    """Returns ((t_ns, index), …) of the entries that are later than all before them, and the number of the others.

    Raises RecordingError where too many are out of order, or the rest are too far apart.
    """
    kept: list[tuple[int, int]] = []
    for index in range(len(sequence)):
        t_ns = sequence.stamp_ns(index)
        if not kept or t_ns > kept[-1][0]:
            kept.append((t_ns, index))
    dropped = len(sequence) - len(kept)
    if dropped > _MAX_DISORDER * len(sequence):
        what = f"the time of {dropped} of {len(sequence)} entries is not later than the one before"
        remedy = "Sort them by time and leave doubles out where the times are true, else record again"
        raise RecordingError(what, str(sequence.path), remedy)
    steps_ns = sorted(later - earlier for (earlier, _), (later, _) in pairwise(kept))
    if len(steps_ns) > 1 and (median_ns := steps_ns[len(steps_ns) // 2]) > SLOWEST_NS:
        what = f"its entries are {median_ns / 1e9:.4g} s apart, the median: too slow to be a scan, or not in seconds"
        raise RecordingError(what, str(sequence.path), "Give times in seconds: divide ms by 1000, µs by 1 000 000")
    return tuple(kept), dropped


def _inverse(matrix: Matrix4) -> Matrix4:
    inverse = np.eye(4)
    inverse[:3, :3] = matrix[:3, :3].T
    inverse[:3, 3] = -matrix[:3, :3].T @ matrix[:3, 3]
    return inverse
