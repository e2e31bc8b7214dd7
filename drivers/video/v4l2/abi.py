"""Defines the structures and request numbers of the kernel's V4L2 interface, as far as capture through mapped buffers
needs them.

Source: linux/videodev2.h of the kernel's user interface; the tests compare sizes, offsets and numbers with the
compiler's. Names are the kernel's without the prefix v4l2_.
"""

from ctypes import Array, LittleEndianStructure, Structure, c_int, c_int64, c_long, c_uint8, c_uint32, c_uint64, sizeof
from typing import ClassVar

from probewatch.drivers.printable import printable, printable_bytes

_WRITE, _READ = 1, 2
"""Linux, asm-generic/ioctl.h: direction bits of a request number."""

BUF_TYPE_VIDEO_CAPTURE = 1
MEMORY_MMAP = 1
CAP_VIDEO_CAPTURE, CAP_VIDEO_CAPTURE_MPLANE, CAP_STREAMING = 0x1, 0x1000, 0x04000000
CAP_TIMEPERFRAME = 0x1000
FIELD_ANY, FIELD_NONE, FIELD_INTERLACED, FIELD_ALTERNATE = 0, 1, 4, 7
BUF_FLAG_ERROR = 0x40
BUF_FLAG_TIMESTAMP_MASK, BUF_FLAG_TIMESTAMP_MONOTONIC = 0xE000, 0x2000
BUF_FLAG_TSTAMP_SRC_MASK, BUF_FLAG_TSTAMP_SRC_SOE = 0x70000, 0x10000
EVENT_EOS, EVENT_SOURCE_CHANGE = 2, 5
IN_CAP_DV_TIMINGS = 0x2
IN_ST_NO_POWER, IN_ST_NO_SIGNAL, IN_ST_NO_H_LOCK, IN_ST_NO_V_LOCK, IN_ST_NO_SYNC = 0x1, 0x2, 0x100, 0x400, 0x10000
"""Numbers of linux/videodev2.h, compared with the compiler's by tests/drivers/video/v4l2/test_abi.py."""


class Capability(Structure):
    _fields_: ClassVar = [
        ("driver", c_uint8 * 16),
        ("card", c_uint8 * 32),
        ("bus_info", c_uint8 * 32),
        ("version", c_uint32),
        ("capabilities", c_uint32),
        ("device_caps", c_uint32),
        ("reserved", c_uint32 * 3),
    ]


class FmtDesc(Structure):
    _fields_: ClassVar = [
        ("index", c_uint32),
        ("type", c_uint32),
        ("flags", c_uint32),
        ("description", c_uint8 * 32),
        ("pixelformat", c_uint32),
        ("mbus_code", c_uint32),
        ("reserved", c_uint32 * 3),
    ]


class PixFormat(Structure):
    _fields_: ClassVar = [
        ("width", c_uint32),
        ("height", c_uint32),
        ("pixelformat", c_uint32),
        ("field", c_uint32),
        ("bytesperline", c_uint32),
        ("sizeimage", c_uint32),
        ("colorspace", c_uint32),
        ("priv", c_uint32),
        ("flags", c_uint32),
        ("ycbcr_enc", c_uint32),
        ("quantization", c_uint32),
        ("xfer_func", c_uint32),
    ]


class Format(Structure):
    """Represents v4l2_format. The kernel's union holds pointers, so it begins at a multiple of their size."""

    _fields_: ClassVar = [
        ("type", c_uint32),
        ("_align", c_long * 0),
        ("pix", PixFormat),
        ("_rest", c_uint8 * (200 - sizeof(PixFormat))),
    ]


class RequestBuffers(Structure):
    _fields_: ClassVar = [
        ("count", c_uint32),
        ("type", c_uint32),
        ("memory", c_uint32),
        ("capabilities", c_uint32),
        ("flags", c_uint8),
        ("reserved", c_uint8 * 3),
    ]


class Buffer(Structure):
    """Represents v4l2_buffer. timestamp_s, timestamp_us: the timeval. offset: the member of the union m that mapped
    memory uses.
    """

    _fields_: ClassVar = [
        ("index", c_uint32),
        ("type", c_uint32),
        ("bytesused", c_uint32),
        ("flags", c_uint32),
        ("field", c_uint32),
        ("timestamp_s", c_long),
        ("timestamp_us", c_long),
        ("timecode", c_uint32 * 4),
        ("sequence", c_uint32),
        ("memory", c_uint32),
        ("offset", c_uint32),
        ("_rest", c_uint8 * (sizeof(c_long) - 4)),
        ("length", c_uint32),
        ("reserved2", c_uint32),
        ("request_fd", c_int),
    ]

    @property
    def t_ns(self) -> int:
        """Returns the timestamp in nanoseconds of the driver's clock."""
        return int(self.timestamp_s) * 1_000_000_000 + int(self.timestamp_us) * 1000


