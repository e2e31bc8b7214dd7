"""Provides the poses of the simulated tools: from the shared world, from a pose file, or from a recording.

A pose file is CSV in UTF-8 with the heading `t_s,tool,q0,qx,qy,qz,x_mm,y_mm,z_mm`. Each row holds the pose of one tool
(probe, reference, tool2, tool3 …) in the tracker's frame at one second of the world; the rows of a tool are in the
order of time. Between two rows the pose is interpolated, before the first and after the last it is stationary. A row
without numbers states that the tool is not seen until its next row.
"""

import csv
import math
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Callable, Mapping
from io import StringIO
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from probewatch.drivers.errors import RecordingError
from probewatch.drivers.files.markup import SAVE_AS_UTF_8, NotUtf8Error, text_of
from probewatch.drivers.files.regular_file import reading
from probewatch.drivers.recordings.replay import open_recording
from probewatch.drivers.samples import Matrix4
from probewatch.drivers.trackers.pose_bounds import UNIT_TOLERANCE
from probewatch.drivers.twins.scene.tank import PlaceOfWork
from probewatch.drivers.twins.scene.world import World

PROBE, REFERENCE, WITNESS = "probe", "reference", "witness"

PoseAt = Callable[[str, float, int], Matrix4 | None]
"""(name of the tool, world seconds, number of the measurement) → (4, 4) tool → tracker, mm; None where not seen."""

_UNUSED = "MF"
"""Orientation of pictures that are not used here, so that the file need not state it."""
_SEQUENCE = "Give a PLUS sequence whose frames have ProbeToReference, or ProbeToTracker"
_HEADING = ["t_s", "tool", "q0", "qx", "qy", "qz", "x_mm", "y_mm", "z_mm"]
_REFERENCE_POSE_MM = (150.0, -40.0, -1700.0)
"""Millimetres, tracker frame: beside the probe and some 0.2 m behind it, where a reference is clamped to the table."""

WITNESS_MM = (80.0, 10.0, -15.0)
"""Place of a second body on the probe, in the axes of the first: as far as two bodies of usual size must be apart."""
_OTHER_NOISE = 1 << 40
"""Offset of the number of a measurement: the seed of another noise, which no measurement of the probe has."""


def on_probe(tool: str) -> bool:
    """Returns whether the tool is a second body on the probe: every tool but the first two by name is one."""
    return tool not in (PROBE, REFERENCE)


class Track:
    """Holds the path of one tool. times_s: rising. poses: (4, 4) each, None where the tool is not seen from then on."""

    def __init__(self, times_s: list[float], poses: list[Matrix4 | None]) -> None:
        self._times_s, self._poses = times_s, poses

    def at(self, t_s: float) -> Matrix4 | None:
        """Returns the pose at t_s, interpolated along the straight line and the shortest turn."""
        after = bisect_right(self._times_s, t_s)
        first, second = self._poses[max(after - 1, 0)], self._poses[min(after, len(self._poses) - 1)]
        if first is None or second is None or first is second:
            return first
        begin_s, end_s = self._times_s[max(after - 1, 0)], self._times_s[after]
        if end_s <= begin_s or t_s <= begin_s:
            return first
        return _between(first, second, (t_s - begin_s) / (end_s - begin_s))


def world_motion(world: World | PlaceOfWork) -> PoseAt:
    """Returns the poses of the shared world: its probe, a reference lying still beside it, and further tools, each a
    second body on the probe with a noise of its own.
    """
    still, relative_pose = np.eye(4), np.eye(4)
    still[:3, 3], relative_pose[:3, 3] = _REFERENCE_POSE_MM, WITNESS_MM

    def pose_at(tool: str, t_s: float, number: int) -> Matrix4 | None:
        if tool == REFERENCE:
            return still
        if tool == PROBE:
            return world.measured_pose(t_s, max(number, 0))
        return np.asarray(world.measured_pose(t_s, max(number, 0) + _OTHER_NOISE) @ relative_pose)

    return pose_at


