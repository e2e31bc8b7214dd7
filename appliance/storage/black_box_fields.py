"""Messages of a black box: what a line is given and says, as JSON and back, bit for bit; docs/black-box.md has them.

JSON has no NaN and no infinity: null and the words "inf" and "-inf" stand for them. Every other number comes back as
the same 64 bits, because Python writes the shortest decimal that does.
"""

import base64
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite, isnan, nan
from typing import Any

import cv2
import numpy as np

from appliance.core.order import Order
from appliance.limits import Limits
from appliance.types import Calibration, Check, Fault, Verdict, VerdictKind
from drivers.samples import Frame, Pose, PoseStatus, Stamp

_PNG = [cv2.IMWRITE_PNG_COMPRESSION, 1]
"""Least effort: pictures come at 30 Hz. More makes speckle smaller by a few percent and takes several times as long
(tests/bench is silent on it; measured once on simulated tissue of 640 × 480)."""
_MOST_SIDE_PX = 16_384  # as the drivers take a picture, and as a configuration may name it


@dataclass(frozen=True, slots=True)
class Begun:
    """What a file is of. utc: ISO 8601 at t_ns of CLOCK_MONOTONIC. session: of one recorder from its start to its end;
    its files are the parts 1, 2, 3 … of one recording. simulated: URLs of sources that are no real device. text:
    "kept", or "blackened" where what lies outside the sector was made black.
    """

    format: int
    software: str
    utc: str
    t_ns: int
    session: str
    part: int
    simulated: tuple[str, ...]
    text: str


@dataclass(frozen=True, slots=True)
class State:
    """What the control socket said: the status as docs/control.md has it."""

    status: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Gap:
    """Something that the line was given, or said, is not in the file from here on: a line that is fed with the rest
    need not say the same. reason: in words. The counts are of what is missing, as far as known.
    """

    reason: str
    pictures: int = 0
    poses: int = 0
    verdicts: int = 0


@dataclass(frozen=True, slots=True)
class Mark:
    """kind: "alarm", "start" or "stop" of a stretch that a person wants kept. reason: in words."""

    kind: str
    reason: str


Item = Begun | Order | Frame | Pose | Verdict | State | Gap | Mark


def fields_of(item: Item) -> tuple[str, dict[str, Any]]:
    """(topic, message)."""
    topic, fields = _WRITTEN[type(item)]
    return topic, fields(item)


def item_of(topic: str, fields: Mapping[str, Any]) -> Item | None:
    """The other way round; None for a topic of a later version. Raises ValueError for a message that is not as
    documented.
    """
    read = _READ.get(topic)
    if read is None:
        return None
    try:
        return read(fields)
    except (KeyError, TypeError, AttributeError, OverflowError, IndexError, cv2.error) as error:
        raise ValueError(f"a message of {topic} is not as documented ({error})") from error


def verdict_fields(verdict: Verdict) -> dict[str, Any]:
    """One verdict as its message; two that are equal bit for bit have equal messages, NaN included."""
    return {
        "t_ns": int(verdict.t_ns),
        "kind": verdict.kind.value,
        "fault": verdict.fault,
        "reason": verdict.reason,
        "verified_ns": _whole(verdict.verified_ns),
        "checks": [
            {
                "name": check.name,
                "fault": check.fault,
                "value": _number(check.value),
                "sigma": _number(check.sigma),
                "unit": check.unit,
                "limit": _number(check.limit),
                "verdict": check.verdict.value,
                "shown_ns": _whole(check.shown_ns),
            }
            for check in verdict.checks
        ],
    }


def _verdict(fields: Mapping[str, Any]) -> Verdict:
    checks = tuple(
        Check(
            str(one["name"]),
            Fault(one["fault"]),
            _float(one["value"]),
            _float(one["sigma"]),
            str(one["unit"]),
            _float(one["limit"]),
            VerdictKind(one["verdict"]),
            _int_or_none(one["shown_ns"]),
        )
        for one in fields["checks"]
    )
    fault = None if fields["fault"] is None else Fault(fields["fault"])
    kind, verified_ns = VerdictKind(fields["kind"]), _int_or_none(fields["verified_ns"])
    return Verdict(_int(fields["t_ns"]), kind, checks, fault, str(fields["reason"]), verified_ns)


def _picture(frame: Frame) -> dict[str, Any]:
    height, width = frame.image.shape
    done, png = cv2.imencode(".png", frame.image, _PNG)
    assert done
    return {
        **_stamp(frame.stamp),
        "sequence": int(frame.sequence),
        "width": width,
        "height": height,
        "encoding": "png",
        "data": base64.b64encode(png.tobytes()).decode(),
    }


def _frame(fields: Mapping[str, Any]) -> Frame:
    height, width = _int(fields["height"]), _int(fields["width"])
    data = np.frombuffer(base64.b64decode(fields["data"], validate=True), np.uint8)
    if not (0 < height <= _MOST_SIDE_PX and 0 < width <= _MOST_SIDE_PX) or _png_size(data) != (width, height):
        raise ValueError("a picture of /picture is not of the size that it says")
    image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.uint8 or image.shape != (height, width):
        raise ValueError("a picture of /picture is no grey PNG of 8 bits")
    return Frame(_stamped(fields), _int(fields["sequence"]), np.asarray(image, np.uint8))


def _png_size(data: np.ndarray[Any, np.dtype[np.uint8]]) -> tuple[int, int]:
    """(width, height) that the PNG's header says, before memory for so many pixels is asked for."""
    head = data[16:24].tobytes()
    return int.from_bytes(head[:4], "big"), int.from_bytes(head[4:], "big")


