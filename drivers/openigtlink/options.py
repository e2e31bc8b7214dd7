"""Parses the options of `igtl://host:18944`, the same for pictures and poses, so that one URL may name both."""

import math
import re
from dataclasses import dataclass

from probewatch.drivers.descriptor import Given
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.io.tcp_line import parse_address
from probewatch.drivers.openigtlink import IGTL
from probewatch.drivers.openigtlink.image import Levels
from probewatch.drivers.trackers.staleness import DEADLINE_MS
from probewatch.drivers.video.crop import Cut, cut_from

PORT = 18944
"""TCP port of OpenIGTLink, by its specification."""

VIDEO_DEADLINE_MS = 500.0
"""Silence after which a source of pictures is lost, ms, as docs/devices.md promises for every grabber. Less loses a
scanner of 4 Hz between two pictures.
"""

NAME_BYTES = 20
"""Length of a device name, by the specification: senders cut off longer ones."""

_ASKS = {None: "", "tdata": "TDATA", "qtdata": "QTDATA"}
_FULL_NAME = re.compile(r".+To[A-Z].*")


@dataclass(frozen=True, slots=True)
class IgtlOptions:
    """Holds the options, checked.

    image: device name of the pictures, empty for the only one. probe, reference, witness: names of the transforms;
    reference is None where the probe's is used alone, witness is None where no second body is on the probe. bare: the
    name of the probe's tool, under which its transform may be sent; empty where the URL gives a whole name. levels: see
    drivers.openigtlink.image. deadline_ms: None for the usual one. ask: the message that must be requested. version:
    that of the headers that we send.
    """

    image: str
    probe: str
    bare: str
    reference: str | None
    witness: str | None
    levels: Levels | None
    cut: Cut
    deadline_ms: float | None
    latency_ms: float
    ask: str
    version: int

    @property
    def tracker_deadline_ms(self) -> float:
        return DEADLINE_MS if self.deadline_ms is None else self.deadline_ms

    @property
    def video_deadline_ms(self) -> float:
        return VIDEO_DEADLINE_MS if self.deadline_ms is None else self.deadline_ms


def parse_target(target: str, options: dict[str, str]) -> tuple[tuple[str, int], IgtlOptions]:
    """Returns (host, port) and the options. Raises ConfigurationError that names what is invalid."""
    where = f"igtl://{target}"
    address = parse_address(target, PORT, where)
    given = IGTL.given(options, where)
    tool, reference, second = given.text("probe") or "Probe", given.text("reference"), given.text("witness")
    probe = transform_name(tool)
    fixed = None if reference is None else transform_name(reference)
    if fixed == probe:
        raise ConfigurationError("probe and reference are the same transform", where, "Give two different names")
    witness = None if second is None else transform_name(second)
    if witness is not None and witness in (probe, fixed):
        remedy = "Name the transform of a second body on the probe"
        raise ConfigurationError(f"the witness is the transform {witness}, which has a part already", where, remedy)
    given.word("simulated")
    return address, IgtlOptions(
        image=_cut_off(given.text("image") or ""),
        probe=probe,
        bare="" if tool == probe else _cut_off(tool),
        reference=fixed,
        witness=witness,
        levels=_levels(given),
        cut=cut_from(given),
        deadline_ms=given.number_or_none("deadline_ms"),
        latency_ms=given.number("latency_ms"),
        ask=_ASKS[given.word_or_none("ask")],
        version=int(given.word("header")),
    )


def transform_name(name: str) -> str:
    """Converts `Probe` to `ProbeToTracker`, but leaves the name of a transform. It is cut off as senders do."""
    return _cut_off(name if _FULL_NAME.fullmatch(name) else f"{name}ToTracker")


def _cut_off(name: str) -> str:
    return name.encode()[:NAME_BYTES].decode(errors="surrogateescape")


def _levels(given: Given) -> Levels | None:
    text = given.text("levels")
    if text is None:
        return None
    try:
        black, white = (float(part) for part in text.split(","))
    except ValueError:
        black = white = math.nan
    if not (math.isfinite(black) and math.isfinite(white) and black < white):
        raise given.refusal("levels", "Write levels=BLACK,WHITE")
    return black, white
