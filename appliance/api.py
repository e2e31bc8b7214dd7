"""Provides the interface for programs of your own: arrays of pictures and poses in, a verdict for each picture out;
docs/python.md shows it.

Pure, as the core is: no clock, thread, file or device. The arrays run through the same line and supervisor as on a
cart, so that `probewatch replay` of a recording with the same content reports the same.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from heapq import merge
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from probewatch.appliance.core.line import Line
from probewatch.appliance.core.quality.report import Change, LineReport, report_json
from probewatch.appliance.limits import Limits
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.appliance.supervision.timeline import Judging, Timeline
from probewatch.appliance.types import Calibration, Verdict
from probewatch.drivers.errors import RecordingError
from probewatch.drivers.printable import printable
from probewatch.drivers.recordings.replay import SLOWEST_NS
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Sample, Stamp
from probewatch.drivers.trackers.plus_transform import rigid_reading, without_identity
from probewatch.drivers.video.crop import LEAST_PX

_STAMP_ERR_NS = 500
"""Error bound, ns, of a time in seconds with six decimals, as recordings write it."""
_LATEST_S = 4e9
"""Latest time, s since 1970, beyond the year 2090; in ns it fits 64 bits. A larger time is one in ms."""

_MOST_SHOWN = 60
"""Largest number of characters of an argument that a message repeats. More hides what is wrong, less cuts off a pair of
numbers.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """Holds the verdicts, states and report of one session.

    verdicts: one for each picture that was settled, in order; a picture at the end waits for the pose after it, and has
    none. times_s: (len(verdicts),) time for which each holds: that of its picture, or of the one before where its own
    leaps by more than 2 s. changes: from when on a room would have been shown what; their t_s counts from the first
    picture or pose. report: that of the whole session, as of `probewatch replay`.
    """

    times_s: NDArray[np.float64]
    verdicts: tuple[Verdict, ...]
    changes: tuple[Change, ...]
    report: LineReport

    def fields(self) -> dict[str, Any]:
        """Returns the report as docs/replay-report.md has it, for `json.dumps`."""
        return report_json(self.report, self.changes)


def reference(image_to_probe: ArrayLike, image_size_px: tuple[int, int]) -> Calibration:
    """Makes the calibration that is watched from a (4, 4) matrix from pixels to mm in the frame of the marker body.

    image_size_px: (width, height) of the pictures. Raises ConfigurationError for a matrix that is not scale · rotation,
    RecordingError for one of another shape, and for what is no size.
    """
    matrix = _numbers("image_to_probe", image_to_probe)
    if matrix.shape != (4, 4):
        raise _refused("image_to_probe", f"has shape {matrix.shape}, not (4, 4)", "Give it in rows, as PLUS writes it")
    size_px = _array("image_size_px", image_size_px)
    if size_px.shape != (2,) or size_px.dtype.kind not in "iu" or size_px.min() < LEAST_PX:
        what = f"is {printable(repr(image_size_px))[:_MOST_SHOWN]}"
        raise _refused("image_size_px", what, f"Give (width, height), whole numbers of {LEAST_PX} px or more")
    return calibration_from_image_to_probe(matrix, (int(size_px[0]), int(size_px[1])), where="image_to_probe")


def judge(
    pictures: ArrayLike,
    picture_times_s: ArrayLike,
    poses: ArrayLike,
    pose_times_s: ArrayLike,
    watched: Calibration,
    limits: Limits | None = None,
) -> Judged:
    """Runs a session through line and supervisor, and returns what a cart would have reported at each picture.

    pictures: (n, height, width) uint8, grey; row 0 nearest the probe's face, column 0 on its marked side.
    picture_times_s: (n,), s, each later than the one before. poses: (m, 4, 4) marker body → tracker or reference tool,
    mm; a matrix of NaN, the identity or zeros where the body was not seen. pose_times_s: (m,), s, by the same clock.
    limits: what a cart's configuration would set; None for those that probewatch ships with.

    Raises RecordingError where an array is not of this shape, type or unit. One pose that is not rigid is not used,
    which the report counts.
    """
    _require("watched", watched, Calibration, "Make it of a matrix with reference(…), or read_calibration(…) of a file")
    _require("limits", limits or Limits(), Limits, "Give Limits(scale_percent=3.0), or leave it out")
    images = _checked_pictures(_array("pictures", pictures), watched)
    matrices = _checked_poses(_numbers("poses", poses))
    picture_ns = _checked_times("picture_times_s", picture_times_s, len(images))
    pose_ns = _checked_times("pose_times_s", pose_times_s, len(matrices))
    both_ns = max(picture_ns[0], pose_ns[0]), min(picture_ns[-1], pose_ns[-1])
    if both_ns[1] < both_ns[0]:
        what = f"do not overlap: pictures {_span_s(picture_ns)}, poses {_span_s(pose_ns)}"
        raise _refused("picture_times_s and pose_times_s", what, "Give both in seconds of the same clock")
    judging = Judging(limits or Limits())
    line = Line(watched, judging.limits, judging.timeouts.stale_ns)
    timeline = Timeline(min(picture_ns[0], pose_ns[0]), *both_ns, judging)
    verdicts: list[Verdict] = []
    streams: tuple[Iterator[Sample], ...] = (_poses(matrices, pose_ns), _frames(images, picture_ns))
    for sample in merge(*streams, key=lambda one: one.stamp.t_ns):
        said = line.step(sample)
        timeline.step(sample, said)
        verdicts += said
    timeline.finish()
    given_s = dict(zip(picture_ns, np.asarray(picture_times_s, dtype=np.float64), strict=True))
    times_s = np.array([given_s.get(one.t_ns, one.t_ns / 1e9) for one in verdicts])
    return Judged(times_s, tuple(verdicts), tuple(timeline.changes), timeline.completed(line.report()))


