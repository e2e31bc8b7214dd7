"""Reads a table of poses, such as a tracker's log, as one half of a recording. The other half is a film (film.py).

The table is CSV with a line of headings: `t_s`, seconds on the film's time, then either `m00 … m23`, the upper three
rows of the transform probe → tracker by rows, mm, or `x_mm`, `y_mm`, `z_mm`, `qw`, `qx`, `qy`, `qz`; `status` (ok, or
why there is no pose) and `sequence` may follow, and any other column.
"""

import csv
import io
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from probewatch.drivers.errors import RecordingError
from probewatch.drivers.files.markup import NotUtf8Error, number_of, text_of
from probewatch.drivers.files.regular_file import read_bounded
from probewatch.drivers.recordings.foreign import refuse_known
from probewatch.drivers.recordings.metaimage import MAX_STAMP_S, unreadable
from probewatch.drivers.rigid import pose_matrix
from probewatch.drivers.samples import GreyImage, Matrix4, PoseStatus
from probewatch.drivers.trackers.plus_transform import (
    GOOD,
    WITHOUT_POSE,
    TransformReading,
    rigid_reading,
    without_matrix,
)

_MOST_TABLE_BYTES = 256_000_000
"""Bytes of a table, all of which is kept: as many as the header of a sequence may have."""
_MATRIX = tuple(f"m{row}{column}" for row in range(3) for column in range(4))
"""Columns of the upper three rows of a transform, by rows, mm in the last column."""
_QUATERNION = ("x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz")
_NAME = "ProbeToTracker"
_OTHER_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars", " ": "spaces"}
_NUMBER = re.compile(r"[-+0-9.eE]+")
"""A number, well-formed or not: a table whose first line begins with one has no headings."""
_MOST_NAMES = 16
"""Columns that are listed at most: those of a transform and some beside it. More fills the screen; less hides
columns."""
_MOST_QUOTED = 40
"""Characters of a cell that are repeated: a line of a terminal has 80."""
_NOT_SEEN = "Where the tracker saw nothing leave the line out, or say why in a column status"
_MOST_LACKING = 2
"""Columns that a table may lack and is still reported as one with misspelt headings; with more all headings are
listed."""
_MOST_WORDS = 4
"""Words of a column that are listed at most; each row may have one of its own."""
_SHORTEST, _LONGEST = 0.9, 1.1
"""Length of a quaternion that was rounded; others are not a rotation, but columns in another order."""
_OWN_WORDS = {status.value: status for status in PoseStatus if status is not PoseStatus.OK}
"""Words as `probewatch export` writes them, followed by a colon and the reason."""


class PoseTable:
    """Reads poses from a CSV as a sequence without pictures. Raises RecordingError naming the line and the column."""

    size_px = None

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            data = read_bounded(path, _MOST_TABLE_BYTES)
        except OSError as error:
            raise unreadable(path, error) from error
        try:
            text = text_of(data)
        except NotUtf8Error as error:
            refuse_known(data, path, "a table of poses (CSV)")
            raise RecordingError(str(error), str(path), "Save the table as CSV in UTF-8") from None
        names, rows = _table_rows(text, path)
        self._columns = next((one for one in (_MATRIX, _QUATERNION) if set(one) <= set(names)), ())
        if "t_s" not in names or not self._columns:
            refuse_known(data, path, "a table of poses (CSV)")
            what, remedy = _no_table(names)
            raise RecordingError(what, str(path), remedy)
        read = ("t_s", *self._columns, "status", "sequence")
        if twice := [name for name in read if names.count(name) > 1]:
            raise RecordingError(f"has the column {twice[0]} twice", str(path), "Leave the wrong one out")
        for line, cells in rows:
            if any(cell.strip() for cell in cells[len(names) :]):
                what = f"line {line} has {len(cells)} values, and there are {len(names)} headings"
                raise RecordingError(what, str(path), "Write numbers with points, and texts with commas in quotes")
        if not rows:
            raise RecordingError(
                "has headings and no line of values", str(path), "It may be cut short: export it again"
            )
        if said := _never_good([cells[names.index("status")] for _, cells in rows if _has_status(names, cells)]):
            raise RecordingError(said, str(path), "Write ok where the tracker saw the tool, or leave the column out")
        self._lines = [line for line, _ in rows]
        self._rows = [dict(zip(names, cells, strict=False)) for _, cells in rows]

    def __len__(self) -> int:
        return len(self._rows)

    def transform_names(self) -> list[str]:
        return [_NAME]

    def misnamed(self) -> list[str]:
        return []

    def stamp_ns(self, index: int) -> int:
        seconds = self._number(index, "t_s")
        if not abs(seconds) <= MAX_STAMP_S:
            raise self._refused(index, "t_s", "is not a time in seconds")
        return round(seconds * 1e9)

    def sequence(self, index: int) -> int:
        text = (self._rows[index].get("sequence") or "").strip()
        return int(text) if re.fullmatch(r"[0-9]{1,18}", text) else index

    def image_ok(self, index: int) -> bool:
        return False

    def transform(self, index: int, name: str) -> TransformReading:
        status, _, reason = (self._rows[index].get("status") or "ok").strip().partition(": ")
        if status in _OWN_WORDS:
            return TransformReading(None, _OWN_WORDS[status], reason or status)
        if status.upper() in WITHOUT_POSE:
            return without_matrix(status.upper(), name)
        if status.upper() not in GOOD:
            reason = status if " " in status else f"the status is {status[:_MOST_QUOTED]!r}, not 'ok'"
            return TransformReading(None, PoseStatus.MISSING, reason)
        values = [self._number(index, column) for column in self._columns]
        if self._columns == _MATRIX or not any(values):
            return rigid_reading(_from_rows(values) if any(values) else np.zeros((4, 4)), name)
        length = math.hypot(*values[3:])
        if math.isfinite(length) and not _SHORTEST < length < _LONGEST:
            reason = f"{name} has a quaternion of length {length:.4g}, not 1"
            return TransformReading(None, PoseStatus.NOT_UNDERSTOOD, f"{reason}; qw is its first number, the cosine")
        return rigid_reading(_from_quaternion(values), name)

    def pictures(self) -> Iterator[GreyImage]:
        return iter(())

    def _number(self, index: int, column: str) -> float:
        text = self._rows[index].get(column)
        if text is None:
            remedy = "The table is cut, or this line is: copy it again"
            raise RecordingError(f"line {self._lines[index]} ends before {column}", str(self.path), remedy)
        if not text.strip():
            raise RecordingError(f"line {self._lines[index]}, {column} is empty", str(self.path), _NOT_SEEN)
        try:
            return number_of(text)
        except ValueError:
            raise self._refused(index, column, "is not a number") from None

    def _refused(self, index: int, column: str, what: str) -> RecordingError:
        said = self._rows[index].get(column, "")[:_MOST_QUOTED]
        remedy = "Write it with a decimal point and no other mark" if "," in said else "Mend this line"
        remedy = _NOT_SEEN if said.strip().isalpha() else remedy
        remedy = "Give seconds as numbers, such as 0.033" if column == "t_s" else remedy
        return RecordingError(f"line {self._lines[index]}, {column} {said!r} {what}", str(self.path), remedy)


