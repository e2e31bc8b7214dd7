"""The feed's messages, version 1, to bytes and back; docs/feed.md lists their fields.

A message is two lengths, u32 big-endian, then a header of so many bytes, JSON, then so many bytes of pixels. Numbers
are exact: integers as they are, floats in the shortest digits that give the same double; what is not finite is a
string, "nan", "inf" or "-inf". What the line was given comes back as it was given, bit for bit.
"""

import json
import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from appliance.limits import Limits
from appliance.service.estimator.link import Order
from appliance.types import Calibration, Check, Fault, Verdict, VerdictKind
from drivers.errors import ProtocolError
from drivers.samples import Frame, GreyImage, Pose, PoseStatus, Sample, Stamp

VERSION = 1
_LENGTHS = struct.Struct(">II")
_LONGEST_HEADER, _LONGEST_PIXELS = 1 << 18, 1 << 26
"""Bytes. A verdict of 19 checks takes 5 kB; the largest picture of a ring 4 MB. More lets whoever is at the other end
take as much memory.
"""
Header = dict[str, Any]
_PLACE, _REMEDY = "feed", "Is it the feed's socket, of this version of probewatch?"


@dataclass(frozen=True, slots=True)
class Hello:
    """The first message: version of the protocol and of the software."""

    version: int
    software: str


@dataclass(frozen=True, slots=True)
class Ordered:
    """From here on the line works by this order; step: samples that this very line has taken before, 0 for a new one.

    order: None while there is no reference; then samples come without verdicts.
    """

    order: Order | None
    step: int


@dataclass(frozen=True, slots=True, eq=False)
class Taken:
    """Step number `step` of the line took this sample. reduced_by: 1 for a whole picture, else so many pixels of either
    axis were averaged to one.
    """

    step: int
    sample: Sample
    reduced_by: int = 1


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """A verdict that step number `step` gave."""

    step: int
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class Lost:
    """So many samples, with the verdicts that they gave, were not told to this client at this place."""

    samples: int


@dataclass(frozen=True, slots=True)
class Refused:
    """Why this client is not served; nothing follows."""

    why: str


FeedMessage = Hello | Ordered | Taken | Judged | Lost | Refused


