"""Converts the messages of a black box to items and back; docs/black-box.md describes them all. Numbers are those of
appliance.core.exact_fields, so that inputs and verdicts come back bit for bit; pictures are lossless PNG.
"""

import base64
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.core.exact_fields import (
    integer,
    pose_fields,
    pose_of,
    settings_fields,
    settings_of,
    stamp_fields,
    stamp_of,
    verdict_fields,
    verdict_of,
)
from probewatch.appliance.types import Calibration, Verdict
from probewatch.drivers.samples import Frame, Pose

_PNG = [
    cv2.IMWRITE_PNG_COMPRESSION, 1,
    cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE,
    cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB,
]  # fmt: skip
"""Settings of the PNG encoder. They take 2.6 ms for a simulated picture of 640 × 480, which comes to 44 % of its bytes;
the library's default takes twice as long for 49 %, zstd of the bare pixels 0.6 ms for 62 %.
"""
_MOST_NS = 1 << 62
"""ns, a century and a half: what is computed from it fits 64 bits."""
_LEAST_SIDE_PX, _MOST_SIDE_PX = 1, 16_384  # as the drivers take a picture, and as a configuration may name it
_MOST_PIXELS = 1 << 24
"""Pixels of one picture: twice the largest screen that scanners have. A damaged size could request any memory."""
_ROTATION_TOLERANCE = 1e-3
"""Tolerance of RᵀR. A rotation of a service is orthonormal to rounding; less would refuse one that a person typed."""
_LEAST_SCALE, _MOST_SCALE = 1e-4, 1e2
"""mm per px, the range of every scanner: from an acoustic microscope to a screen that shows a whole body."""


@dataclass(frozen=True, slots=True)
class Begun:
    """Describes a file. utc: ISO 8601 at t_ns of CLOCK_MONOTONIC. session: of one recorder from its start to its end;
    its files are the parts 1, 2, 3 … of one recording. simulated: URLs of sources that are not real devices. text:
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
    every: int = 1


@dataclass(frozen=True, slots=True)
class State:
    """Holds the status that the control socket reported, as in docs/control.md."""

    status: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Made:
    """Announces the settings by which a line works from here on. step: samples that this very line had taken before, 0
    for a new one. settings: None while there is no reference, and so no line.
    """

    settings: EstimatorSettings | None
    step: int


@dataclass(frozen=True, slots=True)
class Gap:
    """Announces that something that the line was given, or reported, is missing from here on: a line that is fed with
    the rest need not give the same verdicts. reason: in words. samples: the number that is missing, as far as it is
    known.
    """

    reason: str
    samples: int = 0


@dataclass(frozen=True, slots=True)
class Mark:
    """Marks a stretch that a person wants to keep. kind: "alarm", "start" or "stop". reason: in words."""

    kind: str
    reason: str


Item = Begun | Made | Frame | Pose | Verdict | State | Gap | Mark


def fields_of(item: Item) -> tuple[str, dict[str, Any]]:
    """Returns (topic, message)."""
    topic, fields = _WRITTEN[type(item)]
    return topic, fields(item)


def item_of(topic: str, fields: Mapping[str, Any]) -> Item | None:
    """Returns the item; None for a topic of a later version. Raises ValueError for a message not as documented."""
    read = _READ.get(topic)
    if read is None:
        return None
    try:
        item = read(fields)
    except (KeyError, TypeError, AttributeError, OverflowError, IndexError, cv2.error) as error:
        raise ValueError(f"a message of {topic} is not as documented ({error})") from error
    if isinstance(item, Frame | Pose) and not abs(item.stamp.t_ns) < _MOST_NS:
        raise ValueError(f"a message of {topic} is of no time of this world")
    return item


def _picture(frame: Frame) -> dict[str, Any]:
    height, width = frame.image.shape
    done, png = cv2.imencode(".png", frame.image, _PNG)
    assert done
    return {
        **stamp_fields(frame),
        "width": width,
        "height": height,
        "encoding": "png",
        "data": base64.b64encode(png.tobytes()).decode(),
    }


def _frame(fields: Mapping[str, Any]) -> Frame:
    height, width = integer(fields["height"]), integer(fields["width"])
    data = np.frombuffer(base64.b64decode(fields["data"], validate=True), np.uint8)
    possible = 0 < height <= _MOST_SIDE_PX and 0 < width <= _MOST_SIDE_PX and height * width <= _MOST_PIXELS
    if not possible or _png_size(data) != (width, height):
        raise ValueError("a picture of /picture is not of the size that it says")
    image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.uint8 or image.shape != (height, width):
        raise ValueError("a picture of /picture is not an 8-bit grey PNG")
    return Frame(stamp_of(dict(fields)), integer(fields["sequence"]), np.asarray(image, np.uint8))


def _png_size(data: np.ndarray[Any, np.dtype[np.uint8]]) -> tuple[int, int]:
    """Returns (width, height) in the PNG's header, before memory for so many pixels is requested."""
    head = data[16:24].tobytes()
    return int.from_bytes(head[:4], "big"), int.from_bytes(head[4:], "big")


