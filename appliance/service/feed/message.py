"""Converts the feed's messages, version 1, to bytes and back; docs/feed.md lists their fields.

A message is two lengths, u32 big-endian, then a header of the first length, JSON, then pixels of the second. Numbers
are exact: integers as they are, floats in the fewest digits that give the same double; non-finite ones are strings,
"nan", "inf" or "-inf". What the line was given comes back bit for bit.
"""

import json
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.core.exact_fields import (
    Header,
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
from probewatch.appliance.types import Verdict
from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.samples import Frame, GreyImage, Pose, Sample

VERSION = 1
_LENGTHS = struct.Struct(">II")
_LONGEST_HEADER, _LONGEST_PIXELS = 1 << 18, 1 << 26
"""Bytes, the longest header and the most pixels. A verdict of 19 checks takes 5 kB; the largest picture of a ring 4 MB.
More lets the program at the other end take as much memory.
"""
_PLACE, _REMEDY = "feed", "Is it the feed's socket, of this version of probewatch?"


@dataclass(frozen=True, slots=True)
class Hello:
    """Represents the first message: version of the protocol and of the software."""

    version: int
    software: str


@dataclass(frozen=True, slots=True)
class LineStarted:
    """Announces the settings by which the line works from here on. step: samples that this line has taken before, 0 for
    a new one.

    settings: None while there is no reference; then samples come without verdicts.
    """

    settings: EstimatorSettings | None
    step: int


@dataclass(frozen=True, slots=True, eq=False)
class Taken:
    """States that step number `step` of the line took this sample. reduced_by: 1 for a whole picture, else the number
    of pixels along either axis that were averaged to one.
    """

    step: int
    sample: Sample
    reduced_by: int = 1


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """Holds a verdict that step number `step` gave."""

    step: int
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class Lost:
    """Holds the number of samples that, with their verdicts, were not sent to this client at this place."""

    samples: int


@dataclass(frozen=True, slots=True)
class Refused:
    """States why this client is not served; nothing follows."""

    why: str


FeedMessage = Hello | LineStarted | Taken | Judged | Lost | Refused


def packed(header: Mapping[str, Any], pixels: bytes = b"") -> bytes:
    """Returns the bytes of a message without its pixels, of which it only states the length."""
    text = json.dumps(header, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
    return _LENGTHS.pack(len(text), len(pixels)) + text


def lengths(head: bytes) -> tuple[int, int]:
    """Returns the bytes of header and of pixels that follow these eight. Raises ProtocolError."""
    header, pixels = _LENGTHS.unpack(head)
    if not 2 <= header <= _LONGEST_HEADER or pixels > _LONGEST_PIXELS:
        raise ProtocolError(f"announces {header} and {pixels} bytes, which no message has", _PLACE, _REMEDY)
    return header, pixels


HEAD_BYTES = _LENGTHS.size


def hello(software: str, ignored: tuple[str, ...] = ()) -> bytes:
    """Returns the first message. ignored: fields of the request that mean nothing here."""
    extra = {"ignored": ignored} if ignored else {}
    return packed({"kind": "hello", "v": VERSION, "software": software, **extra})


def lost(samples: int) -> bytes:
    return packed({"kind": "lost", "samples": samples})


def refused(why: str) -> bytes:
    return packed({"kind": "refused", "why": why})


def line_started(settings: EstimatorSettings | None, step: int) -> bytes:
    return packed({"kind": "order", "step": step, "order": None if settings is None else settings_fields(settings)})


def taken_pose(step: int, pose: Pose) -> bytes:
    return packed({"kind": "pose", "step": step, **pose_fields(pose)})


def taken_frame(step: int, frame: Frame, original_px: tuple[int, int], reduced_by: int) -> tuple[bytes, bytes]:
    """Returns (what comes before the pixels, the pixels)."""
    height, width = frame.image.shape
    pixels = frame.image.tobytes()
    size = {"width": width, "height": height, "original_px": original_px, "reduced_by": reduced_by}
    return packed({"kind": "frame", "step": step, **stamp_fields(frame), **size}, pixels), pixels


def judged(step: int, verdict: Verdict) -> bytes:
    return packed({"kind": "verdict", "step": step, **verdict_fields(verdict)})


def unpacked(header: bytes, pixels: bytes) -> FeedMessage:
    """Returns the message that was packed. Raises ProtocolError for what is not one of this version."""
    try:
        fields = json.loads(header)
        kind = fields["kind"]
        return _frame(fields, pixels) if kind == "frame" else _KINDS[kind](fields)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        raise ProtocolError(f"is not a message of the feed ({error!r})", _PLACE, _REMEDY) from None


def _hello(fields: Header) -> Hello:
    version = integer(fields["v"])
    if version != VERSION:
        raise ValueError(f"version {version}, this reads {VERSION}")
    return Hello(version, str(fields["software"]))


def _line_started(fields: Header) -> LineStarted:
    settings = fields["order"]
    return LineStarted(None if settings is None else settings_of(settings), integer(fields["step"]))


def _pose(fields: Header) -> Taken:
    return Taken(integer(fields["step"]), pose_of(fields))


def _frame(fields: Header, pixels: bytes) -> Taken:
    image: GreyImage = np.frombuffer(pixels, np.uint8).reshape(integer(fields["height"]), integer(fields["width"]))
    frame = Frame(stamp_of(fields), integer(fields["sequence"]), image)
    return Taken(integer(fields["step"]), frame, integer(fields["reduced_by"]))


def _judged(fields: Header) -> Judged:
    return Judged(integer(fields["step"]), verdict_of(fields))


def _lost(fields: Header) -> Lost:
    return Lost(integer(fields["samples"]))


def _refused(fields: Header) -> Refused:
    return Refused(str(fields["why"]))


_KINDS: dict[str, Callable[[Header], FeedMessage]] = {
    "hello": _hello,
    "order": _line_started,
    "pose": _pose,
    "verdict": _judged,
    "lost": _lost,
    "refused": _refused,
}
