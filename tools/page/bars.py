"""Describes each of the ten quantities as a bar against its limit, its value rounded to its sigma. Pure."""

from collections.abc import Mapping, Sequence
from math import floor, log10
from typing import Any

from probewatch.appliance.core.parameters import MEASURED
from probewatch.appliance.supervision.languages import translated_text
from probewatch.appliance.types import Fault
from probewatch.tools.page.wording import figures

NAMES = (Fault.POLARITY.value, *MEASURED)
"""Names of the rows, in their order."""
_FINEST = 1000
"""Parts of the limit below which no figure is shown: a smaller sigma counts as none, and a smaller value as 0. More
shows figures that nobody can use."""

Row = dict[str, Any]


def bars(checks: Sequence[Mapping[str, Any]], language: str) -> list[Row]:
    """Returns a row for each of NAMES, also where nothing is known of it: title, text, limit, share and sigma_share (of
    the limit, signed; None where not known), mark (shown, carried, missing, wrong), age_s, max_age_s.
    """
    known = {check["name"]: check for check in checks}
    return [_row(name, known.get(name), language) for name in NAMES]


def _row(name: str, check: Mapping[str, Any] | None, language: str) -> Row:
    row: Row = {"name": name, "title": translated_text(name, language), "text": "–", "limit": "", "mark": "missing"}
    row |= {"share": None, "sigma_share": None, "age_s": None, "max_age_s": None}
    if check is None:
        return row
    value, sigma, limit = check["value"], check["sigma"], check["limit"]
    row |= {"mark": _mark(check), "age_s": check["shown_age_s"], "max_age_s": check.get("max_age_s")}
    if value is None or not limit:
        return row
    return row | {
        "text": _text(name, value, sigma, check["unit"], limit, language),
        "limit": "" if name == Fault.POLARITY else _with_unit(f"{limit:g}", check["unit"], language),
        "share": value / limit,
        "sigma_share": (sigma or 0.0) / limit,
    }


def _mark(check: Mapping[str, Any]) -> str:
    if check["verdict"] == "FAULT":
        return "wrong"
    if check.get("carried"):  # whatever the present motion shows, short of a fault
        return "carried"
    return "missing" if check["verdict"] != "OK" or check.get("shown") == "missing" else "shown"


def _text(name: str, value: float, sigma: float | None, unit: str, limit: float, language: str) -> str:
    if name == Fault.POLARITY:
        return "mirrored" if abs(value) > limit else "as calibrated"
    return _with_unit(rounded(value, sigma, limit), unit, language)


def _with_unit(figure: str, unit: str, language: str) -> str:
    """Returns the value with its unit and the decimal sign of the language."""
    return figures(figure, language) + ("°" if unit == "deg" else f" {unit}")


def rounded(value: float, sigma: float | None, limit: float) -> str:
    """Returns the value to the last figure that its sigma justifies, and the sigma to one figure, two where it begins
    with 1; without a sigma, to a thousandth of the limit at most.
    """
    finest = limit / _FINEST
    if sigma is None or sigma < finest:
        return _figure(value, max(0, 2 - floor(log10(limit))))
    places = -floor(log10(sigma))
    if f"{sigma:.0e}".startswith("1"):
        places = -floor(log10(float(f"{sigma:.0e}"))) + 1
    return f"{_figure(value, places)} ± {_figure(sigma, places)}"


def _figure(value: float, places: int) -> str:
    """Returns the figure without a sign before 0, and with a minus as long as a digit."""
    text = f"{round(value, places):.{max(places, 0)}f}"
    negative = text.startswith("-") and any(sign in text for sign in "123456789")
    return ("\u2212" if negative else "") + text.removeprefix("-")
