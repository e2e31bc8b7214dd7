"""Writes references, and differences between calibrations, as text."""

from pathlib import Path
from typing import Any

import click

from probewatch.appliance.core.quality.calibration_difference import Difference
from probewatch.appliance.storage.reference_store import Entry
from probewatch.tools.german.translation import recognised, told


def entry_headings(language: str) -> tuple[str, ...]:
    """Returns the headings of a table of references."""
    since, origin = told("since, UTC", language), told("origin", language)
    return told("no.", language), "", since, origin, told("verified", language), told("file", language), "SHA-256"


def entry_cells(entry: Entry, language: str) -> tuple[str, ...]:
    """Returns the cells of a reference, which belong below `entry_headings` from the third on."""
    verified = told("no", language) if entry.verified_utc is None else utc_text(entry.verified_utc)
    return utc_text(entry.utc), _origin(entry, language), verified, Path(entry.file).name, entry.sha256[:12]


def _origin(entry: Entry, language: str) -> str:
    origin = recognised(entry.origin, language)
    return f"{origin}, {recognised('SIMULATED', language)}" if entry.simulated else origin


def utc_text(utc: str) -> str:
    """Returns a time as a person reads it."""
    return utc.replace("T", " ").removesuffix("+00:00")


def entry_lines(entry: Entry, in_force: bool, language: str) -> list[tuple[str, str]]:
    """Returns (name, text) of everything known about a reference."""
    width, height = entry.image_size_px

    def tell(text: str) -> str:
        return told(text, language)

    now = f" ({tell('in force')})" if in_force else ""
    verified = tell("not yet") if entry.verified_utc is None else f"{utc_text(entry.verified_utc)} UTC"
    lines = [
        (tell("reference"), f"{entry.number}{now}"),
        (tell("origin"), _origin(entry, language)),
        (tell("since"), f"{utc_text(entry.utc)} UTC, software {entry.software}"),
        (tell("verified"), verified),
        (tell("file"), entry.file),
        ("SHA-256", entry.sha256),
        (tell("pictures"), f"{width} x {height} px"),
    ]
    lines += [(tell("asked by"), entry.who)] if entry.who else []
    change = recognised(entry.difference or "", language)
    lines += [(tell("difference"), f"{change} ({tell('from the one before')})")] if change else []
    unseen = ", ".join(recognised(name, language) for name in entry.to_show)
    lines += [(tell("must show"), unseen)] if unseen and entry.verified_utc is None else []
    return lines


def numbers_text(values: Any, digits: int) -> str:
    """Returns the numbers with that number of digits after the point."""
    return ", ".join(f"{value:.{digits}f}" for value in values)


def print_difference(change: Difference, language: str) -> None:
    """Prints the difference between two calibrations."""
    lateral, axial, elevational = change.offset_mm
    same, sizes = told("the same", language), change.image_size_px
    rows = [
        ("rotation", f"{change.rotation_deg:.2f}°"),
        ("offset", f"{change.distance_mm:.2f} mm (lateral {lateral:+.2f}, axial {axial:+.2f}, ζ {elevational:+.2f})"),
        ("scales", f"{change.scale_percent[0]:+.2f} % lateral, {change.scale_percent[1]:+.2f} % axial"),
        ("polarity", same if change.same_polarity else told("differs", language)),
        (
            "picture size",
            same if sizes is None else told("{one} and {other} px", language, one=sizes[0], other=sizes[1]),
        ),
    ]
    for name, text in rows:
        click.echo(f"{recognised(name, language):<14}{text}")
