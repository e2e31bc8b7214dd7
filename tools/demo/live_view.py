"""Shows the demo on a terminal: one picture of the cart, redrawn in place."""

from collections import deque
from typing import Self

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from probewatch.appliance.supervision.alarms import SIGNALS
from probewatch.appliance.types import State
from probewatch.tools.demo.director import Director
from probewatch.tools.shared.status_view import Status, StatusView

_REDRAWS_PER_S = 8
"""Redraws a second: enough to be seen as motion; each takes time from the simulated cart on the same machine."""
_FIXED_LINES = 22
"""Lines of the headline and the status; the events get what is left of the terminal. Fewer let the picture outgrow
it."""


class LiveView:
    """Draws while its context is open; event() adds a line to those shown at the bottom. picture: what is shown."""

    def __init__(self, console: Console, director: Director) -> None:
        self._director = director
        self._events: deque[Text] = deque(maxlen=max(1, console.height - _FIXED_LINES))
        self._status = StatusView()
        self.picture = Group()
        self._live = Live(console=console, refresh_per_second=_REDRAWS_PER_S, transient=True)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def event(self, t_s: float, text: str, state: State | None = None) -> None:
        """Adds an event. state: the one that was entered, if any; it gives the line its colour."""
        colour = "" if state is None else SIGNALS[state].lamp.value
        self._events.append(Text(f"{t_s:7.2f} s  {text}", style=colour, no_wrap=True, overflow="ellipsis"))

    def show(self, t_s: float, status: Status) -> None:
        """Shows the status as the service gave it at t_s."""
        self.picture = Group(_headline(t_s, self._director), self._status.picture(status), *self._events)
        self._live.update(self.picture)


def _headline(t_s: float, director: Director) -> Text:
    on, after = director.on(t_s), director.upcoming
    text = Text(f"simulated cart  {t_s:6.1f} s   ", style="bold")
    if on is not None:
        text.append(f"fault on: {on.fault}, to be named {on.fault_class}", style="reverse")
    elif after is not None:
        when = f"in {after.from_s - t_s:.0f} s" if after.from_s > t_s else "once the calibration is verified"
        text.append(f"next fault: {after.fault} {when}")
    else:
        text.append("no more faults")
    return text
