"""Opens a stored sequence of pictures, poses or both: a table by the suffix of its name, any other kind by its first
bytes.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from probewatch.drivers.files.regular_file import reading
from probewatch.drivers.recordings.film import Film
from probewatch.drivers.recordings.metaimage import read_metaimage, unreadable
from probewatch.drivers.recordings.nrrd import MAGIC, read_nrrd
from probewatch.drivers.recordings.pose_table import PoseTable
from probewatch.drivers.samples import GreyImage
from probewatch.drivers.trackers.plus_transform import TransformReading

_HEAD_BYTES = 12
_FILMS = ((4, b"ftyp"), (0, b"RIFF"), (0, b"\x1a\x45\xdf\xa3"), (4, b"moov"))
"""(offset, bytes) by which MP4 and MOV, AVI, MKV and WebM are recognised, from the formats' own definitions."""


class Sequence(Protocol):
    """Represents entries by index, each with a time, and with a picture, transforms or both. The methods are those of
    MetaImage.
    """

    @property
    def path(self) -> Path: ...

    @property
    def size_px(self) -> tuple[int, int] | None:
        """Returns (width, height) of the pictures, None where there are none."""
        ...

    def __len__(self) -> int: ...

    def transform_names(self) -> list[str]: ...

    def misnamed(self) -> list[str]:
        """Returns the names of fields whose content may be a transform, but whose name is not that of one."""
        ...

    def stamp_ns(self, index: int) -> int: ...

    def sequence(self, index: int) -> int: ...

    def image_ok(self, index: int) -> bool: ...

    def transform(self, index: int, name: str) -> TransformReading: ...

    def pictures(self) -> Iterator[GreyImage]: ...


def read_sequence(path: Path, orientation: str | None = None) -> Sequence:
    """Returns the sequence, with its header checked; its pictures stay on the disk. Raises RecordingError."""
    if path.suffix.lower() == ".csv":
        return PoseTable(path)
    try:
        with reading(path) as stream:
            head = stream.read(_HEAD_BYTES)
    except OSError as error:
        raise unreadable(path, error) from error
    if head.startswith(MAGIC):
        return read_nrrd(path, orientation)
    if any(head[offset:].startswith(magic) for offset, magic in _FILMS):
        return Film(path, orientation)
    return read_metaimage(path, orientation)
