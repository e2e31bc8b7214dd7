"""Tracks how short of time this computer is, and reports it: once when an overload begins, once when it has ended."""

import math
from collections.abc import Callable
from typing import Any

from probewatch.appliance.service.host.log import get_log
from probewatch.appliance.service.host.pressure import Pressure
from probewatch.appliance.storage.alarm_chain import Event
from probewatch.appliance.supervision.alarms import HAZARDS
from probewatch.appliance.supervision.overload import Load, Overload
from probewatch.appliance.supervision.overload_notes import OverloadNotes
from probewatch.appliance.types import AlarmState, Check, Fault
from probewatch.drivers.clock.host_clock import HostClock


class OverloadWatch:
    """Tracks overload, one step a tick. period_ns: how often the tick is due. note: writes an entry of the alarm log.
    pressure: that of this computer, which is closed at the end.
    """

    def __init__(self, period_ns: int, note: Callable[..., None], clock: HostClock, pressure: Pressure) -> None:
        self._overload, self._notes = Overload(period_ns), OverloadNotes()
        self._clock, self._pressure = clock, pressure
        self._load = Load()
        self._note = note
        self._log = get_log()

    @property
    def since_ns(self) -> int | None:
        """Returns when the present overload began, None while there is none."""
        return self._overload.since_ns

    def step(self, now_ns: int, waiting_frames: int, losses: int) -> Check:
        """Returns the check to add to those of the device watchers. losses: of devices, since the start."""
        self._load = Load(self._pressure.share(self._clock.real_ns()), waiting_frames)
        check = self._overload.step(now_ns, self._load)
        if self.since_ns is None:
            self._end(now_ns, losses)
        elif self._notes.begin(now_ns, losses):
            said, hazard = self.fields(now_ns), HAZARDS[Fault.OVERLOADED]
            self._log.warning("overloaded", what=hazard.text, remedy=hazard.remedy, **said)
            self._note(Event.OVERLOADED, **said)
        return check

    def worth_an_entry(self, before: AlarmState | None, alarm: AlarmState) -> bool:
        """Returns whether this change of state gets an entry of its own, see OverloadNotes."""
        return self._notes.worth_an_entry(before, alarm)

    def fields(self, now_ns: int) -> dict[str, float | None]:
        """Returns the fields for status and log. Shares are of the last second."""
        pressure, since_ns = self._overload.pressure, self.since_ns
        return {
            "pressure": None if math.isnan(pressure) else round(pressure, 3),
            "late": round(self._overload.late, 3),
            "waiting_frames": self._load.waiting,
            "overloaded_s": None if since_ns is None else (now_ns - since_ns) / 1e9,
        }

    def close(self, now_ns: int, losses: int) -> None:
        """Reports what was counted, as the service ends."""
        self._end(now_ns, losses)
        self._pressure.close()

    def _end(self, now_ns: int, losses: int) -> None:
        ended: dict[str, Any] | None = self._notes.end(now_ns, losses)
        if ended is not None:
            self._log.info("overload ended", **ended)
            self._note(Event.OVERLOAD_ENDED, **ended)
