"""Exports a recording: as sequences for 3D Slicer and PLUS, as a table, or as a film with the verdicts."""

import csv
import io
from bisect import bisect
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from probewatch.appliance.core.times import MOST_APART_NS
from probewatch.appliance.storage.black_box import BlackBox, Series
from probewatch.appliance.storage.black_box_fields import Made, State
from probewatch.appliance.types import Verdict, VerdictKind
from probewatch.drivers.errors import ConfigurationError, RecordingError
from probewatch.drivers.files.atomic_file import writing
from probewatch.drivers.recordings.metaimage_writing import SequenceItem, write_metaimage
from probewatch.drivers.recordings.nrrd import write_nrrd
from probewatch.drivers.recordings.pose_table import POSE_COLUMNS
from probewatch.drivers.rigid import interpolate
from probewatch.drivers.samples import Frame, GreyImage, Matrix4, Pose

FORMS = (".igs.mha", ".igs.nrrd", "csv", "mp4")
_NAME, _WITNESS = "ProbeToTracker", "WitnessToTracker"
_FPS = 30.0
"""Frames per second of a film whose pictures do not determine a rate."""
_SLOWEST_FPS, _FASTEST_FPS = 1.0, 120.0
"""Bounds, frames per second, of a film that players can show; pictures come at their mean rate, not each at its own
time."""
_COLOURS = {VerdictKind.OK: (90, 200, 90), VerdictKind.FAULT: (80, 80, 255), VerdictKind.NOT_VERIFIED: (220, 200, 90)}
"""Colours of a film (blue, green, red): those of the alarm."""
_BAND_PX = 24
"""Pixels below the picture for one line of text: state and verdict."""


class Written(NamedTuple):
    """Counts what was written. number: pictures, or the poses of a table. left_out: pictures whose size differs from
    that of the first.
    """

    number: int
    left_out: int = 0


def missing_parts(series: Series) -> Iterator[str]:
    """Yields one line for each place where parts of the run are missing, in seconds of its first picture or pose."""
    for before, box in pairwise(series.boxes):
        first, last = before.begun.part + 1, box.begun.part - 1
        if first <= last:
            parts = f"part {first} is missing" if first == last else f"parts {first} to {last} are missing"
            start_ns = _span_ns(series.boxes[0])[0]
            from_s, until_s = ((t_ns - start_ns) / 1e9 for t_ns in (_span_ns(before)[1], _span_ns(box)[0]))
            lacking = "neither picture nor reading of the tracker"
            yield f"The recording has {lacking} for {until_s - from_s:.1f} s from {from_s:.2f} s on: {parts}"


def _span_ns(box: BlackBox) -> tuple[int, int]:
    """Returns the first and the last time of its pictures and poses; when it was begun where it has none."""
    times_ns = [t_ns for _, t_ns in box.stamps()] or [box.begun.t_ns]
    return min(times_ns), max(times_ns)


def export(series: Series, form: str, path: Path) -> Written:
    """Writes the series in one of FORMS. Raises RecordingError where it has no pictures (for a table: no poses),
    ConfigurationError where the file cannot be written.
    """
    write = {".igs.mha": _sequence, ".igs.nrrd": _sequence, "csv": _table, "mp4": _film}[form]
    try:
        return write(series, path)
    except OSError as error:
        remedy = "Name a file in a folder that exists and may be written to"
        raise ConfigurationError(f"cannot be written: {error.strerror}", str(path), remedy) from error


def items(series: Series) -> Iterator[SequenceItem]:
    """Yields each picture with the probe's pose interpolated at its time; INVALID where there is none. If a second body
    was ever seen, its pose is added in the same way. The stamps are those of the recording: CLOCK_MONOTONIC of the
    cart.
    """
    poses, seconds = _poses(series), _poses(series, second=True)
    tracks = {_NAME: poses} | ({_WITNESS: seconds} if seconds else {})
    times = {name: [t_ns for t_ns, _ in track] for name, track in tracks.items()}
    for frame in _frames(series):
        t_ns = frame.stamp.t_ns
        found = {name: _pose_at(track, times[name], t_ns) for name, track in tracks.items()}
        yield SequenceItem(t_ns, frame.image, found, frame.sequence)


def _sequence(series: Series, path: Path) -> Written:
    size_px = _size_px(series)
    counted = _Counted(items(series), size_px)
    if path.suffix == ".nrrd":
        write_nrrd(path, counted, size_px)
    else:
        write_metaimage(path, counted, size_px)
    return Written(counted.number, counted.left_out)


class _Counted:
    """Iterates over items and counts them. A sequence has one picture size, so pictures of other sizes are left out."""

    def __init__(self, found: Iterable[SequenceItem], size_px: tuple[int, int]) -> None:
        self._found, self._shape, self.number = found, size_px[::-1], 0
        self.left_out = 0

    def __iter__(self) -> Iterator[SequenceItem]:
        for item in self._found:
            if item.image is not None and item.image.shape == self._shape:
                self.number += 1
                yield item
            else:
                self.left_out += 1


