"""Decides whether the alarm may sound: on, paused for a time, acknowledged, or switched off for a stated reason. Pure.

In the style of IEC 60601-1-8: a pause ends by itself after at most 120 s; an acknowledged alarm is silent until another
one comes; an alarm that is switched off, acknowledged, or paused again and again sounds reminders.
"""

from dataclasses import dataclass
from enum import Enum

from probewatch.appliance.supervision.alarms import SIGNALS, Priority
from probewatch.appliance.supervision.faults import FAULT_ROWS
from probewatch.appliance.types import AlarmState, Fault, State

LONGEST_PAUSE_NS = 120_000_000_000
"""ns, the longest pause. With a longer one, a room would forget that it silenced the alarm; with a shorter one, it
would switch the sound off instead.
"""
_SHORTEST_REASON = 3
"""Characters of a reason. A single key is no reason; a whole sentence is too much for somebody beside an alarm."""
REMINDER_NS = 60_000_000_000
"""ns between two reminders that the sound is off: more lets it be forgotten, less is the nuisance that was silenced."""


class AudioMode(Enum):
    """Names what a person has done about the sound."""

    ON = "on"
    PAUSED = "paused"
    ACKNOWLEDGED = "acknowledged"
    OFF = "off"


@dataclass(frozen=True, slots=True)
class Sound:
    """Represents one step of the audio. pulses: of the burst that is due, 0 is silence; since_ns: when that burst
    pattern began.

    until_ns: end of the pause, None unless paused. off_reason: empty unless off.
    """

    mode: AudioMode
    pulses: int
    since_ns: int
    until_ns: int | None = None
    off_reason: str = ""


class Audio:
    """Keeps what was requested; time is an argument, ns of the host clock."""

    def __init__(self) -> None:
        self._paused_until_ns: int | None = None
        self._paused_since_ns = self._pause_ends_ns = -REMINDER_NS
        self._off_reason = ""
        self._silent_since_ns: int | None = None

    def pause(self, now_ns: int, duration_ns: int) -> None:
        """Pauses the sound. Raises ValueError outside 0 … LONGEST_PAUSE_NS. A pause that follows another within
        REMINDER_NS continues it, so that pauses in a row are not silent for longer than one.
        """
        if not 0 < duration_ns <= LONGEST_PAUSE_NS:
            raise ValueError(f"an audio pause lasts from 1 to {LONGEST_PAUSE_NS // 1_000_000_000} s")
        if now_ns - self._pause_ends_ns >= REMINDER_NS:
            self._paused_since_ns = now_ns
        self._paused_until_ns = self._pause_ends_ns = now_ns + duration_ns

    def off(self, reason: str) -> None:
        """Switches the sound off. Raises ValueError without a reason."""
        if len(reason.strip()) < _SHORTEST_REASON:
            least = f"of at least {_SHORTEST_REASON} characters"
            raise ValueError(f"the alarm sound is switched off only with a reason {least}, which the alarm log keeps")
        self._off_reason = reason.strip()

    @property
    def silenced(self) -> bool:
        """Returns whether a pause or an audio-off is in force."""
        return self._paused_until_ns is not None or bool(self._off_reason)

    def on(self) -> None:
        """Ends a pause or an audio-off."""
        self._paused_until_ns, self._off_reason = None, ""

    def step(self, now_ns: int, alarm: AlarmState) -> Sound:
        """Returns what sounds now."""
        if self._paused_until_ns is not None and now_ns >= self._paused_until_ns:
            self._paused_until_ns = None
        mode = self._mode(alarm)
        due = pulses(alarm.state, alarm.fault)
        if mode is AudioMode.ON or due == 0:
            self._silent_since_ns = None
            return Sound(mode, due, alarm.since_ns, off_reason=self._off_reason)
        if self._silent_since_ns is None:
            self._silent_since_ns = now_ns
        if mode is AudioMode.PAUSED and now_ns - self._paused_since_ns < LONGEST_PAUSE_NS:
            return Sound(mode, 0, alarm.since_ns, self._paused_until_ns)
        return self._reminding(now_ns, mode, alarm)

    def _mode(self, alarm: AlarmState) -> AudioMode:
        if self._off_reason:
            return AudioMode.OFF
        if self._paused_until_ns is not None:
            return AudioMode.PAUSED
        return AudioMode.ACKNOWLEDGED if alarm.acknowledged else AudioMode.ON

    def _reminding(self, now_ns: int, mode: AudioMode, alarm: AlarmState) -> Sound:
        """Returns one pulse every REMINDER_NS while an alarm of high or medium priority is active."""
        assert self._silent_since_ns is not None
        quiet_ns = now_ns - self._silent_since_ns
        due = SIGNALS[alarm.state].priority in (Priority.HIGH, Priority.MEDIUM) and quiet_ns >= REMINDER_NS
        began_ns = self._silent_since_ns + quiet_ns // REMINDER_NS * REMINDER_NS
        until_ns = self._paused_until_ns if mode is AudioMode.PAUSED else None
        return Sound(mode, int(due), began_ns, until_ns, off_reason=self._off_reason)


def pulses(state: State, fault: Fault | None) -> int:
    """Returns the pulses of a burst of the tone in this state, for this hazard; 0 is silence."""
    row = None if fault is None else FAULT_ROWS[fault].policy
    quiet = row is not None and row.silent and row.step_to(state) is not None
    return 0 if quiet else SIGNALS[state].pulses
