"""The page on profiles is computed from the rows of a study."""

import csv
from math import nan
from pathlib import Path

import pytest
from click.testing import CliRunner

from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.development.profiles import figures, main, page
from tests.tools.study.test_summary import row

ORIGIN = {"commit": "0123456789ab"}


def rows() -> list[dict[str, str]]:
    """A healthy hand by two profiles, of which the tighter never closes, and a bend that one of two runs names."""
    told = [row(seed=seed, closed=closed, closed_s=3.0) | ORIGIN for seed, closed in ((1, 0.5), (2, 0.9), (3, 0.7))]
    never = [row(seed=seed, closed=0.0, closed_s=nan, ok=0.0) | ORIGIN | {"profile": "fine"} for seed in (1, 2)]
    bent = {"hazard": "bend-axial=1.5@start", "closed": 0.0, "ok": 0.0}
    sick = [row(**bent, seed=1, faults="rotation", named_s=9.0), row(**bent, seed=2), row(**bent, seed=3, named_s=16.0)]
    return [*told, *never, *(one | ORIGIN for one in sick)]


def test_each_line_is_of_one_profile_and_a_fault_that_is_named_late_is_not_named() -> None:
    text = page(figures(rows()))
    lines = [line for line in text.splitlines() if line.startswith(("| in-plane", "| bend", "- `"))]
    assert "| session | tissue | tracker | `coarse` | `fine` |" in text
    assert [line.split(" | ")[3:] for line in lines if " s | " in line] == [
        ["3/3 (29–100 %); 3.0 s; 70 (50–90) %", "0/2 (0–84 %) |"],
    ]
    assert "- `coarse`: 0 FAULTs in 3.0 min without a fault (under 60 an hour, 95 %)." in lines
    assert "- `fine`: 0 FAULTs in 2.0 min without a fault (under 90 an hour, 95 %)." in lines
    assert "| bend-axial=1.5@start | `coarse` | 1/3 (1–91 %) | 9.0 | 0/3 (0–71 %) |" in lines
    assert "1.3° and 2.1 mm for `fine`" in text
    assert "| RMS error, of the worst axis | rotation, deg | scale, % | offset, mm | latency, ms |" in text


def test_the_worst_axis_of_each_class_is_told() -> None:
    (one,) = figures([row() | ORIGIN])
    one["errors"] = {"rotation-lateral": 0.1, "rotation-axial": 0.3, "rotation-elevational": 0.2, "latency": 1.5}
    assert "| in-plane, still, 0.1 mm | 0.3 | – | – | 1.5 |" in page([one])


def test_a_fault_under_which_the_contact_was_closed_is_counted() -> None:
    passed = row(hazard="bend-axial=1.5@start", closed=0.1, ok=0.0) | ORIGIN
    assert "| 1/1 (3–100 %) |" in page(figures([passed]))


def test_the_table_of_something_else_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "study.csv"
    with file.open("w", newline="") as stream:
        told = {name: cell for name, cell in rows()[0].items() if name != "profile"}
        writer = csv.DictWriter(stream, told)
        writer.writeheader()
        writer.writerow(told)
    with pytest.raises(ConfigurationError, match="is not a table of a study with profiles"):
        CliRunner().invoke(main, ["--table", str(file)], catch_exceptions=False)
