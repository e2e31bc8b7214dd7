"""Reads tracked-ultrasound sequences of PLUS: MetaImage `.mha` and `.mhd`, one header entry per frame and field.

Format: a text header of `key = value` lines, closed by ElementDataFile, then 8-bit pictures frame after frame, raw or
as one zlib stream, in the same file (LOCAL) or in another beside it. Per frame `Seq_FrameNNNN_` Timestamp (s),
FrameNumber, <A>To<B>Transform (4×4, row-major, mm), its Status, ImageStatus.
"""

import os
import re
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import BinaryIO

import numpy as np

from probewatch.drivers.errors import RecordingError
from probewatch.drivers.files.markup import numbers_of
from probewatch.drivers.files.regular_file import reading, refuse_irregular
from probewatch.drivers.printable import printable
from probewatch.drivers.recordings.foreign import HEAD_BYTES, are_matrix, are_numbers, refuse_foreign
from probewatch.drivers.recordings.keys import IMAGE_STATUS, ORIENTATION, from_zero, known, missing, take
from probewatch.drivers.recordings.picture_blocks import inflated, raw
from probewatch.drivers.recordings.unread import beside_layout
from probewatch.drivers.samples import GreyImage, Matrix4, PoseStatus
from probewatch.drivers.trackers.plus_transform import GOOD, TransformReading, rigid_reading, without_matrix
from probewatch.drivers.video.crop import FLIPS
from probewatch.drivers.video.grey import CHANNELS, grey_of

MAX_LINE_BYTES = 65_536
"""Bytes of a line of the header; those of PLUS take some hundred. A higher limit would read further in a file that has
no lines, and no header."""

_MAX_SIDE_PX, MAX_PIXELS = 16_384, 1 << 24
"""Size of one picture, which is in memory two or three times: the largest screen that scanners have, twice."""

MAX_HEADER_LINES, MAX_HEADER_BYTES = 2_000_000, 256_000_000
"""All of the header is kept, some 500 bytes a line; PLUS writes about ten lines and 1 kB a frame: an hour and more."""

MAX_STAMP_S = 9_000_000_000
"""Seconds whose nanoseconds still fit 64 bits; Unix time gets there in the year 2255."""

_CHANNELS, _SKIPPED = "ElementNumberOfChannels", "HeaderSize"
_DECIMAL_COMMA = re.compile(r"[+-]?[0-9]+,[0-9]+")
"""A number as spreadsheets and programs write it in countries with a decimal comma."""
_WITHOUT_LAST_ROW = 12
"""Number of values of a matrix without 0 0 0 1."""


