"""Reads and writes the black box: one MCAP file of everything that a line was given, in its order, and of its verdicts.

A file can be truncated at any byte: everything written until a second before is read, and the reader reports the
truncation. Fed to lines that are made by its settings, it yields the same verdicts, bit for bit, as long as nothing is
missing.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.limits import Limits
from probewatch.appliance.storage.black_box_fields import Begun, Gap, Item, Made, fields_of, item_of
from probewatch.drivers.errors import RecordingError
from probewatch.drivers.recordings.mcap_file import McapReader, McapWriter

FORMAT = 1
"""Version of the messages; it rises where an old reader would misinterpret a file."""
CHUNK_NS = 1_000_000_000
"""ns, the length of each chunk that is compressed and checked on its own, and so the most that a truncation or a power
failure can cost. More loses more with it; less compresses worse.
"""

_MOST_NAMED = 3
"""Damages listed one by one in a sentence; the rest are counted."""


def _object(title: str, **properties: Mapping[str, Any]) -> dict[str, Any]:
    return {"title": title, "type": "object", "properties": dict(properties), "required": [*properties]}


_INTEGER, _TEXT, _FLAG = {"type": "integer"}, {"type": "string"}, {"type": "boolean"}
_NUMBER = {"type": ["number", "string"], "description": "nan, inf and -inf are strings"}
_PERHAPS_INTEGER = {"type": ["integer", "null"]}
_NUMBERS = {"type": "array", "items": _NUMBER}
_PERHAPS_NUMBERS = {"type": ["array", "null"], "items": _NUMBER}
_INTEGERS = {"type": "array", "items": _INTEGER}
_STAMP = {
    "t_ns": {**_INTEGER, "description": "when it was true, CLOCK_MONOTONIC, ns"},
    "err_ns": {**_INTEGER, "description": "bound of the error of t_ns, ns"},
    "sequence": {**_INTEGER, "description": "counter of the device"},
}
_CHECK = _object(
    "probewatch.Check",
    name=_TEXT,
    fault={**_TEXT, "description": "class that it names when it fails"},
    value=_NUMBER,
    sigma=_NUMBER,
    unit=_TEXT,
    limit=_NUMBER,
    verdict={"enum": ["OK", "FAULT", "NOT_VERIFIED"]},
    shown_ns=_PERHAPS_INTEGER,
    rested_ns={**_INTEGER, "description": "for how long since shown_ns the probe has rested, ns"},
)
_RIVAL = _object(
    "probewatch.Rival",
    check=_CHECK,
    behind_nats={**_NUMBER, "description": "log likelihood by which it explains less than the likeliest"},
)
_LIMIT = {
    "type": ["number", "object", "string", "null"],
    "description": "objects hold limits of their own; the string is the name of the profile; null is off",
}
_BOUNDS = {**_NUMBERS, "description": "holds for 95 %, for 99.7 %"}
_POINT = _object(
    "probewatch.PointError",
    worst_mm=_BOUNDS,
    median_mm=_BOUNDS,
    depth_mm={"type": ["number", "null"], "description": "that somebody named, from the top of the picture"},
    at_depth_mm={**_BOUNDS, "type": ["array", "null"]},
    shown_ns=_INTEGER,
    region_mm={**_NUMBERS, "description": "that for 99.7 % at places of the region, row by row"},
)
_REFERENCE = _object(
    "probewatch.Calibration",
    rotation={**_NUMBERS, "description": "3 x 3 by rows, sensor to picture"},
    polarity={**_INTEGERS, "description": "lateral, axial; 1 or -1"},
    scale_mm_per_px=_NUMBERS,
    offset_mm=_NUMBERS,
    image_size_px={**_INTEGERS, "description": "width, height"},
    covariance={**_PERHAPS_NUMBERS, "description": "8 x 8 by rows"},
    observed={"type": "array", "items": _FLAG},
    simulated=_FLAG,
    face_radius_mm={"type": ["number", "null"], "description": "of the arc at which a convex picture begins"},
)
_ORDER = _object(
    "probewatch.Order",
    generation=_INTEGER,
    stale_ns=_INTEGER,
    limits={"type": "object", "properties": dict.fromkeys(Limits.model_fields, _LIMIT)},
    reference=_REFERENCE,
    relative_pose={
        **_PERHAPS_NUMBERS,
        "description": "4 x 4 by rows, second marker body to first, mm, as learned before; or null",
    },
)

SCHEMAS: dict[str, dict[str, Any]] = {
    "/begun": _object(
        "probewatch.Begun",
        format=_INTEGER,
        software=_TEXT,
        utc=_TEXT,
        t_ns=_INTEGER,
        session=_TEXT,
        part=_INTEGER,
        simulated={"type": "array", "items": _TEXT},
        text={"enum": ["kept", "blackened"]},
        every=_INTEGER,
    ),
    "/order": _object("probewatch.Made", step=_INTEGER, order={"anyOf": [_ORDER, {"type": "null"}]}),
    "/picture": _object(
        "probewatch.Picture",
        **_STAMP,
        width=_INTEGER,
        height=_INTEGER,
        encoding={"const": "png"},
        data={**_TEXT, "contentEncoding": "base64", "description": "grey PNG of 8 bits"},
    ),
    "/pose": _object(
        "probewatch.Pose",
        **_STAMP,
        matrix={**_PERHAPS_NUMBERS, "description": "4 x 4 by rows, sensor to tracker, mm; null unless status is OK"},
        rms_mm=_NUMBER,
        status=_TEXT,
        reason=_TEXT,
        witness={**_PERHAPS_NUMBERS, "description": "the same of a second body on the probe, or null"},
    ),
    "/verdict": _object(
        "probewatch.Verdict",
        t_ns=_INTEGER,
        verdict={"enum": ["OK", "FAULT", "NOT_VERIFIED"]},
        fault={"type": ["string", "null"]},
        reason=_TEXT,
        verified_ns=_PERHAPS_INTEGER,
        expires_ns=_PERHAPS_INTEGER,
        checks={"type": "array", "items": _CHECK},
        rivals={"type": "array", "items": _RIVAL, "description": "what may be wrong, the likeliest first"},
        point={"anyOf": [_POINT, {"type": "null"}], "description": "error of a point"},
    ),
    "/state": {"title": "probewatch.Status", "type": "object", "description": "the status of docs/control.md"},
    "/gap": _object("probewatch.Gap", reason=_TEXT, samples=_INTEGER),
    "/mark": _object("probewatch.Mark", kind={"enum": ["alarm", "start", "stop"]}, reason=_TEXT),
}
"""Topic → JSON schema of its messages, as it is in every file."""


class BlackBoxWriter:
    """Writes to a stream that the caller opens and closes. Every call raises OSError as the stream does."""

    def __init__(self, stream: BinaryIO, begun: Begun) -> None:
        self._mcap = McapWriter(stream, SCHEMAS, f"probewatch {version('probewatch')}")
        self._chunk_ns = begun.t_ns
        self.put(begun, begun.t_ns)

    def put(self, item: Item, now_ns: int) -> bool:
        """Writes a message. Returns whether a chunk has ended, so that a sync is worthwhile.

        now_ns: CLOCK_MONOTONIC at which it is written.
        """
        due = now_ns - self._chunk_ns >= CHUNK_NS
        if due:
            self._mcap.flush()
            self._chunk_ns = now_ns
        topic, fields = fields_of(item)
        self._mcap.put(topic, max(now_ns, 0), fields)
        return due

    def finish(self) -> None:
        """Ends the file, so that it is whole."""
        self._mcap.finish()


class TimedItem(NamedTuple):
    """Holds an item. now_ns: when it was written, CLOCK_MONOTONIC."""

    item: Item
    now_ns: int


class BlackBox:
    """Represents a file to read. Raises RecordingError where it is no black box.

    begun: its first message, which describes it. damage: that of McapReader; complete once `items` has ended.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._mcap = McapReader(path)
        first = next(self.items(), None)
        if first is None or not isinstance(first.item, Begun):
            what = "; ".join(self.damage) or "its first message is not /begun"
            raise RecordingError(
                f"is not a black box ({what})", str(path), "Give a file that probewatch record has written"
            )
        if first.item.format != FORMAT:
            what = f"is a black box of format {first.item.format}; this version reads format {FORMAT}"
            raise RecordingError(what, str(path), "Use the probewatch that wrote it")
        self.begun = first.item

    @property
    def damage(self) -> list[str]:
        """Returns what is wrong with the file, in words."""
        return self._mcap.damage

    @property
    def damage_text(self) -> str:
        """Returns the damage in one sentence; empty for a whole file."""
        more = len(self.damage) - _MOST_NAMED
        return "; ".join(self.damage[:_MOST_NAMED]) + (f"; and {more} more" if more > 0 else "")

    def stamps(self) -> Iterator[tuple[str, int]]:
        """Yields (topic, when it was true, ns) of pictures and poses, without decoding them."""
        for entry in self._mcap.entries():
            t_ns = entry.fields.get("t_ns")
            if entry.topic in ("/picture", "/pose") and isinstance(t_ns, int):
                yield entry.topic, t_ns

    def items(self) -> Iterator[TimedItem]:
        """Yields items in the order in which they were written. What cannot be understood is left out and reported as
        damage, with a Gap in its place.
        """
        known = 0
        for entry in self._mcap.entries():
            try:
                item = item_of(entry.topic, entry.fields)
            except ValueError as error:
                self.damage.append(str(error))
                item = None
            if len(self.damage) > known:
                known = len(self.damage)
                yield TimedItem(Gap(self.damage[-1]), entry.t_ns)
            if item is not None:
                yield TimedItem(item, entry.t_ns)


