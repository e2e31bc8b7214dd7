"""Computes what each output shows at one moment, contact, lamps and tone, from the alarm table. Pure.

Energised is safe for every role: a lamp or sounder other than the green lamp is wired to the normally closed contact,
so it is dark or silent only while it is driven; a dead cart lights red, yellow and cyan, sounds, and opens the contact.
"""

from dataclasses import dataclass
from enum import Enum

from probewatch.appliance.supervision.alarms import SIGNALS, Lamp
from probewatch.appliance.supervision.audio import Audio, Sound
from probewatch.appliance.types import AlarmState

LAMP_TEST_NS = 5_000_000_000
"""ns, the time for one person to look at every lamp and to hear the longest burst, 3.25 s, to its end."""
_MS = 1_000_000
"""ns in a millisecond."""


class Role(Enum):
    """Names what an output is for; the value is written in the configuration."""

    CONTACT = "contact"
    GREEN = "green"
    CYAN = "cyan"
    YELLOW = "yellow"
    RED = "red"
    TONE = "tone"


_LAMPS = {Role.GREEN: Lamp.GREEN, Role.CYAN: Lamp.CYAN, Role.YELLOW: Lamp.YELLOW, Role.RED: Lamp.RED}


@dataclass(frozen=True, slots=True)
class Burst:
    """Describes pulses that start at offsets_ms and last pulse_ms. The burst repeats every period_ms; 0 is once."""

    offsets_ms: tuple[int, ...]
    pulse_ms: int
    period_ms: int


BURSTS = {
    10: Burst((0, 250, 500, 850, 1100, 2000, 2250, 2500, 2850, 3100), 150, 8000),
    3: Burst((0, 400, 800), 200, 15_000),
    1: Burst((0,), 200, 0),
}
"""Bursts by the number of pulses in the alarm table: high, medium, low."""


class Annunciator:
    """Computes one step a tick. A lamp test lights every lamp and sounds the tone, and leaves the contact alone."""

    def __init__(self) -> None:
        self.audio = Audio()
        self._test_until_ns: int | None = None
        self.sound: Sound | None = None

    def test_lamps(self, now_ns: int) -> None:
        """Lights everything for LAMP_TEST_NS."""
        self._test_until_ns = now_ns + LAMP_TEST_NS

    def testing(self, now_ns: int) -> bool:
        """Returns whether a lamp test is running."""
        return self._test_until_ns is not None and now_ns < self._test_until_ns

    def step(self, now_ns: int, alarm: AlarmState) -> dict[Role, bool]:
        """Returns whether the output of each role is energised at now_ns (host clock, ns)."""
        self.sound = self.audio.step(now_ns, alarm)
        testing = self.testing(now_ns)
        lit = {role: testing or _lit(lamp, now_ns, alarm) for role, lamp in _LAMPS.items()}
        sounding = testing or _sounding(now_ns, self.sound)
        energised = {role: on if role is Role.GREEN else not on for role, on in lit.items()}
        return {Role.CONTACT: alarm.energised, Role.TONE: not sounding, **energised}


def _lit(lamp: Lamp, now_ns: int, alarm: AlarmState) -> bool:
    """Returns whether the lamp is lit. A flashing lamp starts lit when its state begins."""
    signal = SIGNALS[alarm.state]
    if signal.lamp is not lamp:
        return False
    if signal.flash_hz == 0:
        return True
    half_ns = round(0.5e9 / signal.flash_hz)
    return (now_ns - alarm.since_ns) // half_ns % 2 == 0


def _sounding(now_ns: int, sound: Sound) -> bool:
    if sound.pulses == 0:
        return False
    burst = BURSTS[sound.pulses]
    at_ms = (now_ns - sound.since_ns) // _MS
    if burst.period_ms:
        at_ms %= burst.period_ms
    return any(offset <= at_ms < offset + burst.pulse_ms for offset in burst.offsets_ms)