@dataclass(frozen=True, slots=True)
class MetaImage:
    """Represents the checked header of one sequence; pictures are read only when asked for.

    size_px: (width, height), None where the sequence holds no pictures. frames: the fields of each entry, in order.
    orientation: as stored, two letters. unread: fields of the header that nothing reads.
    """

    path: Path
    size_px: tuple[int, int] | None
    frames: tuple[Mapping[str, str], ...]
    orientation: str
    _data_path: Path
    _data_offset: int
    _compressed: bool
    _window_bits: int = zlib.MAX_WBITS
    _channels: int = 1
    unread: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.frames)

    def transform_names(self) -> list[str]:
        """Returns the sorted `<A>To<B>` of every transform that occurs in the sequence."""
        keys = {key for fields in self.frames for key in fields if key.endswith("Transform")}
        return sorted(key.removesuffix("Transform") for key in keys)

    def misnamed(self) -> list[str]:
        """Returns the sorted names of fields with sixteen numbers that do not end in Transform; PLUS does not take them
        for transforms either.
        """
        first = self.frames[0] if self.frames else {}
        return sorted(key for key, text in first.items() if not key.endswith("Transform") and are_matrix(text.split()))

    def stamp_ns(self, index: int) -> int:
        """Returns the stamp, ns by the recording's clock. Raises RecordingError where it is missing or not a time."""
        key, text = self._entry(index, "Timestamp")
        try:
            seconds = Decimal(text)
        except InvalidOperation:
            seconds = Decimal("NaN")
        if not seconds.is_finite() or not -MAX_STAMP_S <= seconds <= MAX_STAMP_S:
            remedy = _likely_unit(seconds) if seconds.is_finite() else "Write it in seconds, such as 12.345"
            remedy = "Write it with a decimal point" if _DECIMAL_COMMA.fullmatch(text) else remedy
            raise _refusal(self.path, key, f"{text!r} is not a time in seconds", remedy)
        return round(seconds * 1_000_000_000)

    def sequence(self, index: int) -> int:
        """Returns the device's FrameNumber, or the index where the file has none. Raises RecordingError."""
        if "FrameNumber" not in self.frames[index]:
            return index
        key, text = self._entry(index, "FrameNumber")
        return _integer(self.path, key, text)

    def image_ok(self, index: int) -> bool:
        """Returns whether the recorder has not marked the picture as invalid."""
        return self.frames[index].get(IMAGE_STATUS, "OK").upper() == "OK"

    def transform(self, index: int, name: str) -> TransformReading:
        """Returns the transform `name` of one entry. Raises RecordingError for text that is not sixteen numbers."""
        status = self.frames[index].get(f"{name}TransformStatus", "OK").upper()
        if status not in GOOD:
            return without_matrix(status, name)
        if f"{name}Transform" not in self.frames[index]:
            return TransformReading(None, PoseStatus.MISSING, f"{name} is missing")
        key, text = self._entry(index, f"{name}Transform")
        return rigid_reading(_sixteen_numbers(self.path, key, text), name)

    def pictures(self) -> Iterator[GreyImage]:
        """Yields each picture in turn, (height, width), MF-oriented; one frame is in memory. Raises RecordingError."""
        if self.size_px is None:
            return
        width, height = self.size_px
        flip_rows, flip_columns = FLIPS[self.orientation]
        rows, columns = slice(None, None, -1 if flip_rows else 1), slice(None, None, -1 if flip_columns else 1)
        for block in self._blocks(width * height * self._channels):
            stored = np.frombuffer(block, np.uint8).reshape(height, width, self._channels)
            yield np.ascontiguousarray(grey_of(stored)[rows, columns])

    def _entry(self, index: int, name: str) -> tuple[str, str]:
        key = f"Seq_Frame{index:04d}_{name}"
        if name not in self.frames[index]:
            raise _refusal(self.path, key, "is missing", "Record again; every frame needs it")
        return key, self.frames[index][name]

    def _blocks(self, frame_bytes: int) -> Iterator[bytes]:
        try:
            with reading(self._data_path) as stream:
                stream.seek(self._data_offset)
                if self._compressed:
                    inflator = zlib.decompressobj(self._window_bits)
                    yield from inflated(inflator, stream, self._data_path, len(self.frames), frame_bytes)
                else:
                    yield from raw(stream, self._data_path, len(self.frames), frame_bytes)
        except OSError as error:
            raise unreadable(self._data_path, error) from error


def read_metaimage(path: Path, orientation: str | None = None) -> MetaImage:
    """Reads and checks the header of a sequence; the pictures stay on the disk.

    orientation: two or three letters that replace UltrasoundImageOrientation where the file has none or a wrong one.
    Raises RecordingError naming file, key, value and remedy for every header that fails a check.
    """
    try:
        with reading(path) as stream:
            refuse_foreign(stream.read(HEAD_BYTES), path)
            stream.seek(0)
            general, frames = _read_header(stream, path)
            offset = stream.tell()
        return checked_header(path, general, frames, offset, orientation)
    except OSError as error:
        raise unreadable(path, error) from error


def _refusal(path: Path, key: str, what: str, remedy: str) -> RecordingError:
    return RecordingError(f"{key} {what}", str(path), remedy)