class Span(NamedTuple):
    """Holds the number of items, and when the first and the last were true, ns."""

    number: int = 0
    first_ns: int = 0
    last_ns: int = 0


class Series:
    """Reads the files of one session as one recording. boxes: of one session, in any order. Raises RecordingError.

    begun: that of the first.
    """

    def __init__(self, boxes: Sequence[BlackBox]) -> None:
        self.boxes = sorted(boxes, key=lambda box: box.begun.part)
        self.begun = self.boxes[0].begun

    @property
    def damage_text(self) -> str:
        """Returns what is wrong with any of them; complete once `items` has ended."""
        return "; ".join(f"{box.path.name} {box.damage_text}" for box in self.boxes if box.damage)

    def spans(self) -> tuple[Span, Span]:
        """Returns the spans of the pictures and of the poses."""
        found = {"/picture": Span(), "/pose": Span()}
        for topic, t_ns in (stamp for box in self.boxes for stamp in box.stamps()):
            span = found[topic]
            first_ns = t_ns if span.number == 0 else min(span.first_ns, t_ns)
            found[topic] = Span(span.number + 1, first_ns, max(span.last_ns, t_ns))
        return found["/picture"], found["/pose"]

    def first_settings(self) -> EstimatorSettings | None:
        """Returns the settings by which the first line was made; None where there was none."""
        all_settings = (item.settings for item, _ in self.items() if isinstance(item, Made))
        return next((settings for settings in all_settings if settings is not None), None)

    def items(self) -> Iterator[TimedItem]:
        """Yields items as one file would have them. What each later part repeats, so that it can be read alone, is left
        out. Where a part is missing or damaged there is a Gap, after which its settings are passed on again.
        """
        before: BlackBox | None = None
        for box in self.boxes:
            follows = before is not None and before.begun.part + 1 == box.begun.part and not before.damage
            if before is not None and not follows:
                yield TimedItem(Gap("a part of the recording is missing or damaged"), box.begun.t_ns)
            yield from _resumed(box) if follows else box.items()
            before = box


def _resumed(box: BlackBox) -> Iterator[TimedItem]:
    """Yields the items of the box without its /begun and the settings that follow it."""
    head = True
    for entry in box.items():
        if head and isinstance(entry.item, Begun | Made):
            head = isinstance(entry.item, Begun)
            continue
        head = False
        yield entry


def series_of(boxes: Iterable[BlackBox]) -> list[Series]:
    """Returns each session with its parts; duplicates of a part, such as a kept copy beside the ring, count once."""
    sessions: dict[str, dict[int, BlackBox]] = {}
    for box in boxes:
        sessions.setdefault(box.begun.session, {}).setdefault(box.begun.part, box)
    return [Series([*parts.values()]) for parts in sessions.values()]