def _pose(pose: Pose) -> dict[str, Any]:
    return {
        **_stamp(pose.stamp),
        "sequence": int(pose.sequence),
        "matrix": None if pose.matrix is None else _numbers(pose.matrix.ravel()),
        "rms_mm": _number(pose.rms_mm),
        "status": pose.status.value,
        "reason": pose.reason,
    }


def _read_pose(fields: Mapping[str, Any]) -> Pose:
    matrix = None if fields["matrix"] is None else _array(fields["matrix"], (4, 4))
    rms_mm, status = _float(fields["rms_mm"]), PoseStatus(fields["status"])
    return Pose(_stamped(fields), _int(fields["sequence"]), matrix, rms_mm, status, str(fields["reason"]))


def _order(order: Order) -> dict[str, Any]:
    reference = order.reference
    covariance = None if reference.covariance is None else _numbers(reference.covariance.ravel())
    return {
        "generation": order.generation,
        "stale_ns": order.stale_ns,
        "limits": order.limits.model_dump(),
        "reference": {
            "rotation": _numbers(reference.rotation.ravel()),
            "polarity": [int(one) for one in reference.polarity],
            "scale_mm_per_px": _numbers(reference.scale_mm_per_px),
            "offset_mm": _numbers(reference.offset_mm),
            "image_size_px": [int(side) for side in reference.image_size_px],
            "covariance": covariance,
            "observed": [bool(one) for one in reference.observed],
            "simulated": bool(reference.simulated),
        },
    }


def _read_order(fields: Mapping[str, Any]) -> Order:
    said = fields["reference"]
    covariance = None if said["covariance"] is None else _array(said["covariance"], (8, 8))
    polarity, size_px = (_pair(said[name]) for name in ("polarity", "image_size_px"))
    observed = tuple(bool(one) for one in said["observed"])
    if len(observed) != 8:
        raise ValueError("observed of a reference has not eight values")
    reference = Calibration(
        rotation=_array(said["rotation"], (3, 3)),
        polarity=polarity,
        scale_mm_per_px=_array(said["scale_mm_per_px"], (2,)),
        offset_mm=_array(said["offset_mm"], (3,)),
        image_size_px=size_px,
        covariance=covariance,
        observed=observed,
        simulated=bool(said["simulated"]),
    )
    limits = Limits.model_validate(fields["limits"])
    return Order(_int(fields["generation"]), reference, limits, _int(fields["stale_ns"]))


def _begun(fields: Mapping[str, Any]) -> Begun:
    simulated = tuple(str(url) for url in fields["simulated"])
    software, utc, session, text = (str(fields[name]) for name in ("software", "utc", "session", "text"))
    format_, t_ns, part = (_int(fields[name]) for name in ("format", "t_ns", "part"))
    return Begun(format_, software, utc, t_ns, session, part, simulated, text)


def _gap(fields: Mapping[str, Any]) -> Gap:
    return Gap(str(fields["reason"]), *(_int(fields[name]) for name in ("pictures", "poses", "verdicts")))


def _own(item: Any) -> dict[str, Any]:
    """Of plain values, under their own names."""
    return {name: [*value] if isinstance(value := getattr(item, name), tuple) else value for name in item.__slots__}


_WRITTEN: dict[type, tuple[str, Callable[[Any], dict[str, Any]]]] = {
    Begun: ("/begun", _own),
    Order: ("/order", _order),
    Frame: ("/picture", _picture),
    Pose: ("/pose", _pose),
    Verdict: ("/verdict", verdict_fields),
    State: ("/state", lambda item: dict(item.status)),
    Gap: ("/gap", _own),
    Mark: ("/mark", _own),
}
_READ: dict[str, Callable[[Mapping[str, Any]], Item]] = {
    "/begun": _begun,
    "/order": _read_order,
    "/picture": _frame,
    "/pose": _read_pose,
    "/verdict": _verdict,
    "/state": lambda fields: State(dict(fields)),
    "/gap": _gap,
    "/mark": lambda fields: Mark(str(fields["kind"]), str(fields["reason"])),
}


def _stamp(stamp: Stamp) -> dict[str, int]:
    return {"t_ns": int(stamp.t_ns), "err_ns": int(stamp.err_ns)}


def _stamped(fields: Mapping[str, Any]) -> Stamp:
    return Stamp(_int(fields["t_ns"]), _int(fields["err_ns"]))


def _number(value: float) -> float | str | None:
    if isfinite(value):
        return float(value)
    return None if isnan(value) else "inf" if value > 0 else "-inf"


def _numbers(values: Sequence[float] | np.ndarray[Any, np.dtype[np.float64]]) -> list[float | str | None]:
    return [_number(float(value)) for value in values]


def _float(said: object) -> float:
    if said is None:
        return nan
    if said in ("inf", "-inf"):
        return inf if said == "inf" else -inf
    if not isinstance(said, int | float) or isinstance(said, bool):
        raise ValueError(f"{str(said)[:40]!r} is not a number")
    return float(said)


def _array(said: Sequence[object], shape: tuple[int, ...]) -> np.ndarray[Any, np.dtype[np.float64]]:
    values = np.array([_float(one) for one in said])
    return values.reshape(shape)


def _pair(said: Sequence[object]) -> tuple[int, int]:
    first, second = (_int(one) for one in said)
    return first, second


def _int(said: object) -> int:
    if not isinstance(said, int) or isinstance(said, bool) or abs(said) >= 1 << 63:
        raise ValueError(f"{str(said)[:40]!r} is not a whole number of 64 bits")
    return said


def _int_or_none(said: object) -> int | None:
    return None if said is None else _int(said)


def _whole(value: int | None) -> int | None:
    return None if value is None else int(value)
