"""The options of `igtl://host:18944`, the same for pictures and poses, so that one URL may name both."""

import math
import re
from dataclasses import dataclass

from drivers.errors import ConfigurationError
from drivers.io.tcp_line import parse_address
from drivers.openigtlink.image import Levels
from drivers.registry import refuse_unknown
from drivers.trackers.staleness import DEADLINE_MS, DEADLINES_MS, LATENCIES_MS
from drivers.video.crop import Cut, cut_from

PORT = 18944
"""TCP port of OpenIGTLink, by its specification."""

VIDEO_DEADLINE_MS = 500.0
"""Silence after which a source of pictures is lost: as docs/devices.md promises of every grabber. Less loses a scanner
of 4 Hz between two pictures."""

NAME_BYTES = 20
"""Of a device name, by the specification: senders cut longer ones off."""

_OPTIONS = (
    "image", "probe", "reference", "witness", "levels", "crop", "orientation", "deadline_ms", "latency_ms", "ask",
    "header", "simulated",
)  # fmt: skip
_ASKS = {"": "", "tdata": "TDATA", "qtdata": "QTDATA"}
_FULL_NAME = re.compile(r".+To[A-Z].*")


@dataclass(frozen=True, slots=True)
class IgtlOptions:
    """image: device name of the pictures, empty for the only one. probe, reference, witness: names of the transforms,
    reference None where the probe's is used alone, witness None where no second body sits on the probe. bare: the name
    of the probe's tool, by which its transform may be sent, empty where the URL gives a whole name. levels: see
    drivers.openigtlink.image. deadline_ms: None for the usual one. ask: the message that is to be asked for. version:
    of the headers that we send.
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
    """(host, port) and the options. Raises ConfigurationError naming what cannot be."""
    where = f"igtl://{target}"
    address = parse_address(target, PORT, where)
    refuse_unknown(options, _OPTIONS, where)
    tool, reference = options.get("probe", "Probe"), options.get("reference")
    probe = transform_name(tool)
    fixed = None if reference is None else transform_name(reference)
    if fixed == probe:
        raise ConfigurationError("probe and reference are the same transform", where, "Give two different names")
    witness = transform_name(options["witness"]) if "witness" in options else None
    if witness is not None and witness in (probe, fixed):
        remedy = "Name the transform of a second body on the probe"
        raise ConfigurationError(f"the witness is the transform {witness}, which has a part already", where, remedy)
    _word(options, "simulated", ("yes", "no"), where)
    return address, IgtlOptions(
        image=_cut_off(options.get("image", "")),
        probe=probe,
        bare="" if tool == probe else _cut_off(tool),
        reference=fixed,
        witness=witness,
        levels=_levels(options.get("levels"), where),
        cut=cut_from(options, where),
        deadline_ms=_number(options, "deadline_ms", DEADLINES_MS, where),
        latency_ms=_number(options, "latency_ms", LATENCIES_MS, where) or 0.0,
        ask=_ASKS[_word(options, "ask", tuple(_ASKS)[1:], where)],
        version=int(_word(options, "header", ("1", "2"), where) or "2"),
    )


def transform_name(name: str) -> str:
    """`Probe` → `ProbeToTracker`; a name that already is one of a transform stays. Cut off as senders do."""
    return _cut_off(name if _FULL_NAME.fullmatch(name) else f"{name}ToTracker")


def _cut_off(name: str) -> str:
    return name.encode()[:NAME_BYTES].decode(errors="surrogateescape")


def _levels(text: str | None, where: str) -> Levels | None:
    if text is None:
        return None
    try:
        black, white = (float(part) for part in text.split(","))
    except ValueError:
        black = white = math.nan
    if not (math.isfinite(black) and math.isfinite(white) and black < white):
        raise ConfigurationError(f"levels={text} are not two rising numbers", where, "Write levels=BLACK,WHITE")
    return black, white


def _number(options: dict[str, str], key: str, bounds: tuple[float, float], where: str) -> float | None:
    """None where it is not given."""
    if key not in options:
        return None
    try:
        value = float(options[key])
    except ValueError:
        value = math.nan
    if not bounds[0] <= value <= bounds[1]:
        raise ConfigurationError(
            f"{key}={options[key]} cannot be used", where, "Use a number from {:g} to {:g}".format(*bounds)
        )
    return value


def _word(options: dict[str, str], key: str, words: tuple[str, ...], where: str) -> str:
    """Empty where it is not given."""
    if key in options and options[key] not in words:
        raise ConfigurationError(f"{key}={options[key]} cannot be used", where, f"Use {' or '.join(words)}")
    return options.get(key, "")
