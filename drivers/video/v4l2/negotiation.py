"""Negotiates with a capture device before it streams: input, signal, pixel format, size and rate."""

import errno
import math
import re
from ctypes import c_int
from dataclasses import dataclass

from probewatch.drivers.descriptor import Given
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.video.crop import LEAST_PX
from probewatch.drivers.video.v4l2 import abi
from probewatch.drivers.video.v4l2.node import Node
from probewatch.drivers.video.v4l2.pixels import FORMATS

_SIZE = re.compile(r"(\d{2,5})x(\d{2,5})")
_SIDES_PX = range(LEAST_PX, 8193)
"""Sides that size= may request, up to 8K screens. This only finds typing errors; the device refuses what it lacks."""

_USUAL_HZ = 30.0
"""Rate assumed for a device that does not report its own, only for the bound of the stamps. The bound of a slower
device is too narrow, that of a faster one too wide; `probe` reports that it is assumed.
"""

_RATE_TOLERANCE = 0.01
"""Relative difference up to which a rate is the requested one: 29.97 is 30, 25 is not. More hides another rate; less
remarks on that of NTSC.
"""

_ENOUGH_HZ = 20.0
"""Pictures per second of a lossless format below which one that comes more often is preferred. Higher takes JPEG where
the grabber gives as many in either; lower follows quick motion badly. Not measured.
"""

_SMALL = ("NV12", "YU12", "YV12", "MJPG", "JPEG")
"""Formats of fewer bytes a picture than YUYV, so that pictures may come more often over USB."""

_CLOCK_STEP_HZ = 100_000
"""Pixel clocks that differ by less are one signal, since receivers measure them. Less takes jitter for a new signal;
more misses one of a slightly different rate. Not measured.
"""

_MOST_NAMED = 8
"""Largest number of formats in a message: what still fits a line."""
_WHOLE_PICTURES = (abi.FIELD_NONE, abi.FIELD_ANY)
"""Accepted answers to S_FMT; some drivers of progressive sources leave the field at ANY."""
_NO_SIGNAL = abi.IN_ST_NO_POWER | abi.IN_ST_NO_SIGNAL
_NO_LOCK = abi.IN_ST_NO_H_LOCK | abi.IN_ST_NO_V_LOCK | abi.IN_ST_NO_SYNC


@dataclass(frozen=True, slots=True)
class RequestedFormat:
    """Holds what the URL requests; None where the device may choose."""

    size_px: tuple[int, int] | None = None
    rate_hz: float | None = None
    code: str | None = None
    input_number: int | None = None


@dataclass(frozen=True, slots=True)
class Agreed:
    """Holds what the device will send. rate_hz: as the device reports it, NaN where it reports none."""

    card: str
    bus: str
    code: str
    width: int
    height: int
    bytes_per_line: int
    rate_hz: float
    remarks: tuple[str, ...]

    @property
    def period_ns(self) -> int:
        """Returns the period of the pictures; that of a usual device where this one does not report it."""
        return round(1e9 / (_USUAL_HZ if math.isnan(self.rate_hz) else self.rate_hz))


def requested_from(given: Given) -> RequestedFormat:
    """Reads the options size=WIDTHxHEIGHT, rate=HZ, format=CODE, input=NUMBER. Raises ConfigurationError."""
    size_px = _size(given) if given.text("size") else None
    return RequestedFormat(
        size_px, given.number_or_none("rate"), given.word_or_none("format"), given.integer_or_none("input")
    )


def _size(given: Given) -> tuple[int, int]:
    found = _SIZE.fullmatch(given.text("size") or "")
    if found is None or int(found[1]) not in _SIDES_PX or int(found[2]) not in _SIDES_PX:
        raise given.refusal("size", "Write size=WIDTHxHEIGHT in pixels")
    return int(found[1]), int(found[2])


def negotiate(node: Node, requested: RequestedFormat) -> Agreed:
    """Returns what was agreed. Raises DeviceLost where the device cannot do what was requested, or has no signal."""
    card, bus = _capture_device(node)
    if requested.input_number is not None:
        node.must(abi.S_INPUT, c_int(requested.input_number), f"has no input {requested.input_number}")
    timings_hz = _follow_signal(node)
    pix = _set_format(node, requested)
    rate_hz, remarks = _set_rate(node, requested.rate_hz)
    rate_hz = timings_hz if math.isnan(rate_hz) else rate_hz
    remarks = (*remarks, *_of_slow(node, requested, abi.fourcc_text(pix.pixelformat), rate_hz))
    if math.isnan(rate_hz):
        remarks = (*remarks, f"it does not report its rate, {_USUAL_HZ:.0f} per second is taken for the time bound")
    code = abi.fourcc_text(pix.pixelformat)
    return Agreed(card, bus, code, pix.width, pix.height, pix.bytesperline, rate_hz, remarks)


