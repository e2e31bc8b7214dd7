"""The square wave that an external watchdog relay needs to stay energised.

It is made by the writes themselves, which come with every completed tick (20 Hz): when they stop, the wave stands
still, at whichever level, and the watchdog relay opens. It needs no timer of its own that could outlive what it proves.
"""

import math
from dataclasses import dataclass

from drivers.errors import ConfigurationError

_TICK_SLACK_NS = 25_000_000
"""Half a tick: a write that comes this little too early still turns the wave."""


@dataclass
class Heartbeat:
    """half_period_ns: 0 for a steady level."""

    half_period_ns: int = 0
    _level: bool = False
    _turned_ns: int = 0

    def level(self, energised: bool, now_ns: int) -> bool:
        """What to put on the line at this write: low at once when de-energised, else the wave, or steadily high."""
        if not energised or not self.half_period_ns:
            self._level = energised
        elif now_ns - self._turned_ns >= self.half_period_ns - _TICK_SLACK_NS:
            self._level, self._turned_ns = not self._level, now_ns
        return self._level


def heartbeat_from(options: dict[str, str], where: str, highest_hz: float = 5.0) -> Heartbeat:
    """Option heartbeat=HZ, from 0.5 to highest_hz; none means a steady level. Raises ConfigurationError."""
    text = options.get("heartbeat")
    if text is None:
        return Heartbeat()
    try:
        rate_hz = float(text)
    except ValueError:
        rate_hz = math.nan
    if not 0.5 <= rate_hz <= highest_hz:
        raise ConfigurationError(f"heartbeat={text} is not a rate", where, f"Give 0.5 to {highest_hz:g} Hz")
    return Heartbeat(round(0.5e9 / rate_hz))
