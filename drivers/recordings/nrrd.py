"""Reads and writes tracked-ultrasound sequences as NRRD (`.nrrd`, `.igs.nrrd`), which 3D Slicer and PLUS store beside
MetaImage.

Format: http://teem.sourceforge.net/nrrd/format.html. A text header of `field: value` and `key:=value` lines, closed by
a blank line, then 8-bit pictures, raw or as one gzip stream, in the same file or in another beside it. The keys of each
picture are those of MetaImage.
"""

import re
import shutil
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

from probewatch.drivers.errors import RecordingError
from probewatch.drivers.files.atomic_file import replacing
from probewatch.drivers.files.regular_file import reading, refuse_irregular
from probewatch.drivers.printable import printable
from probewatch.drivers.recordings.keys import (
    FRAME_KEY,
    IMAGE_STATUS,
    IMAGE_TYPE,
    NAMES,
    ORIENTATION,
    contradiction,
    index_times,
    known,
    take,
)
from probewatch.drivers.recordings.metaimage import (
    MAX_HEADER_BYTES,
    MAX_HEADER_LINES,
    MetaImage,
    checked_header,
    unreadable,
)
from probewatch.drivers.recordings.metaimage_writing import SequenceItem, spooled
from probewatch.drivers.recordings.picture_blocks import BLOCK_BYTES
from probewatch.drivers.recordings.unread import beside_layout
from probewatch.drivers.video.crop import FLIPS

MAGIC = b"NRRD"
_GZIP = 31  # window bits of zlib: the largest window, in gzip's wrapping
_GREY = ("uchar", "unsigned char", "uint8", "uint8_t")
_COLOURS = {(size, kind) for size, kinds in (("3", "rgb-color"), ("4", "rgba-color")) for kind in (kinds, "vector")}
"""Size and kind of a first axis that holds the colours of a pixel."""
_MOST_LINE_BYTES = 4_000_000
"""Bytes of a line of the header: 3D Slicer writes the times of all pictures in one line; this many bytes hold eight
hours at 20 Hz."""
_CUT = "It is cut short; copy it again"
_PLANAR_AXES = 3  # of SimpleITK: columns, rows, pictures
_MOST_AXES = 4  # of PLUS and 3D Slicer: a third spatial axis of one plane
_WITH_SPACE = ("data file", "byte skip", "line skip")
"""Fields that NRRD also spells without their space."""
_OWN_WORDS = {
    "ElementType": "type",
    "MET_UCHAR": "uchar",
    "DimSize": "sizes",
    "ElementNumberOfChannels": "the size of the first axis",
    "ElementDataFile": "data file",
    "HeaderSize": "byte skip",
}
"""Words of MetaImage, in which a header is checked → those of NRRD, which its author knows."""
_ITS_WORD = re.compile("|".join(_OWN_WORDS))


def read_nrrd(path: Path, orientation: str | None = None) -> MetaImage:
    """Reads a sequence like read_metaimage. Raises RecordingError naming file, key and remedy."""
    try:
        return _read(path, orientation)
    except RecordingError as error:
        what, remedy = (_ITS_WORD.sub(lambda found: _OWN_WORDS[found[0]], text) for text in (error.what, error.remedy))
        raise RecordingError(what, error.where, remedy) from None


def _read(path: Path, orientation: str | None) -> MetaImage:
    try:
        with reading(path) as stream:
            general, frames = _read_header(stream, path)
            offset = stream.tell()
        encoding = general.get("encoding", "").lower()
        if encoding not in ("raw", "gz", "gzip"):
            what = f"encoding {encoding!r} is neither raw nor gzip"
            raise RecordingError(what, str(path), "Store it as that, in 3D Slicer or with PLUS")
        _refuse_two_spellings(path, general)
        named = general.get("data file", general.get("datafile", "LOCAL"))
        if general.get("line skip", general.get("lineskip", "0")) != "0":
            raise RecordingError("line skip is not 0", str(path), "Store the pictures without a header of their own")
        general = _with_list(general, len(frames))
        frames = frames or _index_times(path, general)
        _refuse_volume(path, general, frames)
        return checked_header(
            path, _as_metaimage(path, general, encoding, named, orientation), frames, offset, orientation, _GZIP
        )
    except OSError as error:
        raise unreadable(path, error) from error


