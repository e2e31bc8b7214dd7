"""Watches this computer for the tick: delay, sleep, steps of the wall clock, the disk of the log."""

import time
from collections.abc import Callable
from typing import Any

from probewatch.appliance.service.host.log import get_log
from probewatch.appliance.service.host.overload_watch import OverloadWatch
from probewatch.appliance.service.host.pressure import Pressure
from probewatch.appliance.service.host.recorder import Recorder
from probewatch.appliance.service.host.sleep_watch import Bounds, SleepWatch, slept_ns
from probewatch.appliance.service.host.tick_meter import TickMeter
from probewatch.appliance.service.host.wall_clock import WallClock
from probewatch.appliance.storage.alarm_chain import Event
from probewatch.drivers.clock.host_clock import HostClock


class HostWatch:
    """Watches this computer. period_ns: how often the tick is due. note: writes an entry of the alarm log. wall_ns:
    calendar time, ns. slept: as in `SleepWatch`. overload, ticks: what was measured. woke: whether the computer has
    slept since the last tick.
    """

    def __init__(
        self,
        period_ns: int,
        recorder: Recorder,
        note: Callable[..., None],
        clock: HostClock,
        pressure: Pressure,
        wall_ns: Callable[[], int] = time.time_ns,
        slept: Callable[[], Bounds] = slept_ns,
    ) -> None:
        self.overload = OverloadWatch(period_ns, note, clock, pressure)
        self.ticks = TickMeter(period_ns)
        self._wall_clock, self._wall_ns, self._clock = WallClock(), wall_ns, clock
        self._sleep = SleepWatch(slept)
        self.woke = False
        self._recorder, self._note = recorder, note
        self._log = get_log()

    def begin_tick(self, now_ns: int) -> None:
        """Begins a tick, before anything else is done in it."""
        self.ticks.note(now_ns)
        by_s = self._wall_clock.look(self._clock.real_ns(), self._wall_ns())
        if by_s is not None:
            self._log.warning("wall clock stepped", by_s=round(by_s, 3))
            self._note(Event.WALL_CLOCK, by_s=round(by_s, 3))
        self._look_for_sleep()
        self._recorder.watch(self.overload.since_ns is not None)

    def _look_for_sleep(self) -> None:
        for_s = self._sleep.look()
        self.woke = for_s is not None
        if for_s is not None:
            self._log.warning("the computer slept", for_s=round(for_s, 3))
            self._note(Event.SLEPT, for_s=round(for_s, 3))

    def fields(self, now_ns: int) -> dict[str, Any]:
        """Returns the fields for the status."""
        return {"tick": self.ticks.fields(), "load": self.overload.fields(now_ns)}
