"""Captured bytes → grey picture. Luminance is passed on as the device gives it, without stretching its range."""

import re
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from probewatch.drivers.samples import GreyImage

Bytes = NDArray[np.uint8]


_JPEG_BEGINS = re.compile(rb"\xff\xd8\xff(?![\xd8\xd9\xff])")
"""A JPEG that holds something: encoders send empty ones, which end at once, between two pictures."""
_JPEG_MARKER = re.compile(rb"\xff([^\x00\xff])")
_JPEG_BEGIN, _JPEG_ENDS, _JPEG_SCAN = 0xD8, 0xD9, 0xDA
"""Markers SOI, EOI and SOS of ITU-T T.81, table B.1."""
_JPEG_PAUSES = range(0xD0, 0xD8)
"""Markers amid the pixels of a JPEG, after which they go on."""


class BrokenPicture(ValueError):  # noqa: N818  what it is, not an error of ours
    """The bytes are no whole picture of their format."""


def grey(code: str, data: Bytes, width: int, height: int, bytes_per_line: int) -> GreyImage:
    """data: (n,) uint8 as captured → (height, width) uint8, which may share its memory. Raises BrokenPicture."""
    return _DECODERS[code](data, width, height, bytes_per_line)


def _rows(data: Bytes, width_bytes: int, height: int, bytes_per_line: int) -> Bytes:
    """(height, width_bytes) without the padding that ends each line."""
    stride = bytes_per_line or width_bytes
    if stride < width_bytes or data.size < stride * (height - 1) + width_bytes:
        raise BrokenPicture(f"{data.size} bytes are too few for {height} lines of {stride} bytes")
    return np.lib.stride_tricks.as_strided(data, (height, width_bytes), (stride, 1), writeable=False)


def _grey(data: Bytes, width: int, height: int, bytes_per_line: int) -> GreyImage:
    """GREY, and what has its luminance in a first plane: NV12, YU12 and others of their kind."""
    return _rows(data, width, height, bytes_per_line)


def _yuyv(data: Bytes, width: int, height: int, bytes_per_line: int) -> GreyImage:
    """Y0 U Y1 V, or V before U: every second byte."""
    return _rows(data, 2 * width, height, bytes_per_line)[:, ::2]


def _uyvy(data: Bytes, width: int, height: int, bytes_per_line: int) -> GreyImage:
    """U Y0 V Y1, or V before U: every second byte, from the second on."""
    return _rows(data, 2 * width, height, bytes_per_line)[:, 1::2]


def _bgr(data: Bytes, width: int, height: int, bytes_per_line: int) -> GreyImage:
    """B G R by the weights of Rec. 601."""
    rows = _rows(data, 3 * width, height, bytes_per_line)
    return np.asarray(cv2.cvtColor(rows.reshape(height, width, 3), cv2.COLOR_BGR2GRAY), np.uint8)


def _rgb(data: Bytes, width: int, height: int, bytes_per_line: int) -> GreyImage:
    """R G B by the weights of Rec. 601."""
    rows = _rows(data, 3 * width, height, bytes_per_line)
    return np.asarray(cv2.cvtColor(rows.reshape(height, width, 3), cv2.COLOR_RGB2GRAY), np.uint8)


def _bgrx(data: Bytes, width: int, height: int, bytes_per_line: int) -> GreyImage:
    """B G R and a byte that says nothing here, by the weights of Rec. 601."""
    rows = _rows(data, 4 * width, height, bytes_per_line)
    return np.asarray(cv2.cvtColor(rows.reshape(height, width, 4), cv2.COLOR_BGRA2GRAY), np.uint8)


def _mjpeg(data: Bytes, width: int, height: int, _bytes_per_line: int) -> GreyImage:
    """A damaged or cut JPEG is refused, not shown in part. Empty ones before it, and what fills the buffer before and
    behind it, are none of it.
    """
    whole = _whole_jpeg(data.tobytes())
    image = cv2.imdecode(np.frombuffer(whole, np.uint8), cv2.IMREAD_GRAYSCALE) if whole else None
    if image is None:
        raise BrokenPicture("is not a whole JPEG picture")
    if image.shape != (height, width):
        raise BrokenPicture(f"is a JPEG picture of {image.shape[1]}x{image.shape[0]}, not {width}x{height} pixels")
    return np.asarray(image, np.uint8)


def _whole_jpeg(data: bytes) -> bytes:
    """The first JPEG with segments, to its own end; empty where it does not end, or another begins before."""
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
"""In the order of preference: what costs least and loses nothing first."""