def pose_file(path: Path) -> PoseAt:
    """Returns the poses of a pose file. Raises RecordingError naming the row that is not a pose."""
    rows: defaultdict[str, list[tuple[float, Matrix4 | None]]] = defaultdict(list)
    try:
        with reading(path) as stream:
            reader = csv.reader(StringIO(text_of(stream.read()), newline=""))
            if next(reader, None) != _HEADING:
                raise RecordingError(
                    "the heading is missing", str(path), f"Its first line must be {','.join(_HEADING)}"
                )
            for row in reader:
                t_s, tool, pose = _row(row, f"{path}, line {reader.line_num}")
                rows[tool].append((t_s, pose))
    except NotUtf8Error as error:
        raise RecordingError(str(error), str(path), SAVE_AS_UTF_8) from None
    except (OSError, csv.Error) as error:
        raise RecordingError(f"the pose file cannot be read ({error})", str(path), "Check the path") from None
    return _of_tracks({tool: _track(found, str(path)) for tool, found in rows.items()})


def recorded_motion(path: Path, probe: str | None = None, reference: str | None = None) -> PoseAt:
    """Returns the poses of a PLUS sequence; world time 0 is its first pose. Raises RecordingError; see
    drivers.recordings.replay.
    """
    try:
        recording = open_recording(path, probe=probe, reference=reference, orientation=_UNUSED)
    except RecordingError as error:
        remedy = _SEQUENCE if "--" in error.remedy else error.remedy  # no simulator has those options
        raise RecordingError(error.what, error.where, remedy) from None
    names = {PROBE: recording.tool, REFERENCE: recording.reference}
    tracks = {}
    for tool, transform in names.items():
        if transform is not None:
            poses = [recording.transform(index, transform).matrix for _, index in recording.pose_order]
            begin_ns = recording.pose_order[0][0]
            tracks[tool] = Track([(t_ns - begin_ns) / 1e9 for t_ns, _ in recording.pose_order], poses)
    return _of_tracks(tracks)


def _of_tracks(tracks: Mapping[str, Track]) -> PoseAt:
    def pose_at(tool: str, t_s: float, _number: int) -> Matrix4 | None:
        return tracks[tool].at(t_s) if tool in tracks else None

    return pose_at


def _row(row: list[str], where: str) -> tuple[float, str, Matrix4 | None]:
    remedy = "Give seconds, tool, unit quaternion and millimetres; or seconds and tool alone where it is not seen"
    if len(row) == len(_HEADING) and not any(row[2:]):
        row = row[:2]
    try:
        t_s, tool, values = float(row[0]), row[1], [float(field) for field in row[2:]]
    except (ValueError, IndexError):
        raise RecordingError("this row is not a pose", where, remedy) from None
    if not math.isfinite(t_s) or not tool or not all(map(math.isfinite, values)) or len(values) not in (0, 7):
        raise RecordingError("this row is not a pose", where, remedy)
    if not values:
        return t_s, tool, None
    if abs(math.hypot(*values[:4]) - 1) > UNIT_TOLERANCE:
        raise RecordingError(f"the quaternion has length {math.hypot(*values[:4]):.4g}", where, remedy)
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat([*values[1:4], values[0]]).as_matrix()
    pose[:3, 3] = values[4:]
    return t_s, tool, pose


def _track(rows: list[tuple[float, Matrix4 | None]], where: str) -> Track:
    times_s = [t_s for t_s, _ in rows]
    if any(later <= earlier for earlier, later in pairwise(times_s)):
        raise RecordingError("the times of a tool do not rise", where, "Sort the rows by t_s")
    return Track(times_s, [pose for _, pose in rows])


def _between(first: Matrix4, second: Matrix4, share: float) -> Matrix4:
    turn = Rotation.from_matrix(first[:3, :3].T @ second[:3, :3]).as_rotvec()
    pose = np.eye(4)
    pose[:3, :3] = first[:3, :3] @ Rotation.from_rotvec(share * turn).as_matrix()
    pose[:3, 3] = (1 - share) * first[:3, 3] + share * second[:3, 3]
    return pose
