"""Clocks that stand still until the test moves them, so that a busy computer changes nothing."""

import math
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from probewatch.drivers.clock.host_clock import HostClock

_GIVEN_UP_S = 60.0
"""Of real time for which a thread may compute or wait for a device before that is no test in simulated time."""
_LOOK_S = 0.002
"""Between two looks at the threads, while none of them says that it waits."""


@dataclass(frozen=True, slots=True)
class ManualClock(HostClock):
    """Shows the nanoseconds that the test has told it."""

    told_ns: list[int] = field(default_factory=lambda: [1_000_000_000_000])

    def real_ns(self) -> int:
        return self.told_ns[0]


@dataclass(frozen=True, slots=True)
class TimelessClock(ManualClock):
    """Of a simulated device: what it sends is there at once."""

    def sleep_until(self, t_ns: int) -> None:
        """Returns at once."""


@dataclass(slots=True)
class _Wait:
    """What a thread waits for: an event, or a time."""

    come: Callable[[], bool]
    until_ns: float


@dataclass(frozen=True, slots=True)
class SteppedClock(ManualClock):
    """Threads wait on it for a time or an event; the test moves it once all of them do.

    So each moment has passed in every thread before the next one begins, however slow the computer is.
    """

    _changed: threading.Condition = field(default_factory=threading.Condition)
    _waits: dict[int, _Wait] = field(default_factory=dict)
    _let_go: threading.Event = field(default_factory=threading.Event)

    def sleep_until(self, t_ns: int) -> None:
        self._hold(_Wait(lambda: False, t_ns))

    def wait(self, event: threading.Event, real_s: float | None) -> bool:
        if self._let_go.is_set():
            return event.wait(real_s)
        self._hold(_Wait(event.is_set, math.inf if real_s is None else self.now_ns() + real_s * 1e9))
        return event.is_set()

    def move(self, t_ns: int) -> None:
        """To that time, which is not before the present one."""
        assert t_ns >= self.now_ns()
        with self._changed:
            self.told_ns[0] = t_ns
            self._changed.notify_all()

    def settle(self, threads: Iterable[threading.Thread]) -> None:
        """Returns once each of them has ended, or waits for what has not come."""
        with self._changed:
            for _ in range(round(_GIVEN_UP_S / _LOOK_S)):
                self._changed.notify_all()  # an event may have been set since
                awake = [one for one in threads if one.is_alive() and not self._asleep(one)]
                if not awake:
                    return
                self._changed.wait(_LOOK_S)
        raise AssertionError(f"{', '.join(one.name for one in awake)}: busy for {_GIVEN_UP_S:g} s")

    def next_ns(self) -> float:
        """The first time for which a thread waits."""
        with self._changed:
            return min((wait.until_ns for wait in self._waits.values()), default=math.inf)

    def let_go(self, waits: bool) -> None:
        """Whether no thread waits for this clock any more, but for its events in real time: while a service ends."""
        with self._changed:
            (self._let_go.set if waits else self._let_go.clear)()
            self._changed.notify_all()

    def _asleep(self, thread: threading.Thread) -> bool:
        wait = self._waits.get(thread.ident or 0)
        return wait is not None and not self._over(wait)

    def _over(self, wait: _Wait) -> bool:
        return self._let_go.is_set() or self.now_ns() >= wait.until_ns or wait.come()

    def _hold(self, wait: _Wait) -> None:
        with self._changed:
            if self._over(wait):
                return
            self._waits[threading.get_ident()] = wait
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._over(wait))
            del self._waits[threading.get_ident()]
