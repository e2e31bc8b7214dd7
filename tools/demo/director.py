"""Injects the demo's faults one after the other, at the pace of the service. It is pure: time is an argument.

A fault stays until the service has come to the last state to which it leads, and the next one waits until the
calibration has been verified again; so a slow machine gets the time it needs, and a fast one does not wait.
"""

from probewatch.appliance.types import State
from probewatch.drivers.twins.faults import Episode, Schedule
from probewatch.tools.demo.script import LONGEST_ON_S, LONGEST_RECOVERY_S, Injection, Planned, Script

_LEAD_S = 0.3
"""Seconds from an order to its effect: twins read their orders twenty times a second, and render ahead."""
_STEADY_S = 2.0
"""Seconds for which the service must have monitored before the next fault, and before the end."""
_FIRST_S = 60.0
"""Seconds that the first verification may take."""


class Director:
    """Decides which faults are on, one step per look at the service. orders: what the twins are to show."""

    def __init__(self, plan: tuple[Planned, ...]) -> None:
        self._plan = list(plan)
        self._over: list[Injection] = []
        self._on: Injection | None = None
        self._monitoring_s: float | None = None
        self._good_s, self._timeout_s = 0.0, _FIRST_S
        self.gave_up = False
        """Whether the calibration was not verified for so long that the rest of the plan makes no sense."""

    @property
    def shown(self) -> tuple[Injection, ...]:
        """Returns every fault up to now; the one that is on ends at the latest when it has had its time."""
        return (*self._over, *(() if self._on is None else (self._on,)))

    @property
    def orders(self) -> Schedule:
        """Returns these faults as a schedule for the twins."""
        return Schedule(tuple(Episode(one.fault, one.from_s, one.to_s) for one in self.shown))

    @property
    def upcoming(self) -> Planned | None:
        """Returns the next fault of the plan."""
        return self._plan[0] if self._plan else None

    def on(self, t_s: float) -> Injection | None:
        """Returns the fault that is on at t_s."""
        return next((one for one in self.shown if one.from_s <= t_s < one.to_s), None)

    def step(self, t_s: float, state: State) -> bool:
        """Takes the state of the service at t_s. Returns whether the orders have changed."""
        self._note(t_s, state)
        if self._on is not None:
            return self._take_out(self._on, t_s, state)
        self.gave_up = self.gave_up or t_s - self._good_s > self._timeout_s
        return not self.gave_up and self._put_in(t_s)

    def finished(self, t_s: float) -> bool:
        """Returns whether everything has been shown and the calibration is verified again, or will not be."""
        shown = bool(self._over) and not self._plan and self._on is None
        return self.gave_up or (shown and t_s > self._over[-1].to_s and self._steady(t_s))

    def script(self, end_s: float) -> Script:
        """Returns what was shown, when the run ends at end_s."""
        shown = tuple(Injection(one.fault, one.from_s, min(one.to_s, end_s)) for one in self.shown)
        return Script(shown, end_s, tuple(one.fault for one in self._plan))

    def _steady(self, t_s: float) -> bool:
        return self._monitoring_s is not None and t_s - self._monitoring_s >= _STEADY_S

    def _note(self, t_s: float, state: State) -> None:
        if state is not State.MONITORING:
            self._monitoring_s = None
        elif self._monitoring_s is None:
            self._monitoring_s = t_s
        if self._steady(t_s):
            self._good_s, self._timeout_s = t_s, LONGEST_RECOVERY_S

    def _take_out(self, on: Injection, t_s: float, state: State) -> bool:
        """Ends the fault that is on once the service has arrived; one that has had its time ends by the orders already
        given.
        """
        arrived = t_s >= on.from_s and state is on.states[-1]
        if not arrived and t_s < on.to_s:
            return False
        over = Injection(on.fault, on.from_s, min(on.to_s, t_s + _LEAD_S))
        self._over.append(over)
        self._on, self._good_s, self._monitoring_s = None, over.to_s, None
        return True

    def _put_in(self, t_s: float) -> bool:
        if not self._plan or t_s < self._plan[0].from_s or not self._steady(t_s):
            return False
        fault, from_s = self._plan.pop(0).fault, t_s + _LEAD_S
        self._on = Injection(fault, from_s, from_s + LONGEST_ON_S[fault])
        return True
