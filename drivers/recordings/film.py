"""A film and a table of poses as two halves of a recording: what a screen recorder and a tracker's log leave.

The film is whatever OpenCV decodes; its time begins with 0 at its first picture. The table is CSV with a line of
headings: `t_s`, seconds on the film's time, then either `m00 … m23`, the upper three rows of the transform probe →
tracker by rows, mm, or `x_mm`, `y_mm`, `z_mm`, `qw`, `qx`, `qy`, `qz`; `status` (ok, or why there is no pose) and
`sequence` may stand beside them, and any other column.
"""

import csv
import io
import math
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import cv2
import numpy as np

from drivers.errors import RecordingError
from drivers.files.markup import NotUtf8Error, number_of, text_of
from drivers.files.regular_file import read_bounded, reading
from drivers.recordings.display_matrix import is_mirrored
from drivers.recordings.foreign import refuse_known
from drivers.recordings.metaimage import MAX_PIXELS, MAX_STAMP_S, unreadable
from drivers.rigid import pose_matrix
from drivers.samples import GreyImage, Matrix4, PoseStatus
from drivers.trackers.plus_transform import GOOD, WITHOUT_POSE, TransformReading, rigid_reading, without_matrix
from drivers.video.crop import FLIPS
from drivers.video.no_film import why_no_film

_MOST_PICTURES = 1_000_000
"""Pictures of a film: nine hours at 30 Hz, whose times are all kept. A damaged film may have no end."""
_COMPLETE = 0.9
"""Share of the pictures that a header counts, and of the time that they take: where the rate varies Matroska has fewer
pictures than are counted, by the duration. Less lets a film pass that has lost its end. Not measured."""
_DARK = 64
"""Of 255. The brightest pixel of ultrasound is saturated or nearly so; more refuses a dim film, less takes values of
12 or 14 bits in pixels of 16 for a black picture. Not measured."""
_LOOKED_AT = 10
"""Pictures of which the brightest pixel is found: more costs decoding, fewer may be of a probe in the air."""
_LISTS = (b"#EXTM3U", b"ffconcat", b"ID3")
"""Beginnings of files that FFmpeg takes for lists of other films, wherever those lie, and of the tag that it skips
before it looks for such a beginning."""
_PATTERN = re.compile(r"%[0-9]*d|%[*?\[\]{}]")
"""In a name it is a pattern to FFmpeg, of a file for each picture."""
_MOST_TABLE_BYTES = 256_000_000
"""Size of a table, all of which is kept: as much as the header of a sequence may have."""
_MATRIX = tuple(f"m{row}{column}" for row in range(3) for column in range(4))
_QUATERNION = ("x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz")
_NAME = "ProbeToTracker"
_OTHER_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars", " ": "spaces"}
_NUMBER = re.compile(r"[-+0-9.eE]+")
_MOST_NAMES = 16
"""Most columns that are listed: those of a transform and some beside it. More fills the screen; less hides columns."""
_MOST_QUOTED = 40
"""Characters of a cell that are repeated: a line of a terminal has 80."""
_NOT_SEEN = "Where the tracker saw nothing leave the line out, or say why in a column status"
_MOST_LACKING = 2
"""Columns that a table lacks and is still reported as one with misspelt headings; with more all headings are listed."""
_MOST_WORDS = 4
"""Most words of a column that are listed; each row may have one of its own."""
_SHORTEST, _LONGEST = 0.9, 1.1
"""Length of a quaternion that was rounded; others are no rotation, but columns in another order."""


