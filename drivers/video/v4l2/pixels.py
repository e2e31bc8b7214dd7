"""Converts captured bytes into a grey picture. Luminance is passed on as it comes, without stretching its range."""

import re
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from probewatch.drivers.samples import GreyImage

Bytes = NDArray[np.uint8]


_JPEG_BEGINS = re.compile(rb"\xff\xd8\xff(?![\xd8\xd9\xff])")
"""Matches the start of a JPEG with content: encoders send empty ones, which end at once, between two pictures."""
_JPEG_MARKER = re.compile(rb"\xff([^\x00\xff])")
_JPEG_BEGIN, _JPEG_ENDS, _JPEG_SCAN = 0xD8, 0xD9, 0xDA
"""Markers SOI, EOI and SOS of ITU-T T.81, table B.1."""
_JPEG_PAUSES = range(0xD0, 0xD8)
"""Markers within the pixels of a JPEG, after which the pixels continue."""


class BrokenPicture(ValueError):  # noqa: N818  a state of the picture, not an error of ours
    """Reports that the bytes are no whole picture of their format."""


def grey(code: str, data: Bytes, width: int, height: int, bytes_per_line: int) -> GreyImage:
    """Converts data, (n,) uint8 as captured, into a picture (height, width) uint8, which may share its memory. Raises
    BrokenPicture.
    """
    return _DECODERS[code](data, width, height, bytes_per_line)


def _rows(data: Bytes, width_bytes: int, height: int, bytes_per_line: int) -> Bytes:
    """Returns (height, width_bytes) without the padding that ends each line. Raises BrokenPicture for too few bytes."""
    stride = bytes_per_line or width_bytes
    if stride < width_bytes or data.size < stride * (height - 1) + width_bytes:
        raise BrokenPicture(f"{data.size} bytes are too few for {height} lines of {stride} bytes")
    return np.lib.stride_tricks.as_strided(data, (height, width_bytes), (stride, 1), writeable=False)


def _grey(data: Bytes, width: int, height: int, bytes_per_line: int) -> GreyImage:
    """Decodes GREY, and formats with luminance in a first plane: NV12, YU12 and others of their kind."""
    return _rows(data, width, height, bytes_per_line)


def _yuyv(data: Bytes, width: int, height: int, bytes_per_line: int) -> GreyImage:
    """Decodes Y0 U Y1 V, or V before U: every second byte."""
    return _rows(data, 2 * width, height, bytes_per_line)[:, ::2]


def _uyvy(data: Bytes, width: int, height: int, bytes_per_line: int) -> GreyImage:
    """Decodes U Y0 V Y1, or V before U: every second byte, from the second on."""
    return _rows(data, 2 * width, height, bytes_per_line)[:, 1::2]


def _bgr(data: Bytes, width: int, height: int, bytes_per_line: int) -> GreyImage:
    """Decodes B G R by the weights of Rec. 601."""
    rows = _rows(data, 3 * width, height, bytes_per_line)
    return np.asarray(cv2.cvtColor(rows.reshape(height, width, 3), cv2.COLOR_BGR2GRAY), np.uint8)


def _rgb(data: Bytes, width: int, height: int, bytes_per_line: int) -> GreyImage:
    """Decodes R G B by the weights of Rec. 601."""
    rows = _rows(data, 3 * width, height, bytes_per_line)
    return np.asarray(cv2.cvtColor(rows.reshape(height, width, 3), cv2.COLOR_RGB2GRAY), np.uint8)


def _bgrx(data: Bytes, width: int, height: int, bytes_per_line: int) -> GreyImage:
    """Decodes B G R and a byte without meaning here, by the weights of Rec. 601."""
    rows = _rows(data, 4 * width, height, bytes_per_line)
    return np.asarray(cv2.cvtColor(rows.reshape(height, width, 4), cv2.COLOR_BGRA2GRAY), np.uint8)


def _mjpeg(data: Bytes, width: int, height: int, _bytes_per_line: int) -> GreyImage:
    """Decodes a JPEG. A damaged or truncated one is refused, not shown in part. Empty JPEGs before it, and what fills
    the buffer before and after it, are no part of it.
    """
    whole = _whole_jpeg(data.tobytes())
    image = cv2.imdecode(np.frombuffer(whole, np.uint8), cv2.IMREAD_GRAYSCALE) if whole else None
    if image is None:
        raise BrokenPicture("is not a whole JPEG picture")
    if image.shape != (height, width):
        raise BrokenPicture(f"is a JPEG picture of {image.shape[1]}x{image.shape[0]}, not {width}x{height} pixels")
    return np.asarray(image, np.uint8)


def _whole_jpeg(data: bytes) -> bytes:
    """Returns the first JPEG with segments, to its own end; empty where it does not end, or another begins first."""
    begun = _JPEG_BEGINS.search(data)
    if begun is None:
        return b""
    start, at, scanned = begun.start(), begun.start() + 2, False
    while (found := _JPEG_MARKER.search(data, at)) is not None:
        marker, at = found[1][0], found.end()
        if marker == _JPEG_ENDS:
            return data[start:at] if scanned else b""
        if marker in _JPEG_PAUSES:
            continue
        if marker == _JPEG_BEGIN:
            return b""
        scanned |= marker == _JPEG_SCAN
        at += int.from_bytes(data[at : at + 2], "big")
    return b""


_DECODERS: dict[str, Callable[[Bytes, int, int, int], GreyImage]] = {
    **dict.fromkeys(("GREY", "NV12", "NV21", "YU12", "YV12", "NV16", "NV61", "422P"), _grey),
    **dict.fromkeys(("YUYV", "YVYU"), _yuyv),
    **dict.fromkeys(("UYVY", "VYUY"), _uyvy),
    "RGB3": _rgb,
    "BGR3": _bgr,
    **dict.fromkeys(("XR24", "AR24", "BGR4"), _bgrx),
    **dict.fromkeys(("MJPG", "JPEG"), _mjpeg),
}

FORMATS = tuple(_DECODERS)
"""Formats in the order of preference: what costs least and loses nothing comes first."""
