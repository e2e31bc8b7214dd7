"""Captured bytes → grey picture. Luminance is passed on as the device gives it, without stretching its range."""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.samples import GreyImage

Bytes = NDArray[np.uint8]


_EMPTY, _FILL = b"\xff\xd8\xff\xd9", b"\0\xff"
"""A JPEG of nothing, as encoders send between two pictures; and bytes that fill the rest of a buffer."""


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
    """GREY, and NV12, YU12 and YV12, whose first plane is the luminance."""
    return _rows(data, width, height, bytes_per_line)


def _yuyv(data: Bytes, width: int, height: int, bytes_per_line: int) -> GreyImage:
    """Y0 U Y1 V: every second byte."""
    return _rows(data, 2 * width, height, bytes_per_line)[:, ::2]


def _uyvy(data: Bytes, width: int, height: int, bytes_per_line: int) -> GreyImage:
    """U Y0 V Y1: every second byte, from the second on."""
    return _rows(data, 2 * width, height, bytes_per_line)[:, 1::2]


def _bgr(data: Bytes, width: int, height: int, bytes_per_line: int) -> GreyImage:
    """B G R by the weights of Rec. 601."""
    rows = _rows(data, 3 * width, height, bytes_per_line)
    return np.asarray(cv2.cvtColor(rows.reshape(height, width, 3), cv2.COLOR_BGR2GRAY), np.uint8)


def _rgb(data: Bytes, width: int, height: int, bytes_per_line: int) -> GreyImage:
    """R G B by the weights of Rec. 601."""
    rows = _rows(data, 3 * width, height, bytes_per_line)
    return np.asarray(cv2.cvtColor(rows.reshape(height, width, 3), cv2.COLOR_RGB2GRAY), np.uint8)


def _mjpeg(data: Bytes, width: int, height: int, _bytes_per_line: int) -> GreyImage:
    """A damaged or cut JPEG is refused, not shown in part. Empty ones before and after it, and what fills the buffer,
    are none of it.
    """
    whole = data.tobytes().rstrip(_FILL)
    while whole.endswith(_EMPTY):
        whole = whole.removesuffix(_EMPTY).rstrip(_FILL)
    while whole.startswith(_EMPTY):
        whole = whole.removeprefix(_EMPTY).lstrip(b"\0")
    image = None
    if whole.startswith(b"\xff\xd8") and whole.endswith(b"\xff\xd9"):
        image = cv2.imdecode(np.frombuffer(whole, np.uint8), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise BrokenPicture("is not a whole JPEG picture")
    if image.shape != (height, width):
        raise BrokenPicture(f"is a JPEG picture of {image.shape[1]}x{image.shape[0]}, not {width}x{height} pixels")
    return np.asarray(image, np.uint8)


_DECODERS: dict[str, Callable[[Bytes, int, int, int], GreyImage]] = {
    "GREY": _grey,
    "NV12": _grey,
    "YU12": _grey,
    "YV12": _grey,
    "YUYV": _yuyv,
    "UYVY": _uyvy,
    "RGB3": _rgb,
    "BGR3": _bgr,
    "MJPG": _mjpeg,
}

FORMATS = tuple(_DECODERS)
"""In the order of preference: what costs least and loses nothing first."""
