"""The table of how often the bound on the error of a point held is what the rows of a study say."""

from math import sqrt

import pytest

from probewatch.tools.development.evidence import PLANS, points_plan
from probewatch.tools.development.evidence_figures import Figures, figures
from probewatch.tools.development.evidence_points import point_lines
from probewatch.tools.study.hazard import WITHIN, Manner
from tests.tools.study.test_summary import row

CREEPING = str(WITHIN[1]).replace(Manner.START, Manner.CREEPING)


def looked(seed: int, hazard: str, looks: int, narrow: float, wide: float) -> dict[str, str]:
    """Returns a row of a run with so many looks, whose shares around the most likely error are half as large."""
    cells = {"looks": looks, "narrow": narrow, "wide": wide, "narrow_off": narrow / 2, "wide_off": wide / 2}
    point = {f"point {name}": str(cell) for name, cell in (cells | {"worst_mm": 3.0, "true_mm": 1.0}).items()}
    return row("gesture-hold", seed, hazard=hazard) | {"commit": "c1"} | (point if looks else {"point looks": "0"})


ROWS = [
    looked(1, str(WITHIN[0]), 10, 0.9, 1.0),
    looked(2, str(WITHIN[0]), 20, 1.0, 1.0),
    looked(3, str(WITHIN[0]), 0, 0.0, 0.0),
    looked(1, CREEPING, 5, 0.6, 0.7),
]


def test_each_run_with_a_bound_counts_once_and_one_without_is_counted_as_a_run() -> None:
    creeping, start = sorted(figures(ROWS).points, key=lambda one: one.manner)
    assert (start.runs, start.looks, start.shares) == (3, 30, [[0.9, 1.0, 0.45, 0.5], [1.0, 1.0, 0.5, 0.5]])
    assert (creeping.runs, creeping.looks, creeping.sizes_mm) == (1, 5, [[3.0, 1.0]])


def test_the_table_says_means_with_their_intervals() -> None:
    text = "\n".join(point_lines(figures(ROWS).points))
    half = 100 * 12.706 * (0.1 / sqrt(2)) / sqrt(2)  # Student's, one degree of freedom
    assert f"| still | from the start | 3 | 30 | 95.0 ({95 - half:.1f}–100.0) | 100.0 |" in text
    assert "| **all** | creeping | 1 | 5 | 60.0 | 70.0 | 30.0 | 35.0 | 3.0, 1.0 mm |" in text


def test_what_is_within_the_limits_is_no_hazard_that_ought_to_be_found() -> None:
    assert figures(ROWS).found == []


def test_what_was_measured_before_stays_until_the_same_is_measured_again() -> None:
    before = figures(ROWS)
    again = before.updated(figures([looked(1, CREEPING, 6, 0.8, 0.9)]))
    assert [one.looks for one in again.points] == [6, 30]
    assert Figures.parse(again.plain()) == again
    assert point_lines([]) == []


def test_the_plan_asks_for_more_than_500_runs_in_every_world() -> None:
    plan = points_plan(PLANS["points"][1])
    assert len({one.key for one in plan}) == len(plan) > 500
    assert all(abs(one.hazard.size) <= 1.5 for one in plan if one.hazard.kind.startswith("bend"))
    assert {one.hazard.manner for one in plan} == {Manner.START, Manner.CREEPING}
    assert min(one.session.duration_s for one in plan if one.hazard.manner is Manner.CREEPING) == pytest.approx(36.0)