def _capture_device(node: Node) -> tuple[str, str]:
    capability = abi.Capability()
    node.must(abi.QUERYCAP, capability, "is not a video device")
    can = capability.device_caps or capability.capabilities
    if not can & abi.CAP_VIDEO_CAPTURE:
        planar = can & abi.CAP_VIDEO_CAPTURE_MPLANE
        what = "hands its pictures on in several planes" if planar else "is not a video capture device"
        remedy = "Try opencv: with its number" if planar else "`probewatch devices` lists the others"
        raise DeviceLost(what, node.where, remedy)
    if not can & abi.CAP_STREAMING:
        raise DeviceLost("cannot stream into memory", node.where, "Try opencv: with its number")
    return abi.text(capability.card), abi.text(capability.bus_info)


def current_input(node: Node) -> int:
    """Returns the number of the input in use, 0 where the driver knows no inputs."""
    number = c_int()
    node.allows(abi.G_INPUT, number)
    return number.value


def require_signal(node: Node) -> None:
    """Raises DeviceLost where there is no signal, or another one than was agreed."""
    found = _signal(node)
    if found is not None and not _is_current(node, found):
        remedy = "If that was not meant, correct the output of the scanner"
        raise DeviceLost("the size or rate of the video signal changed", node.where, remedy)


def _signal(node: Node) -> abi.DvTimings | None:
    """Returns the timings of a digital signal; None for other inputs. Raises DeviceLost without a signal."""
    current, found = abi.Input(index=current_input(node)), abi.DvTimings()
    known = node.allows(abi.ENUMINPUT, current)
    is_digital = known and current.capabilities & abi.IN_CAP_DV_TIMINGS
    if is_digital:
        node.must(abi.QUERY_DV_TIMINGS, found, "does not report the timings of its signal")
    if current.status & _NO_SIGNAL:
        raise node.lost(OSError(errno.ENOLINK, ""), "")
    if current.status & _NO_LOCK:
        raise node.lost(OSError(errno.ENOLCK, ""), "")
    return found if is_digital else None


def _follow_signal(node: Node) -> float:
    """Adopts the timings of a digital signal. Returns its rate in Hz, NaN for other inputs. Raises DeviceLost."""
    found = _signal(node)
    if found is None:
        return math.nan
    if not _is_current(node, found):
        node.must(abi.S_DV_TIMINGS, found, "does not take over the timings of its signal")
    return found.rate_hz or math.nan


def _is_current(node: Node, found: abi.DvTimings) -> bool:
    current = abi.DvTimings()
    return node.allows(abi.G_DV_TIMINGS, current) and _timing(found) == _timing(current)


def _timing(timings: abi.DvTimings) -> tuple[int, ...]:
    """Returns the values whose change makes another picture; porches and polarities do not."""
    return timings.width, timings.height, timings.interlaced, timings.pixelclock // _CLOCK_STEP_HZ


def _set_format(node: Node, requested: RequestedFormat) -> abi.PixFormat:
    offered = _offered(node)
    known = [code for code in FORMATS if code in offered]
    if requested.code is None and not known:
        what = f"offers none of the formats {', '.join(FORMATS)}, only {', '.join(offered[:_MOST_NAMED]) or 'nothing'}"
        raise DeviceLost(what, node.where, "Try opencv: with its number")
    code = requested.code or _preferred_format(node, requested, known)
    format_ = _requested_format(node, requested, code)
    node.must(abi.S_FMT, format_, "does not take a picture format")
    _require_format(node, format_.pix, requested, code)
    return abi.PixFormat.from_buffer_copy(format_.pix)


def _requested_format(node: Node, requested: RequestedFormat, code: str) -> abi.Format:
    format_ = abi.Format(type=abi.BUF_TYPE_VIDEO_CAPTURE)
    node.must(abi.G_FMT, format_, "does not report its picture format")
    format_.pix.pixelformat, format_.pix.field, format_.pix.bytesperline = abi.fourcc(code), abi.FIELD_NONE, 0
    if requested.size_px is not None:
        format_.pix.width, format_.pix.height = requested.size_px
    return format_


