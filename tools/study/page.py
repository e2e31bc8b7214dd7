"""Writes the page of a study: one HTML file with plots and tables, which opens without a network."""

from __future__ import annotations

import html
import importlib.util
import io
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from probewatch.appliance.core.parameters import MEASURED
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.atomic_file import PAGE_BEGINS, check_replaceable, writing
from probewatch.tools.shared.tables import figures_in
from probewatch.tools.study.session import FPS
from probewatch.tools.study.summary import (
    Coverage,
    Detection,
    Row,
    coverages,
    detections,
    false_rate_per_hour,
    healthy_hours,
)
from probewatch.tools.study.table import CODE, INSTALL

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STILL, _BREATHING, _BAD = "#2f6fab", "#c77c11", "#b3261e"
"""Colours mean one thing on the whole page: still tissue, breathing, and what ought not to be; blue and orange are
distinguishable by those who cannot distinguish red from green."""
_WIDE_IN = 10.0
"""Inches: width of every plot, a page on a laptop's screen."""
_STYLE = """
:root { color-scheme: light; font: 15px/1.5 system-ui, sans-serif; }
body { max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #1c1b1f; background: #fff; }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .2rem .7rem; border-bottom: 1px solid #ddd; text-align: left; }
th.figure, td.figure { text-align: right; } td.bad { color: #b3261e; font-weight: 600; }
svg { max-width: 100%; height: auto; } .note { color: #555; }
"""


def check_page(path: Path) -> None:
    """Raises ConfigurationError where matplotlib is not installed or the file cannot be written or replaced."""
    if importlib.util.find_spec("matplotlib") is None:
        remedy = INSTALL
        raise ConfigurationError("the page needs the package matplotlib", str(path), remedy)
    check_replaceable(path, PAGE_BEGINS)


def _fault_rates(healthy: Sequence[Coverage], hours: float) -> Iterator[str]:
    """Yields a paragraph for each judgement of the same pictures. hours: of these."""
    for asked, profile in sorted({(one.asked, one.profile) for one in healthy}):
        faulted = sum(one.faulted.k for one in healthy if (one.asked, one.profile) == (asked, profile))
        rate = f"under {false_rate_per_hour(faulted, hours):.2g} per hour (95 %)"
        yield f"<p>Runs with a FAULT, {asked}, {profile}: {faulted}; {rate}.</p>"


def write_page(path: Path, rows: Sequence[Row]) -> None:
    """Writes the page. Raises ConfigurationError where the file cannot be written. matplotlib must be installed:
    `check_page`.
    """
    healthy, sick = coverages(rows), detections(rows)
    hours = healthy_hours(rows, FPS)
    parts = [
        "<h1>probewatch study</h1>",
        f"<p class=note>{len(rows)} runs · {hours:.2f} h of healthy scanning · code {html.escape(_codes(rows))} · "
        f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC. Simulated tissue and motion; real tissue is not in it.</p>",
    ]
    if healthy:
        parts += [
            "<h2>Contact closed, healthy sessions</h2>",
            _svg(_coverage_plot(healthy)),
            *_fault_rates(healthy, hours),
            _coverage_table(healthy),
            "<h2>What each parameter is known to</h2>",
            "<p class=note>Left: stated sigma ÷ least sigma that 30 s of the motion allow (Cramér–Rao). Right: RMS of "
            "(value − truth) ÷ stated sigma; 1 is honest, more is overconfident.</p>",
            _svg(_truth_plot(healthy)),
        ]
    if sick:
        parts += ["<h2>Hazards</h2>", _svg(_hazard_plot(sick)), _hazard_table(sick)]
    head = f"<html lang=en><meta charset=utf-8><title>probewatch study</title><style>{_STYLE}</style>"
    with writing(path) as stream:
        stream.write(PAGE_BEGINS + (head + "\n".join(parts) + "</html>\n").encode())


def _codes(rows: Sequence[Row]) -> str:
    return ", ".join(sorted({row[CODE] for row in rows})) or "–"


def _axes(rows: int, columns: int = 1) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure  # noqa: PLC0415  an extra that a cart does not have

    figure = Figure(figsize=(_WIDE_IN, 0.34 * rows + 1.2), layout="constrained")
    axes = figure.subplots(1, columns, sharey=True, squeeze=False)[0]
    for one in axes:
        one.spines[["top", "right"]].set_visible(False)
        one.grid(axis="x", color="#e4e4e4")
        one.set_axisbelow(True)
    return figure, list(axes)


def _svg(figure: Figure) -> str:
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()[text.getvalue().index("<svg") :]


def _colour(tissue: str) -> str:
    return _BREATHING if tissue == "breathing" else _STILL


