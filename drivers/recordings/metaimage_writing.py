"""Writes sequences as MetaImage, as PLUS stores them (`metaimage.py` describes the format)."""

import shutil
import tempfile
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import BinaryIO

import numpy as np

from probewatch.drivers.files.atomic_file import replacing
from probewatch.drivers.files.regular_file import refuse_irregular
from probewatch.drivers.recordings.keys import IMAGE_STATUS, IMAGE_TYPE, ORIENTATION
from probewatch.drivers.recordings.picture_blocks import BLOCK_BYTES
from probewatch.drivers.samples import GreyImage, Matrix4
from probewatch.drivers.video.crop import FLIPS


@dataclass(frozen=True, slots=True, eq=False)
class SequenceItem:
    """Represents one entry to write. image: MF-oriented or None. transforms: `<A>To<B>` → (4, 4), None for INVALID."""

    t_ns: int
    image: GreyImage | None = None
    transforms: Mapping[str, Matrix4 | None] = field(default_factory=dict)
    sequence: int | None = None


def write_metaimage(
    path: Path,
    items: Iterable[SequenceItem],
    size_px: tuple[int, int] | None,
    *,
    compressed: bool = True,
    detached: bool = False,
    orientation: str = "MFA",
) -> None:
    """Writes a sequence; path shows the whole of it or does not appear. Images pass through one at a time.

    size_px: (width, height), None for a sequence of poses only. Entries without a picture are marked INVALID. Raises
    OSError, and ValueError for an image of another size.
    """
    data_path = path.with_suffix(".zraw" if compressed else ".raw")
    for place in (path, data_path) if detached else (path,):
        refuse_irregular(place)
    with tempfile.TemporaryFile(dir=path.parent) as data:
        lines = spooled(data, items, size_px, zlib.MAX_WBITS if compressed else None, FLIPS[orientation[:2]])
        head = _general_lines(size_px, lines.count, data.tell() if compressed else None, orientation)
        target = data_path.name if detached else "LOCAL"
        header = "\n".join([*head, *lines.text, f"ElementDataFile = {target}\n"]).encode()
        data.seek(0)
        if detached:
            with replacing(data_path) as stream:
                shutil.copyfileobj(data, stream, BLOCK_BYTES)
        with replacing(path) as stream:
            stream.write(header)
            shutil.copyfileobj(data, stream, BLOCK_BYTES)


@dataclass(slots=True)
class HeaderLines:
    """Holds the lines of the entries, `key = value`, and the number of entries."""

    text: list[str] = field(default_factory=list)
    count: int = 0


def spooled(
    data: BinaryIO,
    items: Iterable[SequenceItem],
    size_px: tuple[int, int] | None,
    window_bits: int | None,
    flips: tuple[bool, bool],
    status_names: tuple[str, ...] = (IMAGE_STATUS,),
) -> HeaderLines:
    """Writes the pictures to data, compressed where window_bits gives a format, and returns the header lines of the
    entries.

    status_names: keys that state whether a picture is valid.
    """
    lines = HeaderLines()
    deflator = None if window_bits is None else zlib.compressobj(6, zlib.DEFLATED, window_bits)
    for item in items:
        lines.text += _item_lines(lines.count, item, status_names)
        lines.count += 1
        block = b"" if size_px is None else _stored(item.image, size_px, flips)
        data.write(deflator.compress(block) if deflator else block)
    if deflator:
        data.write(deflator.flush())
    return lines


def _stored(image: GreyImage | None, size_px: tuple[int, int], flips: tuple[bool, bool]) -> bytes:
    width, height = size_px
    if image is None:
        return bytes(width * height)
    if image.shape != (height, width) or image.dtype != np.uint8:
        raise ValueError(f"image is {image.shape} {image.dtype}, the sequence {(height, width)} uint8")
    rows, columns = (slice(None, None, -1 if flip else 1) for flip in flips)
    return image[rows, columns].tobytes()


def _item_lines(index: int, item: SequenceItem, status_names: tuple[str, ...]) -> list[str]:
    prefix = f"Seq_Frame{index:04d}_"
    lines = [] if item.sequence is None else [f"{prefix}FrameNumber = {item.sequence}"]
    for name, matrix in item.transforms.items():
        numbers = " ".join(f"{value:.17g}" for value in (np.eye(4) if matrix is None else matrix).ravel())
        lines.append(f"{prefix}{name}Transform = {numbers}")
        lines.append(f"{prefix}{name}TransformStatus = {'INVALID' if matrix is None else 'OK'}")
    lines.append(f"{prefix}Timestamp = {Decimal(item.t_ns).scaleb(-9):f}")
    lines += [f"{prefix}{name} = {'INVALID' if item.image is None else 'OK'}" for name in status_names]
    return lines


def _general_lines(
    size_px: tuple[int, int] | None, count: int, compressed_bytes: int | None, orientation: str
) -> list[str]:
    width, height = size_px or (0, 0)
    compression = [f"CompressedData = {compressed_bytes is not None}"]
    if compressed_bytes is not None:
        compression.append(f"CompressedDataSize = {compressed_bytes}")
    return [
        "ObjectType = Image",
        "NDims = 3",
        "BinaryData = True",
        "BinaryDataByteOrderMSB = False",
        *compression,
        f"DimSize = {width} {height} {count}",
        "Kinds = domain domain list",
        "ElementSpacing = 1 1 1",
        f"ElementType = {'MET_OTHER' if size_px is None else 'MET_UCHAR'}",
        f"{ORIENTATION} = {orientation if size_px else 'XX'}",
        f"{IMAGE_TYPE} = BRIGHTNESS",
    ]