def _preferred_format(node: Node, requested: RequestedFormat, known: list[str]) -> str:
    """Returns the first of the formats that reaches the wanted rate, else the fastest: a large picture over USB may
    come only five times a second if it is not compressed.
    """
    wanted_hz = requested.rate_hz or _ENOUGH_HZ
    rates_hz: dict[str, float] = {}
    for code in known:
        format_ = _requested_format(node, requested, code)
        if not node.allows(abi.S_FMT, format_) or format_.pix.pixelformat != abi.fourcc(code):
            continue
        rates_hz[code] = _reported_hz(node, requested.rate_hz)[0]
        if not rates_hz[code] < wanted_hz * (1 - _RATE_TOLERANCE):  # a rate that is not reported is no reason to go on
            return code
    return max(rates_hz, key=rates_hz.__getitem__, default=known[0])


def _of_slow(node: Node, requested: RequestedFormat, code: str, rate_hz: float) -> tuple[str, ...]:
    """Returns a remark for a format below _ENOUGH_HZ; some drivers report no rate of a format before it streams."""
    if not rate_hz < _ENOUGH_HZ or (requested.rate_hz is not None and requested.rate_hz < _ENOUGH_HZ):
        return ()
    offered = _offered(node)
    others = " or ".join(f"format={one}" for one in _SMALL if one in offered and one != code)
    remedy = f"{others} may come more often, or a smaller size=" if others else "A smaller size= may come more often"
    return (f"{code} comes {rate_hz:g} times a second by the word of the device. {remedy}",)


def _require_format(node: Node, pix: abi.PixFormat, requested: RequestedFormat, code: str) -> None:
    """Raises DeviceLost unless the format is the requested one: a device answers a request that it cannot fulfil with
    what it would do instead.
    """
    size_px = (pix.width, pix.height)
    if pix.pixelformat != abi.fourcc(code):
        what = f"does not give {code}, only {', '.join(_offered(node)[:_MOST_NAMED])}"
        raise DeviceLost(what, node.where, "Leave format= out, or choose one of these")
    if requested.size_px not in (None, size_px):
        what = f"gives {size_px[0]}x{size_px[1]} instead of {requested.size_px[0]}x{requested.size_px[1]} pixels"
        raise DeviceLost(what, node.where, "Correct size=, or the output of the scanner")
    if pix.field not in _WHOLE_PICTURES:
        what = "gives interlaced pictures only, whose lines are of two moments"
        remedy = "Set the scanner's output to a progressive one (1080p, not 1080i), or choose another input="
        raise DeviceLost(what, node.where, remedy)


def _offered(node: Node) -> list[str]:
    found = []
    for index in range(256):
        one = abi.FmtDesc(index=index, type=abi.BUF_TYPE_VIDEO_CAPTURE)
        if not node.allows(abi.ENUM_FMT, one):
            break
        found.append(abi.fourcc_text(one.pixelformat))
    return found


def _reported_hz(node: Node, rate_hz: float | None) -> tuple[float, bool]:
    """Returns (rate of the format in force once a rate was requested, whether the driver reports rates at all). The
    rate is NaN where it is not reported.
    """
    parameters = abi.StreamParm(type=abi.BUF_TYPE_VIDEO_CAPTURE)
    if not node.allows(abi.G_PARM, parameters):
        return math.nan, False
    if rate_hz is not None and parameters.capability & abi.CAP_TIMEPERFRAME:
        parameters.numerator, parameters.denominator = 1000, round(rate_hz * 1000)
        node.must(abi.S_PARM, parameters, "does not take a rate")
    reported_hz = parameters.denominator / parameters.numerator if parameters.numerator else math.nan
    return reported_hz or math.nan, True


def _set_rate(node: Node, rate_hz: float | None) -> tuple[float, tuple[str, ...]]:
    """Returns (rate as the driver reports it, remarks). A rate that the device rounds or cannot choose is remarked on,
    not refused.
    """
    reported_hz, reports = _reported_hz(node, rate_hz)
    if not reports:
        return math.nan, ("its rate cannot be chosen",) if rate_hz is not None else ()
    if rate_hz is not None and abs(reported_hz - rate_hz) > _RATE_TOLERANCE * rate_hz:
        return reported_hz, (f"{rate_hz:g} pictures per second were asked for, it gives {reported_hz:g}",)
    return reported_hz, ()
