"""Writes the page of a trend: each parameter's weighted mean over days, its control limits, and its check's limit."""

import html
from collections.abc import Mapping, Sequence
from pathlib import Path

from probewatch.appliance.core.quality.trend import DAY_S, Trend
from probewatch.tools.german.translation import Speech
from probewatch.tools.report.page import section, table, text, write_page
from probewatch.tools.report.svg import Plot


def write_trend_page(
    path: Path,
    reference: int | None,
    trends: Mapping[str, Trend],
    units: Mapping[str, str],
    headings: Sequence[str],
    rows: Sequence[Sequence[str]],
    language: str = "en",
) -> None:
    """Writes the page of trends in the language. units: that of each parameter; headings, rows: as the command prints
    them. Raises ConfigurationError for a bad path.
    """
    speech = Speech(language)
    number = reference if reference is not None else "–"
    plots = (_plot(name, one, units[name], speech) for name, one in trends.items() if one.estimates)
    legend = "Line: weighted mean. Band: its control limits. Dashed: the limit of the check."
    parts = [
        f"<h1>{html.escape(speech.tell('Trend under reference {number}', number=number))}</h1>",
        text(speech.tell(legend), "note"),
        section(speech.tell("Now"), table(headings, rows)),
        section(speech.tell("Over days"), *plots),
    ]
    write_page(path, speech.tell("probewatch: trend"), parts, language)


def _plot(name: str, one: Trend, unit: str, speech: Speech) -> str:
    first_s = one.estimates[0].utc_s
    days = [(estimate.utc_s - first_s) / DAY_S for estimate in one.estimates]
    said, high = speech.recognise(name), 1.2 * one.limit
    figure = f"{said}, {speech.recognise(unit)}"
    plot = Plot((0.0, max(days[-1], 1e-3)), (-high, high), speech.tell("days"), figure, 180)
    plot.band(days, one.low.tolist(), one.high.tolist(), "a")
    plot.line(days, [estimate.value for estimate in one.estimates], "b", speech.tell("estimates"))
    plot.line(days, one.mean.tolist(), "a", speech.tell("weighted mean"))
    for limit in (one.limit, -one.limit):
        plot.level(limit)
    return plot.svg(speech.tell("{parameter} over days", parameter=said))
