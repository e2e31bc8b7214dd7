"""The reproduction of the paper: its sweeps, its table, and how convergence is counted."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from probewatch.appliance.core.path.solver import Prior, solve
from probewatch.appliance.types import Calibration
from tests.paper import figure4, table1
from tests.paper.__main__ import PAGE, main
from tests.paper.matching import Pairs, first_pictures, keyframe_chain
from tests.paper.sweeps import FPS, SCALE, SIZE_PX, SPEED_MM_PER_S, X, sweep

STEP_MM = SPEED_MM_PER_S / FPS


def test_registered_pairs_are_the_steps_of_the_sweep() -> None:
    seen = sweep(3, np.zeros(14))
    for d in (1, 5, 10):
        motions = Pairs(seen).apart(d)
        assert len(motions) == 14 - d
        moved_mm = np.abs(motions.u * SCALE).mean(axis=0)
        np.testing.assert_allclose(moved_mm, [d * STEP_MM, 0], atol=0.03)


@pytest.mark.thorough
def test_the_keyframe_chain_shows_the_scales_of_a_planar_sweep() -> None:
    seen = sweep(4, np.linspace(0, 180, 66))
    samples = keyframe_chain(seen)
    reference = Calibration(X[:3, :3], (1, 1), SCALE, X[:3, 3], SIZE_PX)
    found = solve(samples, reference, Prior(planar=True, offset_mm=2.0, latency_s=0.002))
    np.testing.assert_allclose(found.change[3:5], 0, atol=0.06)
    assert first_pictures(samples, 20).t_s.size == 20


def test_convergence_is_counted_from_where_it_stays() -> None:
    curve = np.tile(SCALE, (len(figure4.FRAMES), 1))
    assert figure4.converged_after(curve).tolist() == [figure4.FRAMES[0]] * 2
    curve[7, 0] *= 1.2
    curve[3, 0] = np.nan
    curve[-1, 1] *= 0.8
    after = figure4.converged_after(curve)
    assert after[0] == figure4.FRAMES[8]
    assert np.isnan(after[1])


@pytest.mark.slow
def test_the_published_page_is_what_this_commit_makes(tmp_path: Path) -> None:
    """It hangs on no clock, core or instruction set; where it differs, make paper was left out after a change."""
    page = tmp_path / "paper.md"
    shutil.copy(PAGE, page)
    main(tmp_path, page)
    assert page.read_text() == PAGE.read_text()


@pytest.mark.slow
def test_table_1_is_that_of_the_paper() -> None:
    """Rotation near half a turn, near none when flipped; scales as near 0.22 and 0.26 as the paper's own scatter."""
    rows = list(table1.rows())
    assert all(2.99 < row.linear[0] <= np.pi and 2.99 < row.norm[0] <= np.pi for row in rows[:4])
    assert rows[4].linear[0] < 0.15
    assert [row.polarity for row in rows] == [(1, 1)] * 4 + [(-1, 1)]
    scales = np.array([row.linear[1:] for row in rows]) / SCALE - 1
    paper = np.array(table1.PAPER)[:, 1:] / SCALE - 1
    assert np.abs(scales).max() < 0.03
    assert np.abs(scales).max() < np.abs(paper).max()
    norm = np.array([row.norm[1:] for row in rows]) / SCALE - 1
    assert np.all(norm > 0), "the norm constraint is biased upwards, as are the paper's scales"