class Film:
    """A film as a sequence of pictures without poses. Raises RecordingError where nothing can be decoded.

    lacking: number of pictures that its header counts and that are not there, as in a film that was cut.
    """

    def __init__(self, path: Path, orientation: str | None = None) -> None:
        self.path = path
        named = (orientation or "MF").upper()
        if named[:2] not in FLIPS:
            raise RecordingError(f"orientation {named} is not known", str(path), f"Use {', '.join(FLIPS)}")
        self._flips = FLIPS[named[:2]]
        self._times_ns, self.size_px, counted = self._looked_through()
        there = len(self._times_ns)
        self.lacking = counted - there if there < _COMPLETE * counted else 0

    def __len__(self) -> int:
        return len(self._times_ns)

    def transform_names(self) -> list[str]:
        return []

    def misnamed(self) -> list[str]:
        return []

    def stamp_ns(self, index: int) -> int:
        return self._times_ns[index]

    def sequence(self, index: int) -> int:
        return index

    def image_ok(self, index: int) -> bool:
        return True

    def transform(self, index: int, name: str) -> TransformReading:
        return without_matrix("MISSING", name)

    def pictures(self) -> Iterator[GreyImage]:
        """Each in turn, (height, width), MF-oriented, one in memory."""
        rows, columns = (slice(None, None, -1 if flip else 1) for flip in self._flips)
        film = self._opened()
        try:
            for _ in self._times_ns:
                there, picture = film.read()
                if not there:
                    break
                grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture
                yield np.ascontiguousarray(np.asarray(grey, np.uint8)[rows, columns])
        finally:
            film.release()

    def _opened(self) -> cv2.VideoCapture:
        try:
            with reading(self.path) as stream:
                head = stream.read(max(map(len, _LISTS)))
        except OSError as error:
            raise unreadable(self.path, error) from error
        if head.startswith(_LISTS):
            what = "is a list of other files, not a film that holds its own pictures"
            raise RecordingError(what, str(self.path), "Convert it to MP4 or MKV where those files are yours")
        place = str(self.path.absolute())  # from / on: FFmpeg takes what stands before a colon for a protocol
        if _PATTERN.search(place):
            what = "has a % in its name or folder that stands for the numbers of other files"
            raise RecordingError(what, str(self.path), "Rename it without the %")
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # no lines of its own between those of the command
        cv2.utils.logging.setLogLevel(0)
        film = cv2.VideoCapture(place, cv2.CAP_FFMPEG)
        remedy = "Copy it again where it is cut, else convert it to MP4 or MKV"
        if refused := why_no_film(film, "cannot be decoded as a film", remedy):
            raise RecordingError(refused[0], str(self.path), refused[1])
        return film

    def _looked_through(self) -> tuple[list[int], tuple[int, int], int]:
        """(times of all pictures, ns; width and height; how many pictures the header counts, 0 where it does not)."""
        film, times_ns, seen = self._opened(), list[int](), _Look()
        if is_mirrored(self.path):
            film.release()
            what = "asks players to mirror its pictures, which the decoder here does not do"
            remedy = f"Store them as they are to be seen: ffmpeg -i {self.path.name} -c:v ffv1 new.mkv"
            raise RecordingError(what, str(self.path), remedy)
        try:
            told = film.get(cv2.CAP_PROP_FRAME_COUNT)
            counted = round(told) if 0 < told < _MOST_PICTURES else 0
            lasts_s = counted / film.get(cv2.CAP_PROP_FPS) if film.get(cv2.CAP_PROP_FPS) > 0 else 0.0
            deep_bits = _deep_grey(round(film.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)))
            size_px = round(film.get(cv2.CAP_PROP_FRAME_WIDTH)), round(film.get(cv2.CAP_PROP_FRAME_HEIGHT))
            if size_px[0] * size_px[1] > MAX_PIXELS:
                what = f"has {size_px[0]} × {size_px[1]} pixels; more than {MAX_PIXELS} are no picture of a scanner"
                raise RecordingError(what, str(self.path), "Cut the pictures, or make them smaller")
            while len(times_ns) < _MOST_PICTURES and film.grab():
                times_ns.append(round(film.get(cv2.CAP_PROP_POS_MSEC) * 1e6))
                seen.look(film)
            codec = round(film.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little", signed=True).decode("ascii", "replace")
        finally:
            film.release()
        if not times_ns and counted > 1:
            what = f"counts {counted} pictures, none of which can be decoded here (codec {codec.strip()})"
            raise RecordingError(what, str(self.path), f"Convert it: ffmpeg -i {self.path.name} -c:v ffv1 new.mkv")
        if not times_ns:
            raise RecordingError("holds no pictures", str(self.path), "It may be cut short: copy it again")
        if seen.alike and len(times_ns) > 1:
            what = f"gives one and the same picture {len(times_ns)} times: it is interlaced, or was frozen throughout"
            remedy = f"Make interlaced pictures whole: ffmpeg -i {self.path.name} -vf yadif -c:v ffv1 new.mkv"
            raise RecordingError(what, str(self.path), remedy)
        if deep_bits and seen.brightest < _DARK:
            what = (
                f"has pixels of {deep_bits} bits, none of which comes to a quarter of white, as of 12 bits stored in 16"
            )
            raise RecordingError(
                what, str(self.path), "Rescale all pictures alike to 8 bits of grey, and save them again"
            )
        first_ns = times_ns[0]
        is_whole = times_ns[-1] - first_ns >= _COMPLETE * lasts_s * 1e9
        return [t_ns - first_ns for t_ns in times_ns], size_px, 0 if is_whole else counted


def _deep_grey(pixel_format: int) -> int:
    """Bits of a pixel of grey where they are more than 8, else 0. FFmpeg tags them Y, 1, 0, bits, or reversed."""
    tag = (pixel_format & 0xFFFFFFFF).to_bytes(4, "little")
    tag = tag if tag[:1] == b"Y" else tag[::-1]
    return tag[3] if tag[:3] == b"Y1\0" and tag[3] > 8 else 0


class _Look:
    """What the first pictures show. alike: whether all are the same so far: FFmpeg's scaler refuses interlaced ones,
    OpenCV passes that over and gives whatever its memory holds, each time the same. brightest: pixel of them, of 255.
    """

    def __init__(self) -> None:
        self.alike, self.brightest, self._count = True, 0, 0
        self._first: np.ndarray | None = None

    def look(self, film: cv2.VideoCapture) -> None:
        """At the picture that was grabbed last; at none any more once enough was seen and two have differed."""
        if not self.alike and self._count >= _LOOKED_AT:
            return
        there, picture = film.retrieve()
        if not there:
            return
        self._count += 1
        self.alike = self.alike and (self._first is None or np.array_equal(picture, self._first))
        self._first = picture
        self.brightest = max(self.brightest, int(picture.max()))


_OWN_WORDS = {status.value: status for status in PoseStatus if status is not PoseStatus.OK}
"""As `probewatch export` writes them, with a colon and the reason behind."""


class PoseTable:
    """Poses out of a CSV as a sequence without pictures. Raises RecordingError naming the line and the column."""

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
        if self._columns == _MATRIX:
            return rigid_reading(_from_rows(values), name)
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
    """(headings, (number of the line, its values) of each line that has any). Raises RecordingError."""
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
    """What is wrong with a column in which nothing says that there is a pose, and some word is of nobody known; empty
    where nothing is. It would give a recording without a single pose.
    """
    words = [status.partition(": ")[0].strip() for status in statuses]
    if any(not word or word.upper() in GOOD for word in words):
        return ""
    unknown = [word for word in words if word not in _OWN_WORDS and word.upper() not in WITHOUT_POSE]
    told = ", ".join(map(repr, list(dict.fromkeys(unknown))[:_MOST_WORDS]))
    return f"has no line whose status is ok, and some are {told}, which says here why there is no pose" if told else ""


def _no_table(names: list[str]) -> tuple[str, str]:
    """(what is wrong, what to do) of a table without the headings that are needed."""
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
    """A table that PoseTable reads, with the columns of POSE_COLUMNS. Raises OSError."""
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
        return np.full((4, 4), np.nan)  # reported as a pose that is none, like every matrix that is no rotation
    return pose_matrix((w, x, y, z), (x_mm, y_mm, z_mm))
