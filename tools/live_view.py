"""The demo on a terminal: one picture of the cart, redrawn in place.

Colours mean the same everywhere: green verified, cyan not verified, yellow warning, red alarm or fault.
"""

from collections import deque
from collections.abc import Mapping
from typing import Any, Self

from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from appliance.supervision.alarms import SIGNALS
from appliance.types import State
from tools.demo_script import Script

Status = Mapping[str, Any]

_REDRAWS_PER_S = 8
_BAR_CELLS = 12
_FIXED_LINES = 21
_COLOURS = {"OK": "green", "FAULT": "red", "NOT_VERIFIED": "cyan"}
_MARKS = {"OK": "✓", "FAULT": "✗", "NOT_VERIFIED": "?"}


class LiveView:
    """Draws while its context is open; event() adds a line to those shown at the bottom. picture: what is shown."""

    def __init__(self, console: Console, script: Script) -> None:
        self._script = script
        self._events: deque[Text] = deque(maxlen=max(3, console.height - _FIXED_LINES))
        self.picture = Group()
        self._live = Live(console=console, refresh_per_second=_REDRAWS_PER_S, transient=True)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def event(self, t_s: float, text: str, state: State | None = None) -> None:
        """state: the one that was entered, if any; it gives the line its colour."""
        colour = "" if state is None else SIGNALS[state].lamp.value
        self._events.append(Text(f"{t_s:7.2f} s  {text}", style=colour, no_wrap=True, overflow="ellipsis"))

    def show(self, t_s: float, status: Status) -> None:
        """The status as the service gave it at t_s."""
        checks = _checks([*status["checks"], *status["devices"]])
        self.picture = Group(_headline(t_s, self._script), _state(status), _rates(status), checks, *self._events)
        self._live.update(self.picture)


def _headline(t_s: float, script: Script) -> Text:
    on, after = script.on(t_s), script.next_after(t_s)
    text = Text(f"simulated cart  {t_s:6.1f} s   ", style="bold")
    if on is not None:
        text.append(f"fault on: {on.fault}, to be named {on.fault_class}", style="reverse")
    elif after is not None:
        text.append(f"next fault: {after.fault} in {after.from_s - t_s:.0f} s")
    else:
        text.append("no more faults")
    return text


def _state(status: Status) -> Panel:
    lamp = SIGNALS[State(status["state"])].lamp.value
    age_s = status["verification_age_s"]
    age = "not verified now" if age_s is None else f"verified {age_s:.1f} s ago"
    contact = "contact closed (safe)" if status["energised"] else "contact OPEN"
    lines = Text.assemble((status["text"], f"bold {lamp}"), f"\n{status['reason']}\n", f"{age} · {contact}", style=lamp)
    return Panel(lines, title=status["state"].upper(), title_align="left", border_style=lamp)


def _rates(status: Status) -> Text:
    fps, counters = status["fps"], status["counters"]
    drops = f"dropped: {counters['dropped_frames']} frames, {counters['dropped_poses']} poses"
    return Text(f"video {fps['video']:.1f}/s · tracker {fps['tracker']:.1f}/s · {drops}", no_wrap=True)


def _checks(checks: list[Mapping[str, Any]]) -> Table:
    """All checks in two columns; the end of each bar is the limit."""
    table = Table.grid(padding=(0, 1))
    rows = (len(checks) + 1) // 2
    for left in range(rows):
        pair = [checks[at] for at in (left, left + rows) if at < len(checks)]
        table.add_row(*(cell for check in pair for cell in _cells(check)))
    return table


def _cells(check: Mapping[str, Any]) -> tuple[Text, Text, Text]:
    colour, ratio = _COLOURS[check["verdict"]], check["ratio"]
    filled = 0 if ratio is None else round(_BAR_CELLS * min(ratio, 1.0))
    bar = Text.assemble(("━" * filled, colour), ("─" * (_BAR_CELLS - filled), "dim"), "┃")
    number = "  –  " if ratio is None else f"{min(ratio, 99.99):5.2f}"
    return Text(check["name"], no_wrap=True), bar, Text(f"{number} {_MARKS[check['verdict']]}", style=colour)
