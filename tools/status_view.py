"""The status of a service as a picture for the terminal.

Colours mean the same everywhere: green verified, cyan not verified, yellow warning, red alarm or fault.
"""

from collections import defaultdict, deque
from collections.abc import Mapping
from typing import Any

from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

Status = Mapping[str, Any]

_BAR_CELLS = 9
_TREND_EVERY_S = 1.0
_STEPS = "▁▂▃▄▅▆▇█"
_COLOURS = {"OK": "green", "FAULT": "red", "NOT_VERIFIED": "cyan"}
_MARKS = {"OK": "✓", "FAULT": "✗", "NOT_VERIFIED": "?"}


class StatusView:
    """Draws one status after the other; remembers the ratios of the last seconds as trends."""

    def __init__(self) -> None:
        self._trends: defaultdict[str, deque[float]] = defaultdict(lambda: deque(maxlen=_BAR_CELLS))
        self._noted_s = -_TREND_EVERY_S

    def picture(self, status: Status) -> Group:
        """State, rates and every check: name, share of its limit as a bar or its trend, ratio, verdict."""
        checks = [*status["checks"], *status["devices"]]
        self._note(status["counters"].get("uptime_s", 0.0), checks)
        lines: list[RenderableType] = [_state(status), _rates(status), self._table(checks)]
        return Group(*lines, *_remarks(status), *_origin(status))

    def _note(self, uptime_s: float, checks: list[Mapping[str, Any]]) -> None:
        if uptime_s - self._noted_s < _TREND_EVERY_S:
            return
        self._noted_s = uptime_s
        for check in checks:
            if check["ratio"] is not None:
                self._trends[check["name"]].append(check["ratio"])

    def _table(self, checks: list[Mapping[str, Any]]) -> Table:
        """In two columns; the end of each bar is the limit."""
        table = Table.grid(padding=(0, 1))
        rows = (len(checks) + 1) // 2
        for left in range(rows):
            pair = [checks[at] for at in (left, left + rows) if at < len(checks)]
            table.add_row(*(cell for check in pair for cell in self._cells(check)))
        return table

    def _cells(self, check: Mapping[str, Any]) -> tuple[Text, Text, Text]:
        colour, ratio = _COLOURS[check["verdict"]], check["ratio"]
        trend = self._trends[check["name"]]
        bar = _trend(trend, colour) if len(trend) > 1 else _bar(0.0 if ratio is None else ratio, colour)
        number = "  –  " if ratio is None else f"{min(ratio, 99.99):5.2f}"
        return Text(check["name"], no_wrap=True), bar, Text(f"{number} {_MARKS[check['verdict']]}", style=colour)


def _bar(ratio: float, colour: str) -> Text:
    filled = round(_BAR_CELLS * min(ratio, 1.0))
    return Text.assemble(("━" * filled, colour), ("─" * (_BAR_CELLS - filled), "dim"), "┃")


def _trend(ratios: deque[float], colour: str) -> Text:
    """The last seconds, oldest first; a full cell is the limit."""
    cells = "".join(_STEPS[min(int(ratio * len(_STEPS)), len(_STEPS) - 1)] for ratio in ratios)
    return Text.assemble((cells.rjust(_BAR_CELLS), colour), "┃")


def _state(status: Status) -> Panel:
    lamp = status["lamp"]
    age_s = status["verification_age_s"]
    age = "not verified now" if age_s is None else f"verified {age_s:.1f} s ago"
    contact = "contact closed (safe)" if status["energised"] else "contact OPEN"
    lines = Text.assemble((status["text"], f"bold {lamp}"), f"\n{_advice(status)}\n", no_wrap=True, overflow="ellipsis")
    lines.append(f"{age} · {contact}{_latch(status)}", style=lamp)
    return Panel(lines, title=status["state"].upper(), title_align="left", border_style=lamp)


def _advice(status: Status) -> str:
    """What to do; in the calm states rather why they are what they are."""
    return str(status["remedy"] if status["fault"] is not None else status["reason"])


def _latch(status: Status) -> str:
    if status["latched"] is None:
        return ""
    return " · acknowledged" if status["acknowledged"] else " · not acknowledged"


def _rates(status: Status) -> Text:
    fps, counters, audio = status["fps"], status["counters"], status["audio"]
    drops = f"dropped: {counters['dropped_frames']} frames, {counters['dropped_poses']} poses"
    sound = "" if audio["mode"] == "on" else f" · audio {audio['mode']}"
    left = "" if audio["left_s"] is None else f" {audio['left_s']:.0f} s"
    line = f"video {fps['video']:.1f}/s · tracker {fps['tracker']:.1f}/s · {drops}{sound}{left}"
    return Text(line, no_wrap=True, overflow="ellipsis")


def _remarks(status: Status) -> list[Text]:
    """What needs no alarm, what is lost, and how the estimator ended."""
    lost = [f"{device}: {what}" for device, what in status["lost"].items()]
    ended = [] if status["estimator"] is None else [f"estimator: {status['estimator']}"]
    said = [*status["notices"], *status["remarks"], *lost, *ended]
    return [Text(f"! {line}", style="yellow", no_wrap=True, overflow="ellipsis") for line in said]


def _origin(status: Status) -> list[Text]:
    """Which reference the verdicts speak of, what keeps it from being verified, and what is not in force."""
    reference = status.get("reference")
    said = [] if reference is None else [_reference(reference)]
    waits, changed = status.get("reference_waits"), status.get("calibration_changed")
    said += [] if waits is None else [f"! reference: {waits}"]
    said += [] if changed is None else [f"! {changed}"]
    return [Text(line, style="yellow" if line.startswith("!") else "dim") for line in said]


def _reference(reference: Mapping[str, Any]) -> str:
    origin = f"{reference['origin']}, SIMULATED" if reference["simulated"] else str(reference["origin"])
    name, since = str(reference["file"]).rpartition("/")[2], str(reference["utc"])[:16].replace("T", " ")
    return f"reference {reference['number']} · {origin} · {name} · {reference['sha256'][:12]} · since {since} UTC"
