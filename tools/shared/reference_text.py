"""References, and differences of calibrations, as text."""

from pathlib import Path
from typing import Any

import click

from appliance.core.quality.calibration_difference import Difference
from appliance.storage.reference_store import Entry

ENTRY_HEADINGS = ("no.", "", "since, UTC", "origin", "verified", "file", "SHA-256")


def entry_cells(entry: Entry) -> tuple[str, ...]:
    """Returns the cells of a reference, below ENTRY_HEADINGS from the third on."""
    verified = "no" if entry.verified_utc is None else utc_text(entry.verified_utc)
    return utc_text(entry.utc), _origin(entry), verified, Path(entry.file).name, entry.sha256[:12]


def _origin(entry: Entry) -> str:
    return f"{entry.origin}, SIMULATED" if entry.simulated else entry.origin


def utc_text(utc: str) -> str:
    """Returns a time as a person reads it."""
    return utc.replace("T", " ").removesuffix("+00:00")


def entry_lines(entry: Entry, in_force: bool) -> list[tuple[str, str]]:
    """Returns (name, text) of all that is known of a reference."""
    width, height = entry.image_size_px
    lines = [
        ("reference", f"{entry.number}{' (in force)' if in_force else ''}"),
        ("origin", _origin(entry)),
        ("since", f"{utc_text(entry.utc)} UTC, software {entry.software}"),
        ("verified", "not yet" if entry.verified_utc is None else f"{utc_text(entry.verified_utc)} UTC"),
        ("file", entry.file),
        ("SHA-256", entry.sha256),
        ("pictures", f"{width} x {height} px"),
    ]
    lines += [("asked by", entry.who)] if entry.who else []
    lines += [("difference", f"{entry.difference} (from the one before)")] if entry.difference else []
    lines += [("must show", ", ".join(entry.to_show))] if entry.to_show and entry.verified_utc is None else []
    return lines


def numbers_text(values: Any, digits: int) -> str:
    """Returns the numbers with so many digits behind the point."""
    return ", ".join(f"{value:.{digits}f}" for value in values)


def print_difference(change: Difference) -> None:
    """Prints the difference of two calibrations."""
    lateral, axial, elevational = change.offset_mm
    rows = [
        ("rotation", f"{change.rotation_deg:.2f}°"),
        ("offset", f"{change.distance_mm:.2f} mm (lateral {lateral:+.2f}, axial {axial:+.2f}, ζ {elevational:+.2f})"),
        ("scales", f"{change.scale_percent[0]:+.2f} % lateral, {change.scale_percent[1]:+.2f} % axial"),
        ("polarity", "the same" if change.same_polarity else "differs"),
        ("picture size", "the same" if change.image_size_px is None else "{} and {} px".format(*change.image_size_px)),
    ]
    for name, text in rows:
        click.echo(f"{name:<14}{text}")