def _begun(fields: Mapping[str, Any]) -> Begun:
    simulated = tuple(str(url) for url in fields["simulated"])
    software, utc, session, text = (str(fields[name]) for name in ("software", "utc", "session", "text"))
    format_, t_ns, part = (integer(fields[name]) for name in ("format", "t_ns", "part"))
    return Begun(format_, software, utc, t_ns, session, part, simulated, text, integer(fields["every"]))


def _gap(fields: Mapping[str, Any]) -> Gap:
    return Gap(str(fields["reason"]), integer(fields["samples"]))


def _made(made: Made) -> dict[str, Any]:
    return {"step": made.step, "order": None if made.settings is None else settings_fields(made.settings)}


def _read_made(fields: Mapping[str, Any]) -> Made:
    settings = None if fields["order"] is None else settings_of(fields["order"])
    if settings is not None and not _sane(settings.reference):
        raise ValueError("the reference of /order is not a calibration of a probe")
    return Made(settings, integer(fields["step"]))


def _sane(reference: Calibration) -> bool:
    """Returns whether a line can be made of the reference: settings of the service ensure that, a file need not."""
    R, scale, sides = reference.rotation, reference.scale_mm_per_px, reference.image_size_px
    numbers = [R, scale, reference.offset_mm, np.eye(1) if reference.covariance is None else reference.covariance]
    return (
        all(np.isfinite(one).all() for one in numbers)
        and bool(np.abs(R.T @ R - np.eye(3)).max() < _ROTATION_TOLERANCE and np.linalg.det(R) > 0)
        and set(reference.polarity) <= {-1, 1}
        and bool((scale > _LEAST_SCALE).all() and (scale < _MOST_SCALE).all())
        and all(_LEAST_SIDE_PX <= side <= _MOST_SIDE_PX for side in sides)
    )


def _own(item: Any) -> dict[str, Any]:
    """Returns the fields of plain values, under their own names."""
    return {name: [*value] if isinstance(value := getattr(item, name), tuple) else value for name in item.__slots__}


_WRITTEN: dict[type, tuple[str, Callable[[Any], dict[str, Any]]]] = {
    Begun: ("/begun", _own),
    Made: ("/order", _made),
    Frame: ("/picture", _picture),
    Pose: ("/pose", pose_fields),
    Verdict: ("/verdict", verdict_fields),
    State: ("/state", lambda item: dict(item.status)),
    Gap: ("/gap", _own),
    Mark: ("/mark", _own),
}
_READ: dict[str, Callable[[Mapping[str, Any]], Item]] = {
    "/begun": _begun,
    "/order": _read_made,
    "/picture": _frame,
    "/pose": lambda fields: pose_of(dict(fields)),
    "/verdict": lambda fields: verdict_of(dict(fields)),
    "/state": lambda fields: State(dict(fields)),
    "/gap": _gap,
    "/mark": lambda fields: Mark(str(fields["kind"]), str(fields["reason"])),
}
