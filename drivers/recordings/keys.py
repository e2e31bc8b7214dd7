"""Gives one name to each field of a sequence's header, which has several: those of PLUS in MetaImage and in NRRD, of 3D
Slicer, and our own.

The first name of each field is the one by which it is read from here on; PLUS writes it in MetaImage.
"""

import re
from collections.abc import Mapping
from decimal import Decimal, InvalidOperation
from pathlib import Path

from probewatch.drivers.errors import RecordingError

IMAGE_STATUS, ORIENTATION, IMAGE_TYPE = "ImageStatus", "UltrasoundImageOrientation", "UltrasoundImageType"
NAMES: Mapping[str, tuple[str, ...]] = {
    IMAGE_STATUS: (IMAGE_STATUS, "Status"),
    ORIENTATION: (ORIENTATION, "ultrasound image orientation"),
    IMAGE_TYPE: (IMAGE_TYPE, "ultrasound image type"),
}
"""Field → its names; the second is the one that PLUS writes in NRRD (vtkPlusSequenceIO). We write both there. Capitals,
blanks and underscores make no difference, as scripts write them differently."""
_TIMES = re.compile(r"axis ([0-9]+) index values")
"""Key under which 3D Slicer writes the times of a sequence, s, all in one line."""
_QUOTED = re.compile(r'"([^"]*)"')
_UNITS_PER_S = {"s": 1, "sec": 1, "second": 1, "seconds": 1, "ms": 1000, "us": 1_000_000, "µs": 1_000_000}
"""Unit of the axis of a 3D Slicer sequence → the number of them in a second."""
_LABELS_OF_TIME = ("", "time", "t")
"""Labels with which that axis, where it has no unit, is taken to be in s. "frame" counts pictures, and "%R-R" refers to
a heartbeat."""
_FROM = (0, 1)
"""Numbers that the first frame may have: PLUS and 3D Slicer count from 0, MATLAB scripts from 1."""
FRAME_KEY = re.compile(r"Seq_Frame([0-9]{1,9})_(\S+)")
"""Key of one frame, as PLUS and 3D Slicer write it: number of the frame, name of the field."""
_ORIENTATION_LETTERS = 2
"""Letters of an orientation that say how pictures lie; the third is of volumes, and may be left out."""
_MOST_QUOTED = 40
"""Characters of a value that are repeated: a line of a terminal has 80."""

Fields = dict[str, str]


def take(key: str, value: str, path: Path, general: Fields, frames: dict[int, Fields]) -> None:
    """Adds one line of a header to the fields of its frame, or to those of all. Raises RecordingError where the key was
    there with another value.
    """
    match = FRAME_KEY.fullmatch(key)
    fields, name = (frames.setdefault(int(match[1]), {}), match[2]) if match else (general, key)
    if fields.setdefault(name, value) != value:
        raise contradiction(path, (key, fields[name]), (key, value))


def known(fields: Mapping[str, str], path: Path, overruled: str = "", begins: str = "") -> Fields:
    """Returns the fields by the names used here, without the overruled one. begins: what stands before their names in
    the file. Raises RecordingError where it states one field under two names, with values that contradict one another.
    """
    said: dict[str, tuple[str, str]] = {}
    for name, value in fields.items():
        own = _FIRST.get(_plain(name), name)
        other = said.setdefault(own, (name, value))
        if own != overruled and _meaning(own, other[1]) != _meaning(own, value):
            raise contradiction(path, (begins + other[0], other[1]), (begins + name, value))
    return {own: value for own, (_, value) in said.items() if own != overruled}


def _meaning(field: str, value: str) -> str:
    return value.upper()[:_ORIENTATION_LETTERS] if field == ORIENTATION else value.upper()


def contradiction(path: Path, one: tuple[str, str], other: tuple[str, str]) -> RecordingError:
    """Returns the error about two (name, value) of a header of which one must be wrong."""
    (first, said), (name, value) = one, other
    what = f"says {first} {said[:_MOST_QUOTED]!r} and {name} {value[:_MOST_QUOTED]!r}, which contradict one another"
    return RecordingError(what, str(path), "Leave the wrong one out of its header")


def _plain(name: str) -> str:
    return name.lower().replace(" ", "").replace("_", "")


_FIRST = {_plain(name): one for one, names in NAMES.items() for name in names}


def from_zero(frames: Mapping[int, Fields], count: int, path: Path) -> list[Fields] | None:
    """Returns the fields of each frame in order, numbered from 0 or 1; None where frames are missing or too many.
    Raises RecordingError as known does.
    """
    first = min(frames, default=0)
    if first not in _FROM or len(frames) != count or max(frames, default=-1) != first + count - 1:
        return None
    return [known(frames[n], path, begins=f"Seq_Frame{n:04d}_") for n in range(first, first + count)]


def missing(frames: Mapping[int, Fields], count: int) -> int | None:
    """Returns the number of the first frame without fields, in the numbering of the file; None where every frame has
    some.
    """
    first = min(frames, default=0)
    return next((number for number in range(first, first + count) if number not in frames), None)


def index_times(general: Mapping[str, str], axis: int) -> dict[int, Fields]:
    """Returns the times of a 3D Slicer sequence, which are the values of an axis, in s; empty where it has none. Raises
    ValueError, which states what the values are, where they are not times.
    """
    for name, value in general.items():
        match = _TIMES.fullmatch(name)
        if match and int(match[1]) == axis:
            per_s = _per_s(general, axis)
            return {index: {"Timestamp": _seconds(text, per_s)} for index, text in enumerate(value.split())}
    return {}


def _per_s(general: Mapping[str, str], axis: int) -> int:
    """Returns how many of the axis's units are a second. Raises ValueError where the axis is not one of time."""
    if (kind := general.get(f"axis {axis} index type", "numeric").lower()) != "numeric":
        raise ValueError(f"of type {kind!r}")
    label, unit = (_of_axis(general.get(field, ""), axis) for field in ("labels", "units"))
    if unit.lower() in _UNITS_PER_S:
        return _UNITS_PER_S[unit.lower()]
    if unit or label.lower() not in _LABELS_OF_TIME:
        raise ValueError(f"{label or 'values'!r} in {unit!r}" if unit else f"{label!r} without a unit")
    return 1


def _of_axis(text: str, axis: int) -> str:
    """Returns the word of one axis from a text with one quoted word per axis; empty where it has none."""
    words = _QUOTED.findall(text)
    return words[axis].strip() if axis < len(words) else ""


def _seconds(text: str, per_s: int) -> str:
    try:
        return text if per_s == 1 else str(Decimal(text) / per_s)
    except InvalidOperation:
        return text  # the reader of the header refuses it, and names the frame