class StreamParm(Structure):
    """Represents v4l2_streamparm with the capture member of the union."""

    _fields_: ClassVar = [
        ("type", c_uint32),
        ("capability", c_uint32),
        ("capturemode", c_uint32),
        ("numerator", c_uint32),
        ("denominator", c_uint32),
        ("_rest", c_uint8 * 184),
    ]


class Input(Structure):
    _fields_: ClassVar = [
        ("index", c_uint32),
        ("name", c_uint8 * 32),
        ("type", c_uint32),
        ("audioset", c_uint32),
        ("tuner", c_uint32),
        ("std", c_uint64),
        ("status", c_uint32),
        ("capabilities", c_uint32),
        ("reserved", c_uint32 * 3),
    ]


class DvTimings(LittleEndianStructure):
    """Represents v4l2_dv_timings, packed: the kernel's bt member of the union up to vbackporch, the rest as bytes."""

    _pack_ = 1
    _fields_: ClassVar = [
        ("type", c_uint32),
        ("width", c_uint32),
        ("height", c_uint32),
        ("interlaced", c_uint32),
        ("polarities", c_uint32),
        ("pixelclock", c_uint64),
        ("hfrontporch", c_uint32),
        ("hsync", c_uint32),
        ("hbackporch", c_uint32),
        ("vfrontporch", c_uint32),
        ("vsync", c_uint32),
        ("vbackporch", c_uint32),
        ("_rest", c_uint8 * 80),
    ]

    @property
    def rate_hz(self) -> float:
        """Returns the pictures per second, 0 where the timings do not state it."""
        across = self.width + self.hfrontporch + self.hsync + self.hbackporch
        down = self.height + self.vfrontporch + self.vsync + self.vbackporch
        return float(self.pixelclock / (across * down)) if across and down else 0.0


class Event(Structure):
    _fields_: ClassVar = [
        ("type", c_uint32),
        ("_align", c_int64 * 0),
        ("u", c_uint8 * 64),
        ("pending", c_uint32),
        ("sequence", c_uint32),
        ("timestamp_s", c_long),
        ("timestamp_ns", c_long),
        ("id", c_uint32),
        ("reserved", c_uint32 * 8),
    ]


class EventSubscription(Structure):
    _fields_: ClassVar = [("type", c_uint32), ("id", c_uint32), ("flags", c_uint32), ("reserved", c_uint32 * 5)]


def _request(direction: int, number: int, kind: type) -> int:
    return direction << 30 | sizeof(kind) << 16 | ord("V") << 8 | number


QUERYCAP = _request(_READ, 0, Capability)
ENUM_FMT = _request(_READ | _WRITE, 2, FmtDesc)
G_FMT = _request(_READ | _WRITE, 4, Format)
S_FMT = _request(_READ | _WRITE, 5, Format)
REQBUFS = _request(_READ | _WRITE, 8, RequestBuffers)
QUERYBUF = _request(_READ | _WRITE, 9, Buffer)
QBUF = _request(_READ | _WRITE, 15, Buffer)
DQBUF = _request(_READ | _WRITE, 17, Buffer)
STREAMON = _request(_WRITE, 18, c_int)
STREAMOFF = _request(_WRITE, 19, c_int)
G_PARM = _request(_READ | _WRITE, 21, StreamParm)
S_PARM = _request(_READ | _WRITE, 22, StreamParm)
ENUMINPUT = _request(_READ | _WRITE, 26, Input)
G_INPUT = _request(_READ, 38, c_int)
S_INPUT = _request(_READ | _WRITE, 39, c_int)
S_DV_TIMINGS = _request(_READ | _WRITE, 87, DvTimings)
G_DV_TIMINGS = _request(_READ | _WRITE, 88, DvTimings)
QUERY_DV_TIMINGS = _request(_READ, 99, DvTimings)
DQEVENT = _request(_READ, 89, Event)
SUBSCRIBE_EVENT = _request(_WRITE, 90, EventSubscription)
"""VIDIOC_… of linux/videodev2.h, compared with the compiler's by tests/drivers/video/v4l2/test_abi.py."""


def text(field: "Array[c_uint8]") -> str:
    """Returns a text field of a structure, up to its first zero."""
    return printable_bytes(bytes(field))


def fourcc(code: str) -> int:
    """Returns a pixel format as a number: four ASCII letters, the first in the lowest byte."""
    return int.from_bytes(code.encode("ascii"), "little")


def fourcc_text(number: int) -> str:
    """Computes the inverse of fourcc, with the flag for big-endian left out."""
    return printable((number & 0x7FFFFFFF).to_bytes(4, "little").decode("ascii", "replace"))