def unreadable(path: Path, error: OSError) -> RecordingError:
    where = str(error.filename or path)
    is_folder = isinstance(error, IsADirectoryError)
    remedy = "Name a recording in it" if is_folder else "Check the name and the permissions"
    return RecordingError(f"cannot be read: {error.strerror}", where, remedy)


def _read_header(stream: BinaryIO, path: Path) -> tuple[dict[str, str], dict[int, dict[str, str]]]:
    general: dict[str, str] = {}
    frames: dict[int, dict[str, str]] = {}
    lines = 0
    while "ElementDataFile" not in general:
        lines += 1
        if lines > MAX_HEADER_LINES or (lines % 1000 == 0 and stream.tell() > MAX_HEADER_BYTES):
            raise RecordingError("the header is longer than any of PLUS", str(path), "Record in shorter parts")
        key, value = _header_line(stream, path)
        if key:
            take(key, value, path, general, frames)
    return general, frames


def _header_line(stream: BinaryIO, path: Path) -> tuple[str, str]:
    """Returns the next (key, value); both are empty for a blank line."""
    line = stream.readline(MAX_LINE_BYTES)
    text = line.decode("utf-8-sig", errors="replace").strip()
    key, equals, value = text.partition("=")
    if len(line) == MAX_LINE_BYTES or (line.endswith(b"\n") and text and not equals):
        what = f"header line {text[:40]!r} is not 'key = value'"
        raise RecordingError(what, str(path), "Give a PLUS sequence (.igs.mha or .mhd)")
    if not line.endswith(b"\n") and not equals:
        raise RecordingError("the header ends before ElementDataFile", str(path), "It is cut short; copy it again")
    return printable(key.strip()), value.strip()


def checked_header(
    path: Path,
    general: dict[str, str],
    frames: dict[int, dict[str, str]],
    offset: int,
    orientation: str | None,
    window_bits: int = zlib.MAX_WBITS,
) -> MetaImage:
    """Returns a sequence by the fields of its header, in the names of MetaImage; its pictures begin at offset, or in
    the file that ElementDataFile names, beside it. window_bits: as zlib has them for compressed pictures. Raises
    RecordingError, OSError.
    """
    general = known(general, path, ORIENTATION if orientation else "")
    channels = _integer(path, _CHANNELS, general.get(_CHANNELS, "1"))
    width, height, count = _dimensions(path, general)
    if not count:
        raise RecordingError("holds no frames", str(path), "Record again, or give another file")
    entries = _entries(path, frames, count, (width, height))
    local = general["ElementDataFile"].upper() == "LOCAL"
    skipped = _integer(path, _SKIPPED, general.get(_SKIPPED, "0"))
    data_path = path if local else _beside(path, general["ElementDataFile"])
    compressed = general.get("CompressedData", "False").upper() == "TRUE"
    sequence = MetaImage(
        path=path,
        size_px=(width, height) if width * height > 1 else None,
        frames=tuple(entries),
        orientation=(orientation or general.get(ORIENTATION, "")).upper()[:2],
        _data_path=data_path,
        _data_offset=offset if local else max(0, skipped),
        _compressed=compressed,
        _window_bits=window_bits,
        _channels=channels,
        unread=beside_layout(general),
    )
    if sequence.size_px is None:
        return sequence
    if skipped and (local or compressed or skipped < -1):
        raise _refusal(path, _SKIPPED, f"is {skipped}, which is read of pictures in a .raw file alone", "Leave it out")
    _check_pictures(sequence, general, orientation)
    if skipped == -1:
        sequence = replace(sequence, _data_offset=_from_the_end(sequence))
    _check_length(sequence, general)
    return sequence


def _from_the_end(sequence: MetaImage) -> int:
    """Returns the offset of pictures that end with their file, whatever another program has put before them."""
    refuse_irregular(sequence._data_path)
    return max(0, sequence._data_path.stat().st_size - _bytes_of(sequence))


