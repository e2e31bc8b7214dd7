"""`probewatch trend`: shows how the calibration drifts, from what the service logged over days."""

import sys
from math import isfinite
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from probewatch.appliance.core.quality.trend import Trend
from probewatch.appliance.storage.alarm_chain import Entry
from probewatch.tools.german.translation import recognised, told
from probewatch.tools.report.page import check_page
from probewatch.tools.report.trend_page import write_trend_page
from probewatch.tools.shared.alarm_history import settled_log, tell_damage
from probewatch.tools.shared.json_report import json_of, json_option
from probewatch.tools.shared.named_cart import cart_language, folder_argument
from probewatch.tools.shared.tables import FittingTable
from probewatch.tools.shared.trend_table import HEADINGS, references_of, row_of, trends, unit_of


@click.command()
@folder_argument
@click.option("--reference", type=click.IntRange(1), metavar="N", help="of the history; without it the latest")
@click.option("--html", "html_path", type=click.Path(path_type=Path), help="write a page with plots there")
@json_option
def command(folder: Path, reference: int | None, html_path: Path | None, as_json: bool) -> None:
    """Show which way each parameter of the calibration is drifting, long before it reaches its limit.

    While the calibration is verified the service notes every five minutes what motion showed of it, in the alarm log of
    FOLDER, [alarm] folder of the configuration. Where a weighted mean of these estimates (EWMA) leaves its
    control limits, something is moving: a part bends, slides or was exchanged, though each estimate by itself is still
    within its limit.

    \b
    Examples:
      probewatch trend
      probewatch trend --html trend.html
      probewatch trend --reference 3 --json

    Exit code 0: all steady. 1: something is moving or near its limit. 3: fewer than 13 estimates, nothing can be said.
    65: the alarm log is damaged; what it still holds is told. 78: the folder cannot be read.
    """
    check_page(html_path)
    reading, language = settled_log(folder), cart_language()
    entries = reading.entries
    number = reference if reference is not None else _latest(entries)
    found = {} if number is None else trends(entries, number)
    headings = [recognised(heading, language) for heading in HEADINGS]
    rows = [row_of(*one, language) for one in found.items()]
    if as_json:
        click.echo(json_of({"reference": number, "parameters": [_fields(*one) for one in found.items()]}))
    elif found:
        styles = ["yellow" if one.moving or one.near else "" for one in found.values()]
        Console(highlight=False).print(FittingTable(headings, rows, styles, right_from=1), crop=False)
    else:
        click.echo(_nothing(folder, number, references_of(entries), language))
    if html_path is not None:
        write_trend_page(html_path, number, found, {name: unit_of(name) for name in found}, headings, rows, language)
        click.echo(told("written: {file}", language, file=html_path), err=as_json)
    tell_damage(reading)
    sys.exit(65 if reading.broken else _code(found))


def _latest(entries: tuple[Entry, ...]) -> int | None:
    return next(reversed(references_of(entries)), None)


def _nothing(folder: Path, number: int | None, others: list[int], language: str) -> str:
    if number is not None and others and number not in others:
        held = ", ".join(map(str, others))
        other = "{folder} holds no estimates of reference {number}, only of {held}: give --reference {last}"
        return told(other, language, folder=folder, number=number, held=held, last=others[-1])
    none = "{folder} holds no estimates yet: the service notes one every five minutes while it is verified"
    return told(none, language, folder=folder)


def _code(found: dict[str, Trend]) -> int:
    if any(one.moving or one.near for one in found.values()):
        return 1
    return 0 if any(isfinite(one.high[-1]) for one in found.values()) else 3


def _fields(name: str, one: Trend) -> dict[str, Any]:
    return {
        "name": name,
        "unit": unit_of(name),
        "limit": one.limit,
        "estimates": len(one.estimates),
        "mean": float(one.mean[-1]),
        "control": [_known(float(one.low[-1])), _known(float(one.high[-1]))],
        "per_day": one.per_day if isfinite(one.per_day_sigma) else None,
        "per_day_sigma": _known(one.per_day_sigma),
        "days_left": _known(one.days_left),
        "moving": one.moving,
        "near": one.near,
    }


def _known(value: float) -> float | None:
    return value if isfinite(value) else None