def write_nrrd(
    path: Path, items: Iterable[SequenceItem], size_px: tuple[int, int] | None, *, orientation: str = "MFA"
) -> None:
    """Writes a sequence like write_metaimage, compressed. A sequence of poses only has pictures of one black pixel, as
    PLUS writes it. Pictures have a third spatial axis of one plane: 3D Slicer by itself reads no others, PLUS reads
    either.

    Raises OSError, and ValueError for an image of another size.
    """
    refuse_irregular(path)
    width, height = size_px or (1, 1)
    with tempfile.TemporaryFile(dir=path.parent) as data:
        lines = spooled(data, items, (width, height), _GZIP, FLIPS[orientation[:2]], NAMES[IMAGE_STATUS])
        head = [
            "NRRD0004",
            "type: uchar",
            "dimension: 4",
            "space dimension: 3",
            f"sizes: {width} {height} 1 {lines.count}",
            "space directions: (1,0,0) (0,1,0) (0,0,1) none",
            "kinds: domain domain domain list",
            "encoding: gzip",
            "space origin: (0,0,0)",
            *(f"{name}:={orientation}" for name in NAMES[ORIENTATION]),
            *(f"{name}:=BRIGHTNESS" for name in NAMES[IMAGE_TYPE]),
        ]
        own = [line.replace(" = ", ":=", 1) for line in lines.text]
        data.seek(0)
        with replacing(path) as stream:
            stream.write("\n".join([*head, *own, "\n"]).encode())
            shutil.copyfileobj(data, stream, BLOCK_BYTES)


def _index_times(path: Path, general: dict[str, str]) -> dict[int, dict[str, str]]:
    """Returns the times as index_times does. Raises RecordingError."""
    axis = len(general.get("kinds", "").split()) - 1
    try:
        return index_times(general, axis)
    except ValueError as error:
        what = f"axis {axis} index values are {printable(str(error))}: no times of pictures"
        remedy = "Store the sequence with its times in s (index name time, unit s), as it was recorded"
        raise RecordingError(what, str(path), remedy) from None


def _with_list(general: dict[str, str], count: int) -> dict[str, str]:
    """Makes the last axis the list of pictures where it has as many as the header has frames; SimpleITK, which knows no
    lists, writes a volume with the fields of the frames.
    """
    sizes = general.get("sizes", "").split()
    kinds = general.get("kinds", "").lower().split() or ["domain"] * len(sizes)
    own = kinds[1:] if (sizes[:1], kinds[:1]) in [([size], [kind]) for size, kind in _COLOURS] else kinds
    if not count or sizes[-1:] != [str(count)] or len(own) != _PLANAR_AXES or set(own) - {"domain", "space"}:
        return general
    return {**general, "kinds": " ".join([*kinds[:-1], "list"])}


def _refuse_volume(path: Path, general: dict[str, str], frames: dict[int, dict[str, str]]) -> None:
    """Raises RecordingError for two or three axes of space without a field or a time for any picture."""
    sizes, kinds = general.get("sizes", ""), general.get("kinds", "").lower().split()
    axes = len(sizes.split()) - (kinds[:1] in (["vector"], ["rgb-color"], ["rgba-color"]))
    if not frames and axes in (2, _PLANAR_AXES) and not {"list", "time"} & set(kinds):
        what = f"is a {'volume' if axes == _PLANAR_AXES else 'single picture'} (sizes {sizes}), not a sequence"
        raise RecordingError(what, str(path), "It has neither times nor poses: give the sequence as it was recorded")


