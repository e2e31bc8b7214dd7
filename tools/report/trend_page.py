"""The page of a trend: each parameter's weighted mean over days, its control limits, and the limit of its check."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from appliance.core.quality.trend import DAY_S, Trend
from tools.report.page import section, table, text, write_page
from tools.report.svg import Plot


def write_trend_page(
    path: Path,
    reference: int | None,
    trends: Mapping[str, Trend],
    units: Mapping[str, str],
    headings: Sequence[str],
    rows: Sequence[Sequence[str]],
) -> None:
    """Writes the page of trends. units: of each parameter; rows: as the command prints them. Raises ConfigurationError
    for a bad path.
    """
    parts = [
        f"<h1>Trend under reference {reference if reference is not None else '–'}</h1>",
        text("Line: weighted mean. Band: its control limits. Dashed: the limit of the check.", "note"),
        section("Now", table(headings, rows)),
        section("Over days", *(_plot(name, one, units[name]) for name, one in trends.items() if one.estimates)),
    ]
    write_page(path, "probewatch: trend", parts)


def _plot(name: str, one: Trend, unit: str) -> str:
    first_s = one.estimates[0].utc_s
    days = [(estimate.utc_s - first_s) / DAY_S for estimate in one.estimates]
    plot = Plot((0.0, max(days[-1], 1e-3)), (-1.2 * one.limit, 1.2 * one.limit), "days", f"{name}, {unit}", 180)
    plot.band(days, one.low.tolist(), one.high.tolist(), "a")
    plot.line(days, [estimate.value for estimate in one.estimates], "b", "estimates")
    plot.line(days, one.mean.tolist(), "a", "weighted mean")
    for limit in (one.limit, -one.limit):
        plot.level(limit)
    return plot.svg(f"{name} over days")
