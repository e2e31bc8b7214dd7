"""Decides what is logged while this computer is overloaded: that the overload began, the first change of each kind,
that it ended, and how often every other change came. Pure: time is an argument.
"""

from collections import Counter
from dataclasses import dataclass
from typing import Any

from probewatch.appliance.supervision.alarms import SILENCES
from probewatch.appliance.types import AlarmState, Fault


@dataclass(slots=True)
class _Episode:
    """Describes one overload.

    since_ns, losses: when it began, and the number of device losses until then. last: state after the last change.
    """

    since_ns: int
    losses: int
    changes: Counter[str]
    last: AlarmState | None = None


class OverloadNotes:
    """Tracks one overload after the other."""

    def __init__(self) -> None:
        self._episode: _Episode | None = None

    def begin(self, now_ns: int, losses: int) -> bool:
        """Records that this computer is overloaded. Returns True if that is new, so that it has to be reported."""
        if self._episode is not None:
            return False
        self._episode = _Episode(now_ns, losses, Counter())
        return True

    def end(self, now_ns: int, losses: int) -> dict[str, Any] | None:
        """Records that the overload is over. Returns what has to be reported of it; None when there was none.

        for_s: how long it lasted. device_losses: during it. repeated: change of state → how often it had no entry.
        state, fault: what the changes led to.
        """
        if self._episode is None:
            return None
        episode, self._episode = self._episode, None
        repeated = {change: times - 1 for change, times in episode.changes.items() if times > 1}
        for_s = round((now_ns - episode.since_ns) / 1e9, 1)
        last = {} if episode.last is None else {"state": episode.last.state.value, "fault": episode.last.fault}
        return {"for_s": for_s, "device_losses": losses - episode.losses, "repeated": repeated, **last}

    def worth_an_entry(self, before: AlarmState | None, alarm: AlarmState) -> bool:
        """Returns whether this change gets an entry of its own: the first of each kind during an overload, whatever
        latches or ends a latch, whatever is not the silence of a device, and everything while there is no overload.
        """
        if self._episode is None or Fault.OVERLOADED not in alarm.notices:
            return True
        self._episode.last = alarm
        own = alarm.fault is not None and alarm.fault not in SILENCES
        if own or alarm.latched is not None or (before is not None and before.latched is not None):
            return True
        change = alarm.state.value if alarm.fault is None else f"{alarm.state.value} ({alarm.fault})"
        self._episode.changes[change] += 1
        return self._episode.changes[change] == 1