def _bytes_of(sequence: MetaImage) -> int:
    """Returns the size of all pictures, not compressed."""
    assert sequence.size_px is not None
    width, height = sequence.size_px
    return width * height * sequence._channels * len(sequence.frames)


def _entries(path: Path, frames: dict[int, dict[str, str]], count: int, sides: tuple[int, int]) -> list[dict[str, str]]:
    """Returns the fields of each frame. sides: width and height as the header has them."""
    entries = from_zero(frames, count, path)
    if entries is not None:
        return entries
    if not frames:
        what = f"says {count} pictures, and none of them has a field of its own (Seq_Frame0000_Timestamp …)"
        raise _refusal(path, "DimSize", what, "It is a volume, or lost its times: give the sequence as it was recorded")
    numbers = f"{min(frames)} to {max(frames)}"
    if len(frames) == count and max(frames) - min(frames) == count - 1:
        what = f"numbers its {count} frames from {numbers}"
        raise RecordingError(f"the header {what}", str(path), "Number them from 0, as PLUS does, or from 1")
    gap = missing(frames, count)
    if len(frames) == count:
        what = f"numbers its {count} frames from {numbers}, without {gap}"
        raise RecordingError(f"the header {what}", str(path), "Number them one after the other, from 0 or from 1")
    what = f"says {count} frames, the header has fields of {len(frames)}, numbered {numbers}"
    if len(frames) in sides and max(frames) - min(frames) == len(frames) - 1:
        what = f"has the {len(frames)} frames not as its last number, which is {count}"
        remedy = "Write columns, rows, frames; a NumPy array has them the other way round"
        raise _refusal(path, "DimSize", what, remedy)
    if len(frames) < count and gap is not None and gap < max(frames):
        raise _refusal(path, "DimSize", f"{what}, none of frame {gap}", "Give that frame its fields, or record again")
    raise _refusal(path, "DimSize", what, "The header is cut or was edited; copy the file again")


def _beside(path: Path, name: str) -> Path:
    """Returns the file of the pictures, in the folder of the header: a header from elsewhere could name any file of
    this computer, whose bytes would be shown as pictures in a report that is passed on.
    """
    if name.split()[:1] == ["LIST"] or "%" in name:
        what = f"is {name[:60]!r}: a file for each picture"
        raise _refusal(path, "ElementDataFile", what, "Store all pictures in one file, as PLUS does")
    name = name.removeprefix("./")
    key, remedy = "ElementDataFile", "Put the file with the pictures beside the header, and name it without a folder"
    if "/" in name or "\\" in name or name in ("", ".", ".."):
        raise _refusal(path, key, f"{name[:60]!r} is not the name of a file beside the header", remedy)
    place = path.parent / name
    if "\0" not in name and Path(os.path.realpath(place)).parent != Path(os.path.realpath(path.parent)):
        raise _refusal(path, key, f"{name[:60]!r} is a link that leads out of the folder of the header", remedy)
    return place


def _dimensions(path: Path, general: dict[str, str]) -> tuple[int, int, int]:
    """Returns (width, height, frames); a third spatial axis is accepted where it has one plane."""
    if "DimSize" not in general:
        raise _refusal(path, "DimSize", "is missing", "The header is cut or was edited; copy the file again")
    text = general["DimSize"]
    sizes = [_integer(path, "DimSize", word) for word in text.split()]
    if len(sizes) == 4 and sizes[2] == 1:
        del sizes[2]
    if len(sizes) != 3 or min(sizes) < 0 or max(sizes[:2]) > _MAX_SIDE_PX:
        what = f"{text!r} is not width, height and number of frames"
        raise _refusal(path, "DimSize", what, "Give a sequence of two-dimensional pictures")
    if sizes[0] * sizes[1] > MAX_PIXELS:
        what = f"says {sizes[0]} × {sizes[1]} pixels; more than {MAX_PIXELS} are no picture of a scanner"
        raise _refusal(path, "DimSize", what, "Record again, or cut the pictures")
    return sizes[0], sizes[1], sizes[2]


