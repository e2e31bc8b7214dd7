"""Parses the options of an NDI tracker's URL."""

from dataclasses import dataclass
from pathlib import Path

from probewatch.drivers.descriptor import Driver, Given
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.trackers.ndi import NDI
from probewatch.drivers.trackers.ndi.identity import ReplyKind
from probewatch.drivers.trackers.ndi.tools import RequestedTool, parse_requested_tool
from probewatch.drivers.trackers.staleness import DEADLINE_MS

_BAUD = 115200
"""Bits per second. Every one of these trackers has this speed; on a network it has no effect."""


@dataclass(frozen=True, slots=True)
class TrackerOptions:
    """Holds the options, checked. witness: a second tool on the probe. further: tools besides these. reply: None lets
    the device's firmware decide.

    counter_hz: None for the rate that goes with the device. log: where to write the byte log.
    """

    probe: RequestedTool | None = None
    reference: RequestedTool | None = None
    witness: RequestedTool | None = None
    further: tuple[RequestedTool, ...] = ()
    baud: int = _BAUD
    reply: ReplyKind | None = None
    counter_hz: float | None = None
    deadline_ms: float = DEADLINE_MS
    latency_ms: float = 0.0
    log: Path | None = None

    @property
    def requested_tools(self) -> tuple[RequestedTool, ...]:
        """Returns all tools that the URL names: first the probe, then reference, witness, and the further ones."""
        return tuple(
            requested
            for requested in (self.probe, self.reference, self.witness, *self.further)
            if requested is not None
        )


def parse_options(options: dict[str, str], where: str, driver: Driver = NDI) -> TrackerOptions:
    """Returns the checked options. Raises ConfigurationError that names the option that is unknown or out of range."""
    given = driver.given(options, where)
    if "probe" not in options and {"reference", "witness", "tools"} & set(options):
        raise ConfigurationError(
            "a reference, a witness or further tools need a probe", where, "Add probe=FILE.rom or probe=@PLUG"
        )
    _refuse_twice(options, where)
    reply, log = given.word_or_none("reply"), given.text("log")
    return TrackerOptions(
        probe=_requested(given, "probe"),
        reference=_requested(given, "reference"),
        witness=_requested(given, "witness"),
        further=tuple(parse_requested_tool(text, where) for text in (given.text("tools") or "").split(",") if text),
        baud=int(given.word("baud")) if driver is NDI else _BAUD,
        reply=None if reply is None else ReplyKind(reply),
        counter_hz=given.number_or_none("counter_hz"),
        deadline_ms=given.number("deadline_ms"),
        latency_ms=given.number("latency_ms"),
        log=None if log is None else Path(log),
    )


def _requested(given: Given, name: str) -> RequestedTool | None:
    text = given.text(name)
    return None if text is None else parse_requested_tool(text, given.where)


_REMEDIES = {
    "reference": "Name a tool that is fixed to the patient or the table, by its own FILE.rom or @PLUG",
    "witness": "Name a second marker body of its own geometry that sits on the probe, by its own FILE.rom or @PLUG",
}
"""Option that names a second tool → what to name there."""
_TWICE = (("reference", "probe"), ("witness", "probe"), ("witness", "reference"))


def _refuse_twice(options: dict[str, str], where: str) -> None:
    """Raises ConfigurationError where two options name one tool: seen from itself, it never moves. Two wireless ones of
    one definition cannot be distinguished.
    """
    for second, first in _TWICE:
        if not {first, second} <= set(options):
            continue
        if _same_tool(*(parse_requested_tool(options[name], where) for name in (first, second))):
            what = f"{second}={options[second]} is the same tool as {first}={options[first]}"
            raise ConfigurationError(what, where, _REMEDIES[second])


def _same_tool(one: RequestedTool, other: RequestedTool) -> bool:
    if one.wireless and other.wireless:
        return _same_definition(one, other)
    return one.wireless == other.wireless and (one.socket, one.channel) == (other.socket, other.channel)


def _same_definition(one: RequestedTool, other: RequestedTool) -> bool:
    return (
        one.definition is not None and other.definition is not None and one.definition.image == other.definition.image
    )