def _table_rows(text: str, path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Returns (headings, (number of the line, its values) of each line that has any). Raises RecordingError."""
    reader = csv.reader(io.StringIO(text, newline=""))
    names, rows = list[str](), list[tuple[int, list[str]]]()
    try:
        for cells in reader:
            if not any(cell.strip() for cell in cells):  # spreadsheets write lines of commas below the table
                continue
            if names:
                rows.append((reader.line_num, cells))
            else:
                names = [cell.strip().lower() for cell in cells]
    except csv.Error as error:
        raise RecordingError(f"is not CSV ({error})", str(path), "Save the table as CSV") from None
    return names, rows


def _has_status(names: list[str], cells: list[str]) -> bool:
    return "status" in names and names.index("status") < len(cells)


def _never_good(statuses: list[str]) -> str:
    """Returns what is wrong with a column in which no word means that there is a pose, and some word is unknown; empty
    where nothing is wrong. Such a column would give a recording without a single pose.
    """
    words = [status.partition(": ")[0].strip() for status in statuses]
    if any(not word or word.upper() in GOOD for word in words):
        return ""
    unknown = [word for word in words if word not in _OWN_WORDS and word.upper() not in WITHOUT_POSE]
    told = ", ".join(map(repr, list(dict.fromkeys(unknown))[:_MOST_WORDS]))
    return f"has no line whose status is ok, and some are {told}, which says here why there is no pose" if told else ""


def _no_table(names: list[str]) -> tuple[str, str]:
    """Returns (what is wrong, what to do) for a table without the headings that are needed."""
    wanted = "t_s and m00 … m23, or t_s, x_mm, y_mm, z_mm, qw, qx, qy, qz"
    if not any(names):
        return "is empty", "Copy it again"
    is_comment = names[0].startswith("#")
    if (
        not is_comment
        and len(names) == 1
        and (found := next((mark for mark in _OTHER_SEPARATORS if mark in names[0]), None))
    ):
        return f"separates its columns by {_OTHER_SEPARATORS[found]}", "Save it with commas, and with points in numbers"
    if is_comment or names[0].startswith("sep="):  # Excel's own first line
        return f"begins with the line {names[0][:40]!r} and not with a line of headings", "Take that line out"
    if _NUMBER.fullmatch(names[0]):
        return "begins with numbers and not with a line of headings", f"Write one above: {wanted}"
    lacking = min((_lacking(names, one) for one in (_MATRIX, _QUATERNION)), key=len)
    if len(lacking) <= _MOST_LACKING:
        others = [name for name in names if name and name not in (*_MATRIX, *_QUATERNION, "t_s", "status", "sequence")]
        has = f"; it has {', '.join(others[:_MOST_NAMES])}" if others else ""
        return f"lacks the column {' and '.join(lacking)}{has}", f"Name its columns {wanted}, in seconds and mm"
    said = ", ".join(names[:_MOST_NAMES]) + (", …" if len(names) > _MOST_NAMES else "")
    return f"has the columns {said}", f"Name them {wanted}; docs/black-box.md explains them"


def _lacking(names: list[str], columns: tuple[str, ...]) -> list[str]:
    return [name for name in ("t_s", *columns) if name not in names]


def write_poses(path: Path, rows: Iterator[Mapping[str, object]]) -> None:
    """Writes a table that PoseTable reads, with the columns of POSE_COLUMNS. Raises OSError."""
    with path.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, POSE_COLUMNS)
        writer.writeheader()
        writer.writerows(rows)


POSE_COLUMNS = ("t_s", "sequence", "status", *_MATRIX)


def _from_rows(values: list[float]) -> Matrix4:
    matrix = np.eye(4)
    matrix[:3] = np.array(values).reshape(3, 4)
    return matrix


def _from_quaternion(values: list[float]) -> Matrix4:
    x_mm, y_mm, z_mm, w, x, y, z = values
    if not math.isfinite(math.hypot(w, x, y, z)):
        return np.full((4, 4), np.nan)  # reported as not a pose, like every matrix that is not a rotation
    return pose_matrix((w, x, y, z), (x_mm, y_mm, z_mm))
