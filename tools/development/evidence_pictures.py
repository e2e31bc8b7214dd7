"""Draws the pictures of docs/coverage.md and docs/evidence.md except the ROC. It is pure."""

from collections.abc import Iterable, Sequence
from statistics import median

from probewatch.tools.development.evidence_figures import Found, Healthy
from probewatch.tools.report.svg import Plot, alone

_ROW, _FRAME = 22, 50
"""Height of one line of a drawing, and of its axis, units of the drawing: labels of 12 units do not touch."""
_MOST_DELAY_S = 10.0
"""Seconds: right edge of the drawing of delays; what is later is drawn at the edge."""


def coverage_picture(healthy: list[Healthy]) -> str:
    bars = [
        (f"{one.origin.session}, {one.origin.tissue}, {one.origin.asked}", [100 * share for share in one.closed],
         "b" if one.origin.tissue == "breathing" else "a")
        for one in healthy
    ]  # fmt: skip
    plot = Plot(
        (0, 100),
        (0, max(len(bars), 1)),
        "% of the session; bar: median, marks: runs; blue: still, orange: breathing",
        "",
        _height(bars),
    )
    for row, (name, shares, kind) in enumerate(bars):
        y = len(bars) - row
        plot.block(0, median(shares), y - 0.9, y - 0.1, kind, name)
        _marks(plot, shares, y, 0.3)
        plot.word(0, y - 0.6, name)
    return alone(plot.svg("share of each session with the contact closed"))


def sensitivity_picture(found: list[Found]) -> str:
    plot = Plot(
        (0, 100),
        (0, max(len(found), 1)),
        "% of runs with a FAULT; bar: share, marks: 95 % interval",
        "",
        _height(found),
    )
    for row, one in enumerate(found):
        y = len(found) - row
        plot.block(0, 100 * len(one.fault_s) / one.runs, y - 0.9, y - 0.1, "a", one.hazard)
        _marks(plot, [100 * edge for edge in one.share.interval], y, 0.3)
        plot.word(0, y - 0.6, f"{one.hazard}, {one.origin.session}")
    return alone(plot.svg("share of runs in which each hazard was found"))


def delay_picture(found: list[Found]) -> str:
    seen = [one for one in found if one.fault_s]
    label = f"delay of the FAULT, s, later than {_MOST_DELAY_S:g} at the edge; bar: median, marks: runs, red: bound"
    plot = Plot((0, _MOST_DELAY_S), (0, max(len(seen), 1)), label, "", _height(seen))
    for row, one in enumerate(seen):
        y = len(seen) - row
        plot.block(0, median(one.fault_s), y - 0.9, y - 0.1, "a", one.hazard)
        _marks(plot, one.fault_s, y, 0.02)
        if one.bound_s is not None:
            plot.block(one.bound_s, one.bound_s + 0.04, y - 1, y, "bad", f"bound {one.bound_s:.2f} s")
        plot.word(0, y - 0.6, f"{one.hazard}, {one.origin.session}")
    return alone(plot.svg("delays of the FAULT and their bounds"))


def _marks(plot: Plot, places: Iterable[float], y: float, wide: float) -> None:
    for x in places:
        plot.block(x, x + wide, y - 0.75, y - 0.25, "mark", f"{x:.3g}")


def _height(rows: Sequence[object]) -> int:
    return _ROW * len(rows) + _FRAME
