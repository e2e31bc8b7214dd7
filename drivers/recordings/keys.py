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
"""Field → its names; the second is PLUS's in NRRD (vtkPlusSequenceIO). We write both there."""
_TIMES = re.compile(r"axis ([0-9]+) index values")
"""3D Slicer's key for the times of a sequence, s, all in one line."""
_FROM = (0, 1)
"""Numbers of the first frame: PLUS and 3D Slicer count from 0, MATLAB scripts from 1."""

Fields = dict[str, str]


def known(fields: Mapping[str, str]) -> Fields:
    """The fields by the names of here; where a file says one twice, by its own name."""
    first = {name: one for one, names in NAMES.items() for name in names}
    other = {first[name]: value for name, value in fields.items() if name in first and name != first[name]}
    return {**other, **{name: value for name, value in fields.items() if first.get(name, name) == name}}


def from_zero(frames: Mapping[int, Fields], count: int) -> list[Fields] | None:
    """The fields of each frame in order, however they are numbered; None where some are missing or too many."""
    first = min(frames, default=0)
    if first not in _FROM or len(frames) != count or max(frames, default=-1) != first + count - 1:
        return None
    return [known(frames[first + index]) for index in range(count)]


def index_times(general: Mapping[str, str], axis: int) -> dict[int, Fields]:
    """Times of a 3D Slicer sequence, which are the values of an axis; empty where it has none."""
    for name, value in general.items():
        match = _TIMES.fullmatch(name)
        if match and int(match[1]) == axis:
            return {index: {"Timestamp": text} for index, text in enumerate(value.split())}
    return {}
