"""Makes the square wave that an external watchdog relay needs to stay energised.

The writes themselves make it, which come with every completed tick (20 Hz): when they stop, the wave stops, at
whichever level, and the watchdog relay opens. It needs no timer of its own, which could outlive what the wave proves.
"""

from dataclasses import dataclass, replace

from probewatch.drivers.descriptor import Given, Option

_TICK_SLACK_NS = 25_000_000
"""Half a tick, ns: a write that comes this little too early still turns the wave."""

HEARTBEAT = Option(
    "heartbeat",
    "square wave for an external watchdog relay, made by the writes of the service",
    "a steady level",
    "Hz",
    (0.5, 5),
    refusal="is not a rate",
)
"""At 5 Hz a half period is two writes of the service; at .5 Hz a watchdog relay would have to wait for 2 s."""

CLICKS = replace(HEARTBEAT, bounds=(0.5, 1))
"""Heartbeat of a mechanical relay: 100 000 clicks under load last a day at 1 Hz; at twice that rate, half a day."""


@dataclass
class Heartbeat:
    """Generates the wave. half_period_ns: 0 for a steady level."""

    half_period_ns: int = 0
    _level: bool = False
    _turned_ns: int = 0

    def level(self, energised: bool, now_ns: int) -> bool:
        """Returns the level for this write: low at once when de-energised, else the wave, or steadily high."""
        if not energised or not self.half_period_ns:
            self._level = energised
        elif now_ns - self._turned_ns >= self.half_period_ns - _TICK_SLACK_NS:
            self._level, self._turned_ns = not self._level, now_ns
        return self._level


def heartbeat_from(given: Given) -> Heartbeat:
    """Returns the heartbeat of the option HEARTBEAT; without it a steady level. Raises ConfigurationError."""
    rate_hz = given.number_or_none(HEARTBEAT.name)
    return Heartbeat() if rate_hz is None else Heartbeat(round(0.5e9 / rate_hz))