def _coverage_plot(healthy: list[Coverage]) -> Figure:
    figure, (axes,) = _axes(len(healthy))
    for place, one in enumerate(reversed(healthy)):
        closed = [100 * share for share in one.closed]
        axes.barh(place, one.spread[1], color=_colour(one.tissue), alpha=0.35)
        axes.plot(closed, [place] * len(closed), "o", color=_colour(one.tissue), markersize=4)
    axes.set_yticks(range(len(healthy)), [_title(one) for one in reversed(healthy)])
    axes.set(
        xlim=(0, 101), xlabel="% of the session; bar: median, dot: one seed; blue: still tissue, orange: breathing"
    )
    return figure


def _truth_plot(healthy: list[Coverage]) -> Figure:
    figure, (ratio, rms) = _axes(len(MEASURED) + 2, 2)
    for place, name in enumerate(reversed(MEASURED)):
        for one in healthy:
            scores = one.scores[name]
            for axes, value in ((ratio, scores.ratio), (rms, scores.rms)):
                if isfinite(value) and value > 0:
                    axes.plot(value, place, "o", color=_colour(one.tissue), markersize=5, alpha=0.7)
    for axes, label in ((ratio, "sigma ÷ bound"), (rms, "RMS z-score")):
        axes.set_xscale("log")
        axes.axvline(1.0, color="#888", linewidth=1)
        axes.set_xlabel(label)
    ratio.set_yticks(range(len(MEASURED)), list(reversed(MEASURED)))
    return figure


def _hazard_plot(sick: list[Detection]) -> Figure:
    figure, (found, delay) = _axes(len(sick), 2)
    for place, one in enumerate(reversed(sick)):
        low, high = one.found.interval
        found.barh(place, 100 * one.found.k / one.found.n, color=_STILL, alpha=0.35)
        found.plot([100 * low, 100 * high], [place, place], color=_STILL, linewidth=1.5)
        if isfinite(one.fault_s):
            delay.plot(max(one.fault_s, 0.03), place, "o", color=_STILL)
        if one.gross.k:
            found.plot(101, place, "X", color=_BAD, clip_on=False)
    found.set_yticks(range(len(sick)), [_wrong(one) for one in reversed(sick)])
    found.set(xlim=(0, 101), xlabel="% of runs with a FAULT (line: 95 %); red cross: told OK at twice its limit")
    delay.set(xscale="log", xlabel="median delay of the FAULT, s")
    return figure


def _title(one: Coverage) -> str:
    return f"{one.session}, {one.tissue}, {one.noise_mm} mm, {one.asked}, {one.profile}"


def _wrong(one: Detection) -> str:
    return f"{one.hazard}, {one.profile}"


def _coverage_table(healthy: list[Coverage]) -> str:
    heads = ("session", "closed, median", "range", "first closed", "runs with FAULT")
    return _table(heads, [_coverage_cells(one) for one in healthy])


def _coverage_cells(one: Coverage) -> list[str]:
    least, middle, most = one.spread
    return [
        _title(one),
        f"{middle:.0f} %",
        f"{least:.0f} to {most:.0f} %",
        f"{one.closed_s:.1f} s" if isfinite(one.closed_s) else "never",
        f"!{one.faulted}" if one.faulted.k else str(one.faulted),
    ]


def _hazard_table(sick: list[Detection]) -> str:
    heads = ("hazard", "FAULT", "named rightly first", "delay, median", "contact open after", "OK at twice its limit")
    rows = [
        [
            _wrong(one),
            str(one.found),
            str(one.named),
            f"{one.fault_s:.1f} s" if isfinite(one.fault_s) else "–",
            f"{one.opened_s:.1f} s" if isfinite(one.opened_s) else "–",
            f"!{one.gross}" if one.gross.k else str(one.gross),
        ]
        for one in sick
    ]
    return _table(heads, rows)


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Returns a table, its figures aligned on the right. A cell that begins with "!" ought not to be."""
    figures = figures_in(rows) or (False,) * len(heads)
    head = "".join(
        f"<th{' class=figure' * figure}>{html.escape(text)}" for text, figure in zip(heads, figures, strict=True)
    )
    body = "".join("<tr>" + "".join(map(_html_cell, row, figures)) for row in rows)
    return f"<table><tr>{head}{body}</table>"


def _html_cell(text: str, figure: bool) -> str:
    kinds = [kind for kind in ("figure" * figure, "bad" * text.startswith("!")) if kind]
    names = f' class="{" ".join(kinds)}"' if kinds else ""
    return f"<td{names}>{html.escape(text.removeprefix('!'))}"