def _as_metaimage(
    path: Path, general: dict[str, str], encoding: str, named: str, orientation: str | None
) -> dict[str, str]:
    """Returns the header in the words of MetaImage."""
    axes = list(zip(general.get("sizes", "").split(), general.get("kinds", "").lower().split(), strict=False))
    channels = int(axes.pop(0)[0]) if axes and axes[0] in _COLOURS else 1
    if [kind for _, kind in axes if kind in ("list", "time")] == [] or len(axes) > _MOST_AXES:
        what = f"kinds '{general.get('kinds', '')}' and sizes '{general.get('sizes', '')}' are not those of a sequence"
        raise RecordingError(what, str(path), "Store the whole sequence, as PLUS and 3D Slicer do: domain domain list")
    if axes[-1] in _COLOURS:
        what = f"kinds '{general['kinds']}': its colours are stored as pictures of their own, on the last axis"
        raise RecordingError(what, str(path), "Store the colours of each pixel together: RGB-color as the first axis")
    if axes[0][1] in ("list", "time"):
        what = f"kinds '{general['kinds']}': its pictures are stored pixel by pixel, as older versions of 3D Slicer do"
        raise RecordingError(what, str(path), "Open it in a newer 3D Slicer and save it again, or record with PLUS")
    if any(kind not in ("domain", "space", "list", "time") for _, kind in axes) or axes[-1][1] not in ("list", "time"):
        what = f"kinds '{general['kinds']}' are not domain domain list"
        raise RecordingError(what, str(path), "Record 8-bit grey B-mode pictures, one after the other")
    kind = general.get("type", "").lower()
    own = known(general, path, ORIENTATION if orientation else "")
    return {
        **{name: general[name] for name in beside_layout(general)},
        "DimSize": " ".join(size for size, _ in axes),
        "ElementType": "MET_UCHAR" if kind in _GREY else kind,
        "CompressedData": str(encoding != "raw"),
        "ElementDataFile": named,
        "ElementNumberOfChannels": str(channels),
        "HeaderSize": general.get("byte skip", general.get("byteskip", "0")),
        **{name: value for name, value in own.items() if name == ORIENTATION},
    }


def _read_header(stream: BinaryIO, path: Path) -> tuple[dict[str, str], dict[int, dict[str, str]]]:
    general: dict[str, str] = {}
    frames: dict[int, dict[str, str]] = {}
    for number in range(MAX_HEADER_LINES):
        line = stream.readline(_MOST_LINE_BYTES)
        text = line.decode("utf-8", errors="replace").strip()
        if not text:
            if line or _names_data(general):
                return general, frames
            raise RecordingError("the header does not end", str(path), _CUT)
        if not line.endswith(b"\n") and len(line) < _MOST_LINE_BYTES and not _names_data(general):
            raise RecordingError(f"the header ends within its line {text[:40]!r}", str(path), _CUT)
        if len(line) == _MOST_LINE_BYTES or stream.tell() > MAX_HEADER_BYTES:
            break
        if number and not text.startswith("#"):
            _take(text, path, general, frames)
        if general.get("data file", general.get("datafile", "")).split()[:1] == ["LIST"]:
            what = "data file is LIST: a file for each picture"
            raise RecordingError(what, str(path), "Store all pictures in one file, as 3D Slicer and PLUS do")
    raise RecordingError("the header is longer than any of PLUS", str(path), "Record in shorter parts")


def _refuse_two_spellings(path: Path, general: dict[str, str]) -> None:
    """Raises RecordingError where a field of NRRD is there with and without its space, with different values."""
    for name in _WITH_SPACE:
        joined = name.replace(" ", "")
        if name in general and general.get(joined, general[name]) != general[name]:
            raise contradiction(path, (name, general[name]), (joined, general[joined]))


def _names_data(general: dict[str, str]) -> bool:
    """Returns whether the pictures are in another file, so that the header may end with its file."""
    return "data file" in general or "datafile" in general


def _take(text: str, path: Path, general: dict[str, str], frames: dict[int, dict[str, str]]) -> None:
    key, colon, value = text.partition(":")
    if not colon:
        what = f"header line {text[:40]!r} is neither 'field: value' nor 'key:=value'"
        raise RecordingError(what, str(path), "Give a sequence that 3D Slicer or PLUS has stored")
    key = printable(key.strip())
    if FRAME_KEY.fullmatch(key) and not value.startswith("="):
        what = f"header line {text[:40]!r} has ': ' after its key"
        raise RecordingError(what, str(path), "Write ':=' after every key that is not a field of NRRD itself")
    key, value = (key, value[1:].strip()) if value.startswith("=") else (key.lower(), value.strip())
    take(key, value, path, general, frames)
