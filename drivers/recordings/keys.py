"""What each program calls the fields of a sequence's header: PLUS in MetaImage and in NRRD, 3D Slicer, and we.

The first name of each field is the one by which it is read from here on; PLUS writes it in MetaImage.
"""

import re
from collections.abc import Mapping

IMAGE_STATUS, ORIENTATION, IMAGE_TYPE = "ImageStatus", "UltrasoundImageOrientation", "UltrasoundImageType"
NAMES: Mapping[str, tuple[str, ...]] = {
    IMAGE_STATUS: (IMAGE_STATUS, "Status"),
    ORIENTATION: (ORIENTATION, "ultrasound image orientation"),
    IMAGE_TYPE: (IMAGE_TYPE, "ultrasound image type"),
}
"""Field → its names; the second is PLUS's in NRRD (vtkPlusSequenceIO). We write both there. Capitals, blanks and
underscores make no difference: scripts write them otherwise."""
_TIMES = re.compile(r"axis ([0-9]+) index values")
"""3D Slicer's key for the times of a sequence, s, all in one line."""
_FROM = (0, 1)
"""Numbers of the first frame: PLUS and 3D Slicer count from 0, MATLAB scripts from 1."""

Fields = dict[str, str]


def known(fields: Mapping[str, str]) -> Fields:
    """The fields by the names of here; where a file says one twice, by its own name."""
    own = {name: _FIRST.get(_plain(name), name) for name in fields}
    other = {own[name]: value for name, value in fields.items() if own[name] != name}
    return {**other, **{name: value for name, value in fields.items() if own[name] == name}}


def _plain(name: str) -> str:
    return name.lower().replace(" ", "").replace("_", "")


_FIRST = {_plain(name): one for one, names in NAMES.items() for name in names}


def from_zero(frames: Mapping[int, Fields], count: int) -> list[Fields] | None:
    """The fields of each frame in order, however they are numbered; None where some are missing or too many."""
    first = min(frames, default=0)
    if first not in _FROM or len(frames) != count or max(frames, default=-1) != first + count - 1:
        return None
    return [known(frames[first + index]) for index in range(count)]


def missing(frames: Mapping[int, Fields], count: int) -> int | None:
    """The first frame that has no fields, counted from the first number of the file; None where all have some."""
    first = min(frames, default=0)
    return next((number for number in range(first, first + count) if number not in frames), None)


def index_times(general: Mapping[str, str], axis: int) -> dict[int, Fields]:
    """Times of a 3D Slicer sequence, which are the values of an axis; empty where it has none."""
    for name, value in general.items():
        match = _TIMES.fullmatch(name)
        if match and int(match[1]) == axis:
            return {index: {"Timestamp": text} for index, text in enumerate(value.split())}
    return {}