def _check_pictures(sequence: MetaImage, general: dict[str, str], orientation: str | None) -> None:
    grey = "Record 8-bit grey B-mode pictures (MET_UCHAR, one channel), or convert all of them alike"
    for key, allowed, remedy in (
        ("ElementType", "MET_UCHAR", grey),
        ("BinaryData", "True", "Store the pictures as binary data"),
    ):
        value = general.get(key, "" if key == "ElementType" else allowed)
        if value.upper() != allowed.upper():
            raise _refusal(sequence.path, key, f"is {value!r}, not {allowed}", remedy)
    if sequence._channels not in CHANNELS:
        what = f"is {sequence._channels}, not 1, 3 (RGB) or 4 (RGBA)"
        raise _refusal(sequence.path, _CHANNELS, what, grey)
    named = orientation or general.get(ORIENTATION, "")
    if named.upper() not in {two + three for two in FLIPS for three in ("", "A", "D")}:
        what = f"{named!r} is not M or U, then F or N" if named else "is missing"
        remedy = "State how the pictures are stored, for example MF, in the header or with --orientation"
        raise _refusal(sequence.path, ORIENTATION, what, remedy)


def _check_length(sequence: MetaImage, general: dict[str, str]) -> None:
    """Detects a file that was cut before any picture is read."""
    refuse_irregular(sequence._data_path)
    there = sequence._data_path.stat().st_size - sequence._data_offset
    needed = _bytes_of(sequence)
    key = "DimSize"
    if sequence._compressed:
        key = "CompressedDataSize"
        needed = _integer(sequence.path, key, general.get(key, str(there)))
    wrong = there < needed if sequence._compressed else there != needed
    if wrong or needed < 0:
        what = f"promises {needed} bytes of pictures, {sequence._data_path.name} has {there}"
        remedy = "The file is cut short or was edited; copy it again"
        if there > needed >= 0 and not sequence._compressed:
            remedy = "Correct DimSize, or say by HeaderSize how many bytes stand before the pictures"
        raise _refusal(sequence.path, key, what, remedy)


def _integer(path: Path, key: str, text: str) -> int:
    if not re.fullmatch(r"[+-]?[0-9]{1,18}", text):
        raise _refusal(path, key, f"{text[:60]!r} is not a whole number", "Record again, or fix this line")
    return int(text)


def _sixteen_numbers(path: Path, key: str, text: str) -> Matrix4:
    try:
        return np.array(numbers_of(text)).reshape(4, 4)
    except ValueError:
        raise _refusal(path, key, f"{text[:60]!r} is not sixteen numbers", _how_sixteen(text)) from None


def _how_sixteen(text: str) -> str:
    """Returns what to do about a matrix in another form."""
    words = text.split()
    if words and all(_DECIMAL_COMMA.fullmatch(word) or are_numbers([word]) for word in words) and "," in text:
        return "Write it with decimal points"
    bare = re.sub(r"[\[\](){},;]", " ", text)
    if bare != text and are_matrix(bare.split()):
        return "Write blanks alone between the numbers, no brackets, commas or semicolons"
    if len(words) == _WITHOUT_LAST_ROW and are_numbers(words):
        return "It has 12: append the last row, 0 0 0 1"
    return "Record again, or fix this line"


def _likely_unit(time: Decimal) -> str:
    """Returns what to do about a time that is too large to be one in seconds."""
    units = (("ms", 1000), ("µs", 1_000_000), ("ns", 1_000_000_000))
    likely = (f"Is it in {unit}? Divide by {per_s}" for unit, per_s in units if time.copy_abs() <= MAX_STAMP_S * per_s)
    return next(likely, "Record again, or fix this line")