def _table(series: Series, path: Path) -> Written:
    """Writes every pose with the latest verdict and the state, beside the columns that `replay --poses` reads."""
    text, number = io.StringIO(newline=""), 0
    writer = csv.DictWriter(text, (*POSE_COLUMNS, "t_ns", "verdict", "fault", "state"))
    writer.writeheader()
    first = next(_frames(series), None)
    start_ns = 0 if first is None else first.stamp.t_ns
    said: dict[str, object] = {"verdict": "", "fault": "", "state": ""}
    for item, _ in series.items():
        if isinstance(item, Verdict):
            said |= {"verdict": item.kind.value, "fault": item.fault or ""}
        elif isinstance(item, State):
            said["state"] = str(item.status.get("state", ""))
        elif isinstance(item, Pose):
            number += 1
            writer.writerow(_cells(item, start_ns) | said)
    if not number:
        raise RecordingError("holds no poses", str(series.boxes[0].path), "Export its pictures: --to mp4")
    with writing(path) as stream:
        stream.write(text.getvalue().encode())
    return Written(number)


def _cells(pose: Pose, start_ns: int) -> dict[str, object]:
    """Formats numbers with repr, whose digits restore the same value."""
    status = "ok" if pose.matrix is not None else f"{pose.status.value}: {pose.reason}"
    numbers = [""] * 12 if pose.matrix is None else [repr(float(one)) for one in pose.matrix[:3].ravel()]
    t_ns = pose.stamp.t_ns
    own = {"t_s": f"{(t_ns - start_ns) / 1e9:.9f}", "sequence": pose.sequence, "status": status, "t_ns": t_ns}
    return own | dict(zip(POSE_COLUMNS[3:], numbers, strict=True))


def _film(series: Series, path: Path) -> Written:
    """Writes the pictures with a line under each: time, state, verdict and its reason."""
    width, height = _size_px(series)
    size_px = width + width % 2, height + _BAND_PX + height % 2
    fourcc = cv2.VideoWriter.fourcc(*"mp4v")
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, fourcc, _fps(series), size_px)
    if not writer.isOpened():
        remedy = "Name a .mp4 in a folder that exists and may be written to"
        raise ConfigurationError("cannot be written as MP4", str(path), remedy)
    number, left_out, verdict, state, start_ns = 0, 0, None, "", None
    try:
        for item, _ in series.items():
            if isinstance(item, Verdict):
                verdict = item
            elif isinstance(item, Made):
                verdict = None
            elif isinstance(item, State):
                state = str(item.status.get("state", ""))
            elif isinstance(item, Frame) and item.image.shape != (height, width):
                left_out += 1
            elif isinstance(item, Frame):
                start_ns = item.stamp.t_ns if start_ns is None else start_ns
                writer.write(_drawn(item.image, size_px, (item.stamp.t_ns - start_ns) / 1e9, state, verdict))
                number += 1
    finally:
        writer.release()
    return Written(number, left_out)


def _drawn(image: GreyImage, size_px: tuple[int, int], t_s: float, state: str, verdict: Verdict | None) -> GreyImage:
    height, width = image.shape
    shown = np.zeros((size_px[1], size_px[0], 3), np.uint8)
    shown[:height, :width] = image[:, :, None]
    colour = (180, 180, 180) if verdict is None else _COLOURS[verdict.kind]
    said = "" if verdict is None else f"{verdict.kind.value} {verdict.fault or ''} {verdict.reason}"
    words = f"{t_s:7.2f} s  {state}  {said}".encode("ascii", "replace").decode()
    cv2.putText(shown, words, (4, height + 16), cv2.FONT_HERSHEY_SIMPLEX, 0.4, colour, 1, cv2.LINE_AA)
    cv2.rectangle(shown, (0, 0), (width - 1, height - 1), colour, 1)
    return shown


def _frames(series: Series) -> Iterator[Frame]:
    return (item for item, _ in series.items() if isinstance(item, Frame))


def _size_px(series: Series) -> tuple[int, int]:
    """Returns (width, height) of the first picture. Raises RecordingError."""
    first = next(_frames(series), None)
    if first is None:
        raise RecordingError("holds no pictures", str(series.boxes[0].path), "Export its poses: --to csv")
    return first.image.shape[1], first.image.shape[0]


def _fps(series: Series) -> float:
    pictures, _ = series.spans()
    lasts_s = (pictures.last_ns - pictures.first_ns) / 1e9
    fps = (pictures.number - 1) / lasts_s if lasts_s > 0 else _FPS
    return min(max(fps, _SLOWEST_FPS), _FASTEST_FPS)


def _poses(series: Series, second: bool = False) -> list[tuple[int, Matrix4]]:
    """Returns (ns, pose) of all valid poses in time order. `second` selects the second body on the probe."""
    told = (item for item, _ in series.items() if isinstance(item, Pose))
    found = [(pose.stamp.t_ns, pose.witness if second else pose.matrix) for pose in told]
    return sorted(((t_ns, matrix) for t_ns, matrix in found if matrix is not None), key=lambda pose: pose[0])


def _pose_at(poses: list[tuple[int, Matrix4]], times: list[int], t_ns: int) -> Matrix4 | None:
    place = bisect(times, t_ns)
    if place and times[place - 1] == t_ns:
        return poses[place - 1][1]
    if not 0 < place < len(poses) or times[place] - times[place - 1] > MOST_APART_NS:
        return None
    (before_ns, before), (after_ns, after) = poses[place - 1], poses[place]
    return interpolate(before, after, (t_ns - before_ns) / (after_ns - before_ns))
