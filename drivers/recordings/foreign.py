"""Recognises recordings of other programs by their first bytes: what such a file is, and how to make a sequence of
it.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path

from probewatch.drivers.descriptor import FILM_SUFFIXES
from probewatch.drivers.errors import RecordingError
from probewatch.drivers.recordings.advice import POSES_APART

HEAD_BYTES = 352
"""Bytes that are read of a file to know its kind: NIfTI states its own at byte 344, the others before."""
_REAL = re.compile(r"[-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?")
"""A number as programs write it into a header."""
_PICTURE = "Give the whole sequence with its poses, as PLUS records it (.igs.mha or .mhd)"
_VOLUME = "It has neither times nor poses: give the sequence from which it was made"
_REPLAY = "Play it back while PLUS records pictures and poses into .igs.mha"
_BLACK_BOX = "A black box: probewatch replay FILE, or probewatch export it to .igs.mha; a ROS bag: play it into PLUS"
_UNPACK = (
    "Unpack it, and give the recording that is in it, such as .igs.mha or .mhd; save a spreadsheet of poses as CSV"
)
_AS_CSV = "Save its table of poses as CSV (docs/black-box.md has the columns)"

_ARRAYS = "Give arrays to appliance.api.judge (docs/python.md)"
_CONVERT = f"Convert it to MP4 or MKV; {POSES_APART}"

_KINDS = (
    (0, b"#ROSBAG", "a ROS bag", _REPLAY),
    (0, b"\x89MCAP", "a black box or a ROS bag (MCAP)", _BLACK_BOX),
    (0, b"SQLite format 3", "a database, perhaps a ROS bag (db3)", _REPLAY),
    (128, b"DICM", "a DICOM file", "It has no poses: record pictures and poses together with PLUS"),
    (0, b"\x89HDF", "an HDF5 file", "Write its pictures and poses as a PLUS sequence (.igs.mha)"),
    (0, b"MATLAB", "a MATLAB file", "Write its pictures and poses as a PLUS sequence (.igs.mha)"),
    (0, b"\x89PNG", "a single picture (PNG)", _PICTURE),
    (0, b"\xff\xd8\xff", "a single picture (JPEG)", _PICTURE),
    (0, b"\x93NUMPY", "a NumPy array", _ARRAYS),
    (344, b"n+1", "a NIfTI volume", _VOLUME),
    (0, b"\x5c\x01\x00\x00", "a NIfTI volume", _VOLUME),
    (0, b"GIF8", "a GIF", _CONVERT),
    (0, b"BM", "a single picture (BMP)", _PICTURE),
    (0, b"II*\x00", "a TIFF picture", _PICTURE),
    (0, b"MM\x00*", "a TIFF picture", _PICTURE),
    (0, b"II+\x00", "a TIFF picture", _PICTURE),
    (0, b"MM\x00+", "a TIFF picture", _PICTURE),
    (0, b"# vtk DataFile", "a VTK file", _VOLUME),
    (0, b"\x1c\x02\x00\x00", "a NIfTI volume", _VOLUME),
    (0, b"\x80\x04\x95", "a pickle of Python", _ARRAYS),
    (0, b"\x80\x05\x95", "a pickle of Python", _ARRAYS),
    (0, b"{", "a JSON file", "Write its pictures and poses as a PLUS sequence (.igs.mha), or its poses as CSV"),
    (0, b"CDF\x01", "a NetCDF or MINC file", "Write its pictures and poses as a PLUS sequence (.igs.mha)"),
    (0, b"CDF\x02", "a NetCDF or MINC file", "Write its pictures and poses as a PLUS sequence (.igs.mha)"),
    (0, b"\x00\x00\x01\xba", "an MPEG film", _CONVERT),
    (0, b"\x00\x00\x01\xb3", "an MPEG film", _CONVERT),
    (0, b"\x30\x26\xb2\x75", "a Windows Media film (WMV)", _CONVERT),
    (0, b"FLV\x01", "a Flash film (FLV)", _CONVERT),
    (0, b"OggS", "an Ogg film", _CONVERT),
    (0, b"YUV4MPEG2", "a YUV4MPEG film (Y4M)", _CONVERT),
    (0, b"\x06\x0e\x2b\x34", "an MXF film", _CONVERT),
    (0, b"%PDF", "a PDF", _PICTURE),
    (0, b"#Insight Transform", "a transform of ITK", "Give it to calibration import, and here the recording"),
    (0, b"version https://git-lfs", "a pointer of Git LFS, without what it points to", "Fetch the file: git lfs pull"),
    (0, b"<!DOCTYPE html", "a web page", "A download has failed: load the file itself"),
    (0, b"<html", "a web page", "A download has failed: load the file itself"),
    (0, b"<", "an XML file", "Give a device set as --calibration, and here the recording (.igs.mha or .mhd)"),
    (
        0,
        b"PK\x03\x04",
        "a ZIP archive, a spreadsheet (XLSX) or NumPy arrays",
        f"{_UNPACK}; NumPy arrays are for appliance.api",
    ),
    (0, b"\xd0\xcf\x11\xe0", "an Office file (XLS)", _AS_CSV),
    (0, b"\x1f\x8b", "a gzip archive", _UNPACK),
    (0, b"7z\xbc\xaf", "a 7z archive", _UNPACK),
)
"""(offset, first bytes by the format's own definition, what it is, what to do). One more row recognises one more kind
of file."""
_SEQUENCES = (
    (0, b"NRRD", "an NRRD file"),
    (0, b"ObjectType", "a MetaImage"),
    (0, b"\x1aE\xdf\xa3", "a film"),
    (0, b"RIFF", "a film"),
    (4, b"ftyp", "a film"),
)
"""(offset, first bytes, what it is) of what is read as a recording, and is nothing else."""
_PACKETS = ((0, 188), (4, 192))
"""(offset, bytes) of the packets of an MPEG transport stream, each of which begins with a G; a camcorder puts a time of
4 bytes before each."""
_EDITED = (
    (b"\xff\xfe", "UTF-16 text"),
    (b"\xfe\xff", "UTF-16 text"),
    (b"\xef\xbb\xbfNRRD", "an NRRD file behind a byte order mark"),
)
"""(first bytes, what it is) of sequences that a text editor has saved again, so that their pictures are damaged."""


def are_numbers(words: Iterable[str]) -> bool:
    """Returns whether each word is written as one number with a decimal point."""
    return all(map(_REAL.fullmatch, words))


def are_matrix(words: Sequence[str]) -> bool:
    """Returns whether the words are the sixteen numbers of a 4 x 4 matrix."""
    return len(words) == 16 and are_numbers(words)


def refuse_foreign(head: bytes, path: Path) -> None:
    """Refuses a file that is not a recording. head: the first HEAD_BYTES. Raises RecordingError for a kind that is
    known and is not a MetaImage, for an empty file, and for one whose first line is not that of a header.
    """
    if not head:
        raise RecordingError("is empty", str(path), "Copy it again")
    for magic, kind in _EDITED:
        if head.startswith(magic):
            what = f"is {kind}: an editor has saved it anew"
            raise RecordingError(what, str(path), "Give the file as it was recorded")
    refuse_known(head, path, "a PLUS sequence (.igs.mha or .mhd)")
    first = head.lstrip().partition(b"\n")[0]
    if b"=" not in first:
        if b"t_s" in first:
            what = "begins as a table of poses, and its name does not end in .csv"
            raise RecordingError(what, str(path), f"Save it with commas as .csv; {POSES_APART}")
        if path.suffix.lower() in FILM_SUFFIXES:
            raise RecordingError(
                f"is no film: it does not begin as {path.suffix.lower()} does", str(path), "Copy or export it again"
            )
        line = first[:40].decode("utf-8", "replace")
        what = f"is no PLUS sequence: its first line {line!r} is not 'key = value'"
        what = what if line.strip().isprintable() else "is of a kind that is not known here"
        raise RecordingError(
            what, str(path), f"Give a PLUS or 3D Slicer sequence, a film or a black box; {POSES_APART}"
        )


def refuse_known(head: bytes, path: Path, wanted: str) -> None:
    """Raises RecordingError for a kind that is known, and is not what is wanted."""
    for kind, way in _kinds_of(head):
        raise RecordingError(f"is {kind}, not {wanted}", str(path), way)


def kind_of(head: bytes) -> str:
    """Returns the kind of a file by its first HEAD_BYTES, such as "an HDF5 file"; empty if it is not recognised."""
    own = (kind for offset, magic, kind in _SEQUENCES if head[offset:].startswith(magic))
    return next(chain((kind for kind, _ in _kinds_of(head)), own), "")


def _kinds_of(head: bytes) -> Iterator[tuple[str, str]]:
    """Yields (what it is, what to do) of each kind that begins like this."""
    for offset, magic, kind, way in _KINDS:
        if head[offset:].startswith(magic):
            yield kind, way
    if any(head[begin::size][:2] == b"GG" for begin, size in _PACKETS):
        yield "an MPEG transport stream (TS)", _CONVERT
