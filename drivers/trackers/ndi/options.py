"""The options of an NDI tracker's URL."""

import math
from dataclasses import dataclass
from pathlib import Path

from drivers.errors import ConfigurationError
from drivers.registry import refuse_unknown
from drivers.trackers.ndi.identity import ReplyKind
from drivers.trackers.ndi.session import COMM_CODES
from drivers.trackers.ndi.tools import ToolWish, parse_wish
from drivers.trackers.staleness import DEADLINE_MS, DEADLINES_MS, LATENCIES_MS

_KNOWN = ("probe", "reference", "witness", "tools", "baud", "reply", "counter_hz", "deadline_ms", "latency_ms", "log")


@dataclass(frozen=True, slots=True)
class TrackerOptions:
    """Checked. witness: a second tool on the probe. further: tools besides these. reply: None lets the device's
    firmware decide.

    counter_hz: None for the rate that goes with the device. log: where to write the byte log.
    """

    probe: ToolWish | None = None
    reference: ToolWish | None = None
    witness: ToolWish | None = None
    further: tuple[ToolWish, ...] = ()
    baud: int = 115200
    reply: ReplyKind | None = None
    counter_hz: float | None = None
    deadline_ms: float = DEADLINE_MS
    latency_ms: float = 0.0
    log: Path | None = None

    @property
    def wishes(self) -> tuple[ToolWish, ...]:
        """All tools asked for: the probe first, then the reference, then the witness."""
        return tuple(wish for wish in (self.probe, self.reference, self.witness, *self.further) if wish is not None)


def parse_options(options: dict[str, str], where: str) -> TrackerOptions:
    """Raises ConfigurationError naming the option that is unknown or out of range."""
    refuse_unknown(options, _KNOWN, where)
    if "probe" not in options and {"reference", "witness", "tools"} & set(options):
        raise ConfigurationError(
            "a reference, a witness or further tools need a probe", where, "Add probe=FILE.rom or probe=@PLUG"
        )
    _refuse_twice(options, where)
    return TrackerOptions(
        probe=parse_wish(options["probe"], where) if "probe" in options else None,
        reference=parse_wish(options["reference"], where) if "reference" in options else None,
        witness=parse_wish(options["witness"], where) if "witness" in options else None,
        further=tuple(parse_wish(text, where) for text in options.get("tools", "").split(",") if text),
        baud=_baud(options.get("baud", "115200"), where),
        reply=_reply(options["reply"], where) if "reply" in options else None,
        counter_hz=_number(options, "counter_hz", math.nan, (1, 5000), where) if "counter_hz" in options else None,
        deadline_ms=_number(options, "deadline_ms", DEADLINE_MS, DEADLINES_MS, where),
        latency_ms=_number(options, "latency_ms", 0.0, LATENCIES_MS, where),
        log=Path(options["log"]) if "log" in options else None,
    )


def _refuse_twice(options: dict[str, str], where: str) -> None:
    """One tool cannot bear witness for itself, and two wireless ones of one definition cannot be told apart."""
    if "witness" not in options:
        return
    witness = parse_wish(options["witness"], where)
    for name in ("probe", "reference"):
        if name not in options:
            continue
        other = parse_wish(options[name], where)
        same_plug = not witness.wireless and (witness.socket, witness.channel) == (other.socket, other.channel)
        if same_plug or (witness.wireless and other.wireless and _same_definition(witness, other)):
            what = f"witness={options['witness']} is the same tool as {name}={options[name]}"
            remedy = (
                "Name a second marker body of its own geometry that sits on the probe, by its own FILE.rom or @PLUG"
            )
            raise ConfigurationError(what, where, remedy)


def _same_definition(one: ToolWish, other: ToolWish) -> bool:
    return (
        one.definition is not None and other.definition is not None and one.definition.image == other.definition.image
    )


def _reply(text: str, where: str) -> ReplyKind:
    try:
        return ReplyKind(text)
    except ValueError:
        kinds = ", ".join(kind.value for kind in ReplyKind)
        raise ConfigurationError(f"reply={text} is not a tracking command", where, f"Use one of {kinds}") from None


def _baud(text: str, where: str) -> int:
    if not text.isdecimal() or int(text) not in COMM_CODES:
        rates = ", ".join(str(rate) for rate in sorted(COMM_CODES))
        raise ConfigurationError(f"baud={text} is not a line speed of these trackers", where, f"Use one of {rates}")
    return int(text)


def _number(options: dict[str, str], key: str, default: float, bounds: tuple[float, float], where: str) -> float:
    low, high = bounds
    try:
        value = float(options.get(key, default))
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise ConfigurationError(f"{key}={options[key]} is out of range", where, f"Use a number from {low} to {high}")
    return value