def packed(header: Mapping[str, Any], pixels: bytes = b"") -> bytes:
    """The bytes of a message, without its pixels, of which it only tells the length."""
    text = json.dumps(header, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
    return _LENGTHS.pack(len(text), len(pixels)) + text


def lengths(head: bytes) -> tuple[int, int]:
    """Bytes of header and pixels that follow these eight. Raises ProtocolError."""
    header, pixels = _LENGTHS.unpack(head)
    if not 2 <= header <= _LONGEST_HEADER or pixels > _LONGEST_PIXELS:
        raise ProtocolError(f"announces {header} and {pixels} bytes, which no message has", _PLACE, _REMEDY)
    return header, pixels


HEAD_BYTES = _LENGTHS.size


def hello(software: str) -> bytes:
    return packed({"kind": "hello", "v": VERSION, "software": software})


def lost(samples: int) -> bytes:
    return packed({"kind": "lost", "samples": samples})


def refused(why: str) -> bytes:
    return packed({"kind": "refused", "why": why})


def ordered(order: Order | None, step: int) -> bytes:
    return packed({"kind": "order", "step": step, "order": None if order is None else order_fields(order)})


def taken_pose(step: int, pose: Pose) -> bytes:
    return packed({"kind": "pose", "step": step, **_stamp(pose), **_pose_fields(pose)})


def taken_frame(step: int, frame: Frame, original_px: tuple[int, int], reduced_by: int) -> tuple[bytes, bytes]:
    """(what comes before the pixels, the pixels)."""
    height, width = frame.image.shape
    pixels = frame.image.tobytes()
    size = {"width": width, "height": height, "original_px": original_px, "reduced_by": reduced_by}
    return packed({"kind": "frame", "step": step, **_stamp(frame), **size}, pixels), pixels


def judged(step: int, verdict: Verdict) -> bytes:
    return packed({"kind": "verdict", "step": step, **verdict_fields(verdict)})


def order_fields(order: Order) -> Header:
    """What a line is made of."""
    return {
        "generation": order.generation,
        "stale_ns": order.stale_ns,
        "limits": order.limits.model_dump(),
        "reference": calibration_fields(order.reference),
    }


def calibration_fields(calibration: Calibration) -> Header:
    """All of it; the covariance row by row."""
    covariance = calibration.covariance
    return {
        "rotation": _numbers(calibration.rotation),
        "polarity": list(calibration.polarity),
        "scale_mm_per_px": _numbers(calibration.scale_mm_per_px),
        "offset_mm": _numbers(calibration.offset_mm),
        "image_size_px": list(calibration.image_size_px),
        "covariance": None if covariance is None else _numbers(covariance),
        "observed": list(calibration.observed),
        "simulated": calibration.simulated,
    }


def verdict_fields(verdict: Verdict) -> Header:
    """All of it, with every check."""
    return {
        "t_ns": verdict.t_ns,
        "verdict": verdict.kind.value,
        "fault": None if verdict.fault is None else verdict.fault.value,
        "reason": verdict.reason,
        "verified_ns": verdict.verified_ns,
        "checks": [_check_fields(check) for check in verdict.checks],
    }


def unpacked(header: bytes, pixels: bytes) -> FeedMessage:
    """The message again. Raises ProtocolError for what is none of this version."""
    try:
        fields = json.loads(header)
        kind = fields["kind"]
        return _frame(fields, pixels) if kind == "frame" else _KINDS[kind](fields)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        raise ProtocolError(f"is no message of the feed ({error!r})", _PLACE, _REMEDY) from None


def order_of(fields: Header) -> Order:
    """Of order_fields. Raises ValueError, KeyError, TypeError."""
    limits = Limits.model_validate(fields["limits"])
    return Order(_whole(fields["generation"]), calibration_of(fields["reference"]), limits, _whole(fields["stale_ns"]))


def calibration_of(fields: Header) -> Calibration:
    """Of calibration_fields. Raises ValueError, KeyError, TypeError."""
    covariance = fields["covariance"]
    lateral, axial = map(_whole, fields["polarity"])
    width, height = map(_whole, fields["image_size_px"])
    return Calibration(
        rotation=_array(fields["rotation"], (3, 3)),
        polarity=(lateral, axial),
        scale_mm_per_px=_array(fields["scale_mm_per_px"], (2,)),
        offset_mm=_array(fields["offset_mm"], (3,)),
        image_size_px=(width, height),
        covariance=None if covariance is None else _array(covariance, (8, 8)),
        observed=tuple(bool(one) for one in fields["observed"]),
        simulated=bool(fields["simulated"]),
    )


def verdict_of(fields: Header) -> Verdict:
    """Of verdict_fields. Raises ValueError, KeyError, TypeError."""
    return Verdict(
        t_ns=_whole(fields["t_ns"]),
        kind=VerdictKind(fields["verdict"]),
        checks=tuple(_check(check) for check in fields["checks"]),
        fault=None if fields["fault"] is None else Fault(fields["fault"]),
        reason=str(fields["reason"]),
        verified_ns=_whole_or_none(fields["verified_ns"]),
    )


def _stamp(sample: Sample) -> Header:
    return {"t_ns": sample.stamp.t_ns, "err_ns": sample.stamp.err_ns, "sequence": sample.sequence}


def _pose_fields(pose: Pose) -> Header:
    return {
        "status": pose.status.name,
        "matrix": None if pose.matrix is None else _numbers(pose.matrix),
        "rms_mm": _number(pose.rms_mm),
        "reason": pose.reason,
    }


def _check_fields(check: Check) -> Header:
    return {
        "name": check.name,
        "fault": check.fault.value,
        "value": _number(check.value),
        "sigma": _number(check.sigma),
        "unit": check.unit,
        "limit": _number(check.limit),
        "verdict": check.verdict.value,
        "shown_ns": check.shown_ns,
    }


def _check(fields: Header) -> Check:
    return Check(
        name=str(fields["name"]),
        fault=Fault(fields["fault"]),
        value=float(fields["value"]),
        sigma=float(fields["sigma"]),
        unit=str(fields["unit"]),
        limit=float(fields["limit"]),
        verdict=VerdictKind(fields["verdict"]),
        shown_ns=_whole_or_none(fields["shown_ns"]),
    )


def _number(value: float) -> float | str:
    value = float(value)
    return value if math.isfinite(value) else str(value)


def _numbers(values: Any) -> list[float | str]:
    return [_number(value) for value in np.asarray(values, np.float64).ravel().tolist()]


def _array(values: list[Any], shape: tuple[int, ...]) -> Any:
    return np.array([float(value) for value in values], np.float64).reshape(shape)


def _whole(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise ValueError(f"{value!r} is not a whole number")
    return value


def _whole_or_none(value: Any) -> int | None:
    return None if value is None else _whole(value)


def _stamp_of(fields: Header) -> Stamp:
    return Stamp(_whole(fields["t_ns"]), _whole(fields["err_ns"]))


def _hello(fields: Header) -> Hello:
    version = _whole(fields["v"])
    if version != VERSION:
        raise ValueError(f"version {version}, this reads {VERSION}")
    return Hello(version, str(fields["software"]))


def _ordered(fields: Header) -> Ordered:
    order = fields["order"]
    return Ordered(None if order is None else order_of(order), _whole(fields["step"]))


def _pose(fields: Header) -> Taken:
    matrix = fields["matrix"]
    pose = Pose(
        _stamp_of(fields),
        _whole(fields["sequence"]),
        None if matrix is None else _array(matrix, (4, 4)),
        float(fields["rms_mm"]),
        PoseStatus[fields["status"]],
        str(fields["reason"]),
    )
    return Taken(_whole(fields["step"]), pose)


def _frame(fields: Header, pixels: bytes) -> Taken:
    image: GreyImage = np.frombuffer(pixels, np.uint8).reshape(_whole(fields["height"]), _whole(fields["width"]))
    frame = Frame(_stamp_of(fields), _whole(fields["sequence"]), image)
    return Taken(_whole(fields["step"]), frame, _whole(fields["reduced_by"]))


def _judged(fields: Header) -> Judged:
    return Judged(_whole(fields["step"]), verdict_of(fields))


def _lost(fields: Header) -> Lost:
    return Lost(_whole(fields["samples"]))


def _refused(fields: Header) -> Refused:
    return Refused(str(fields["why"]))


_KINDS: dict[str, Callable[[Header], FeedMessage]] = {
    "hello": _hello,
    "order": _ordered,
    "pose": _pose,
    "verdict": _judged,
    "lost": _lost,
    "refused": _refused,
}
