"""The residual of the two paths: zero at the truth, and its derivatives against differences."""

from dataclasses import replace

import numpy as np
import pytest

from appliance.core.path.noise import Noise, Whitener
from appliance.core.path.residual import OFFSET, SCALE, TAU, PathResidual, side_by_side
from drivers.rigid import rotation_from_vector
from tests.support import motions
from tests.support.motions import TRUTH, planar_path, samples, tilting_path

QUIET = motions.Noise(position_mm=0.0, angle_deg=0.0, picture_px=0.0, drift_mm=0.0, drift_deg=0.0)
NOISE = Noise(position_mm=0.12, position_drift=0.05, angle_rad=4e-4, angle_drift=3e-4)


@pytest.mark.parametrize(("path", "planar", "rows"), [(planar_path, True, 6), (planar_path, False, 3)])
@pytest.mark.parametrize("polarity", [(1, 1), (-1, 1)])
def test_nothing_is_left_at_the_truth(path, planar: bool, rows: int, polarity: tuple[int, int]) -> None:  # type: ignore[no-untyped-def]
    truth = replace(TRUTH, polarity=polarity)
    left = PathResidual(samples(path, 60, 1, QUIET, truth), truth, planar).steps(np.zeros(9))
    assert side_by_side(left).size == 60 * rows
    np.testing.assert_allclose(side_by_side(left), 0, atol=1e-5)


@pytest.mark.parametrize("planar", [False, True])
def test_slopes_are_the_derivative_of_the_innovations(planar: bool) -> None:
    """By each parameter at θ = 0, with the rotation about the reference; the rate is that of the steps by latency."""
    given = samples(tilting_path, 40, 2, motions.Noise())
    residual, whiten = PathResidual(given, TRUTH, planar), Whitener(given.times, NOISE)
    residual.linearise_latency(np.zeros(9))
    whitened = residual.whitened(whiten)
    slopes = residual.linear(np.zeros(9), whitened)[:9]
    for index, change in enumerate(np.eye(9) * 1e-5):
        after, before = (side_by_side(residual.innovations(residual.steps(sign * change), whiten)) for sign in (1, -1))
        np.testing.assert_allclose(slopes[index], (after - before) / 2e-5, rtol=1e-6, atol=1e-4)


def test_scale_offset_and_rotation_move_the_reference() -> None:
    """The residual at θ is that of the moved reference at zero."""
    given = samples(tilting_path, 40, 3, motions.Noise())
    theta = np.array([0.1, -0.05, 0.2, 0.03, -0.04, 2.0, -1.0, 3.0, 0.0])
    moved = replace(
        TRUTH,
        rotation=rotation_from_vector(theta[:3]) @ TRUTH.rotation,
        scale_mm_per_px=TRUTH.scale_mm_per_px * (1 + theta[SCALE]),
        offset_mm=TRUTH.offset_mm + theta[OFFSET],
    )
    expected = PathResidual(given, moved, planar=True).steps(np.zeros(9))
    np.testing.assert_allclose(
        side_by_side(PathResidual(given, TRUTH, planar=True).steps(theta)), side_by_side(expected), atol=1e-12
    )


def test_a_late_tracker_is_a_residual_that_the_latency_takes_away() -> None:
    """To first order: 5 ms late, all but a tenth of it."""
    on_time, late = (samples(planar_path, 60, 4, QUIET, start_s=start_s) for start_s in (0.0, 0.005))
    residual = PathResidual(replace(late, u_px=on_time.u_px, alpha_rad=on_time.alpha_rad), TRUTH, planar=False)
    residual.linearise_latency(np.zeros(9))
    theta = np.zeros(9)
    uncorrected = np.abs(residual.steps(theta)[0][1:]).max()
    theta[TAU] = -0.005
    assert np.abs(residual.steps(theta)[0][1:]).max() < 0.1 * uncorrected