def _frames(images: NDArray[np.uint8], times_ns: list[int]) -> Iterator[Frame]:
    for index, (t_ns, image) in enumerate(zip(times_ns, images, strict=True)):
        yield Frame(Stamp(t_ns, _STAMP_ERR_NS), index, image)


def _poses(matrices: NDArray[np.float64], times_ns: list[int]) -> Iterator[Pose]:
    for index, (t_ns, matrix) in enumerate(zip(times_ns, matrices, strict=True)):
        stamp = Stamp(t_ns, _STAMP_ERR_NS)
        if np.isnan(matrix).all():
            yield Pose(stamp, index, None, np.nan, PoseStatus.MISSING, "the pose is NaN: not seen")
        else:
            reading = without_identity(rigid_reading(matrix, "the pose"), "the pose")
            yield Pose(stamp, index, reading.matrix, np.nan, reading.status, reading.reason)


def _checked_pictures(images: NDArray[Any], watched: Calibration) -> NDArray[np.uint8]:
    width, height = watched.image_size_px
    if images.ndim == 4:
        what = f"have shape {images.shape}, so they have colours"
        raise _refused("pictures", what, "Make them grey: (n, height, width)")
    if images.ndim != 3 or not len(images):
        raise _refused("pictures", f"have shape {images.shape}", "Give (n, height, width), n at least 1")
    if images.shape[1:] != (height, width):
        place = {(width, height): "their axes are exchanged: ", (height, len(images)): "n comes last: "}
        hint = place.get(images.shape[1:], "")
        what = f"have shape {images.shape}; {hint}the calibration is of pictures (n, {height}, {width})"
        raise _refused("pictures", what, "Bring the axes into this order, or give the calibration of this size")
    if images.dtype != np.uint8:
        what = f"are {images.dtype}, not uint8"
        raise _refused("pictures", what, "Scale all of them alike to grey values of 0 to 255, as uint8")
    return images


def _checked_poses(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    if matrices.ndim != 3 or matrices.shape[1:] != (4, 4) or not len(matrices):
        what = f"have shape {matrices.shape}, not (m, 4, 4)"
        raise _refused("poses", what, "Give one 4 × 4 matrix for each time, m at least 1")
    seen = [matrix for matrix in matrices if not np.isnan(matrix).all()]
    reasons = [reading.reason for reading in (rigid_reading(matrix, "the first") for matrix in seen) if reading.reason]
    if len(reasons) > len(seen) / 2:
        what = f"{len(reasons)} of {len(seen)} that were seen cannot be used; {reasons[0]}"
        raise _refused("poses", what, "Give marker body → tracker, a rotation and mm, without the picture's scale")
    return matrices


def _checked_times(name: str, times_s: ArrayLike, number: int) -> list[int]:
    """Returns the times in ns, one for each of `number` pictures or poses."""
    times = _numbers(name, times_s)
    if times.shape != (number,):
        raise _refused(name, f"has shape {times.shape}, not ({number},)", "Give one time for each")
    if not np.isfinite(times).all() or np.abs(times).max() > _LATEST_S:
        raise _refused(name, f"has a time that is not finite, or beyond {_LATEST_S:.0e} s", "Give seconds")
    steps_s = np.diff(times)
    if (steps_s <= 0).any():
        index = int(np.argmax(steps_s <= 0)) + 1
        what = f"is not later than the one before at index {index}: {times[index - 1]:.6f} s, then {times[index]:.6f} s"
        raise _refused(name, what, "Sort by time, and leave doubles out")
    if number > 1 and np.median(steps_s) > SLOWEST_NS / 1e9:
        what = f"is {np.median(steps_s):.4g} s from one to the next, the median"
        raise _refused(name, what, f"Give seconds: divide {_likely_unit(float(np.median(steps_s)))}")
    return [round(float(t_s) * 1e9) for t_s in times]


def _likely_unit(step: float) -> str:
    """Returns the unit in which a step from one time to the next, of some 1 to 100 Hz, would be that long, and its
    divisor.
    """
    return "ms by 1000" if step < 1e4 else "µs by 1e6" if step < 5e6 else "ns by 1e9"


def _array(name: str, value: object) -> NDArray[Any]:
    """Returns the value as an array. Raises RecordingError where lists are of several lengths, or nest too deep."""
    try:
        return np.asarray(value)
    except (TypeError, ValueError):
        remedy = "Give an array, in which all parts have one shape"
        raise _refused(name, "cannot be made one array", remedy) from None


def _numbers(name: str, value: object) -> NDArray[np.float64]:
    """Returns the value as an array of floats. Raises RecordingError for what is not made of real numbers."""
    array = _array(name, value)
    if array.dtype.kind not in "iuf":
        remedy = "Give numbers alone; a pose that was not seen is NaN in all 16 places"
        raise _refused(name, f"has {array.dtype} in it, no numbers", remedy)
    return array.astype(np.float64)


def _require(name: str, value: object, kind: type, remedy: str) -> None:
    if not isinstance(value, kind):
        raise _refused(name, f"is of type {type(value).__name__}, not {kind.__name__}", remedy)


def _span_s(times_ns: list[int]) -> str:
    return f"{times_ns[0] / 1e9:.3f} to {times_ns[-1] / 1e9:.3f} s"


def _refused(where: str, what: str, remedy: str) -> RecordingError:
    return RecordingError(what, where, remedy)
