"""The residual of the two paths: zero at the truth, and its derivatives against differences."""

from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.path.residual import NOTHING, OFFSET, SCALE, TAU, VALUE, Lack, PathResidual
from probewatch.appliance.core.path.solver import Prior, solve
from probewatch.drivers.rigid import Array, rigid, rotation_from_vector
from tests.support import motions
from tests.support.motions import TRUTH, planar_path, samples, tilting_path

QUIET = motions.Noise(position_mm=0.0, angle_deg=0.0, picture_px=0.0, drift_mm=0.0, drift_deg=0.0)


def values(residual: PathResidual, theta: Array | None = None) -> Array:
    """(rows, m) less the offset of each chain."""
    return residual.blocks.without_offsets(residual.linear(NOTHING if theta is None else theta)[:, VALUE])


@pytest.mark.parametrize(("planar", "rows"), [(True, 6), (False, 3)])
@pytest.mark.parametrize("polarity", [(1, 1), (-1, 1)])
def test_nothing_is_left_at_the_truth(planar: bool, rows: int, polarity: tuple[int, int]) -> None:
    truth = replace(TRUTH, polarity=polarity)
    left = values(PathResidual(samples(planar_path, 60, 1, QUIET, truth), truth, planar))
    assert left.shape == (rows, 20)
    np.testing.assert_allclose(left, 0, atol=1e-4)


@pytest.mark.parametrize("planar", [False, True])
def test_slopes_are_the_derivative_of_the_rows(planar: bool) -> None:
    """By each parameter at θ = 0, with the rotation about the reference; the rate is that of the steps by latency."""
    residual = PathResidual(samples(tilting_path, 40, 2, motions.Noise()), TRUTH, planar)
    residual.linearise_latency(NOTHING)
    slopes = residual.linear(NOTHING)[:, :VALUE]
    for index, change in enumerate(np.eye(NOTHING.size) * 1e-5):
        after, before = (residual.linear(sign * change)[:, VALUE] for sign in (1, -1))
        np.testing.assert_allclose(slopes[:, index], (after - before) / 2e-5, rtol=1e-6, atol=1e-4)


def test_where_tissue_may_give_way_the_lateral_scale_is_regressed_on_the_predicted_way() -> None:
    """All other slopes are the derivatives. The measured way is noisy there, and drew the scale by −9 % and more."""
    residual = PathResidual.of(samples(tilting_path, 40, 2, motions.Noise(), rigid_tissue=False), TRUTH)
    residual.reckon(0.4, np.zeros(2))
    residual.linearise_latency(NOTHING)
    rows = residual.linear(NOTHING)
    for index, change in enumerate(np.eye(NOTHING.size) * 1e-5):
        after, before = (residual.linear(sign * change)[:, VALUE] for sign in (1, -1))
        expected = (after - before) / 2e-5
        if index == SCALE.start:
            expected[0] = residual.seen(NOTHING)[0] - rows[0, VALUE]
        np.testing.assert_allclose(rows[:, index], expected, rtol=1e-6, atol=1e-4)


@pytest.mark.parametrize(("turn_deg", "tells"), [(0.5, False), (2.0, True)])
def test_over_tissue_that_may_give_way_a_probe_that_hardly_turns_shows_nothing(turn_deg: float, tells: bool) -> None:
    def path(t_s: Array) -> Array:
        turn = np.outer(np.deg2rad(turn_deg) * np.sin(3 * t_s), [0, 0, 1])
        return rigid(rotation_from_vector(turn), planar_path(t_s)[:, :3, 3])

    for rigid_tissue in (False, True):
        given = samples(path, 240, 2, motions.Noise(), rigid_tissue=rigid_tissue)
        assert PathResidual.of(given, TRUTH).is_informative is (tells or rigid_tissue)
        found = solve(given, TRUTH, Prior(latency_s=0.001)).calibration
        assert any(found.observed) is (tells or rigid_tissue), found


@pytest.mark.parametrize(("rows", "tells"), [(200, False), (300, True)])
def test_over_tissue_that_may_give_way_a_shallow_picture_shows_nothing(rows: int, tells: bool) -> None:
    """Pictures are 14 and 21 mm deep; at 14 mm the drag of the skin cannot be told from a turn."""
    truth = replace(TRUTH, image_size_px=(640, rows))
    for rigid_tissue in (False, True):
        given = samples(tilting_path, 240, 2, motions.Noise(), truth, rigid_tissue=rigid_tissue)
        residual = PathResidual.of(given, truth)
        assert residual.is_informative is (tells or rigid_tissue)
        assert residual.lack == (None if tells or rigid_tissue else Lack("depth_mm", 200 * 0.07, 18.0))


@pytest.mark.parametrize(("clear_share", "tells"), [(0.35, False), (0.73, True)])
def test_over_tissue_that_may_give_way_a_picture_that_shows_little_of_it_shows_nothing(
    clear_share: float, tells: bool
) -> None:
    """A healthy cart was accused of +19 % laterally where a part of the face was off the skin; 21 mm deep."""
    truth = replace(TRUTH, image_size_px=(640, 300))
    for rigid_tissue in (False, True):
        given = samples(tilting_path, 240, 2, motions.Noise(), truth, rigid_tissue=rigid_tissue)
        seen = replace(given, clear_share=clear_share)
        residual = PathResidual.of(seen, truth)
        assert residual.is_informative is (tells or rigid_tissue)
        assert (residual.lack is None) is (tells or rigid_tissue)
        assert residual.lack is None or residual.lack[::2] == ("tissue_mm2", 380.0)


@pytest.mark.parametrize("axis", [0, 1])
def test_tissue_that_is_sheared_by_a_press_or_by_drag_has_not_turned(axis: int) -> None:
    """By .05° for 1 mm, as the probe twists in step with that. Taken for a turn, it is a wrong rotation."""

    def path(t_s: Array) -> Array:
        way_mm = planar_path(t_s)[:, axis, 3]
        return planar_path(t_s) @ rigid(rotation_from_vector(np.outer(way_mm, [0.0, 0.02, 0.0])), np.zeros(3))

    given = samples(path, 240, 6, motions.Noise(), rigid_tissue=False)
    way_mm = planar_path(given.t_s)[:, axis, 3]
    found = solve(replace(given, alpha_rad=given.alpha_rad + np.deg2rad(0.05) * way_mm), TRUTH, Prior(latency_s=0.001))
    assert abs(found.change[0]) < 3 * np.sqrt(found.covariance[0, 0])
    assert np.sqrt(found.covariance[0, 0]) > np.deg2rad(1), "which of the two it is no such motion tells"


def test_scale_offset_and_rotation_move_the_reference() -> None:
    """The residual at θ is that of the moved reference at zero."""
    given = samples(tilting_path, 40, 3, motions.Noise())
    theta = np.array([0.1, -0.05, 0.2, 0.03, -0.04, 2.0, -1.0, 3.0, 0.0, 0.0, 0.0, 0.0])
    moved = replace(
        TRUTH,
        rotation=rotation_from_vector(theta[:3]) @ TRUTH.rotation,
        scale_mm_per_px=TRUTH.scale_mm_per_px * (1 + theta[SCALE]),
        offset_mm=TRUTH.offset_mm + theta[OFFSET],
    )
    expected = PathResidual(given, moved, planar=True).linear(NOTHING)[:, VALUE]
    np.testing.assert_allclose(PathResidual(given, TRUTH, planar=True).linear(theta)[:, VALUE], expected, atol=1e-12)


@pytest.mark.parametrize(
    ("index", "change"), [(0, 0.02), (1, 0.02), (2, 0.02), (OFFSET.start, 1.0), (OFFSET.start + 2, 1.0)]
)
def test_tissue_that_follows_shows_less_of_a_reference_that_is_wrong_along_the_press(index: int, change: float) -> None:
    """The face lies as wrongly as the middle of the picture. Told in full, 8 mm of lateral offset were taken for 4."""
    given = samples(tilting_path, 40, 3, motions.Noise(), rigid_tissue=False)
    theta = NOTHING.copy()
    theta[index] = change
    moved = replace(
        TRUTH, rotation=rotation_from_vector(theta[:3]) @ TRUTH.rotation, offset_mm=TRUTH.offset_mm + theta[OFFSET]
    )
    here, there = (PathResidual(given, one, planar=False) for one in (TRUTH, moved))
    for residual in (here, there):
        residual.reckon(0.5, np.zeros(2))
    before, told, expected = (values(*one)[1] for one in ((here,), (here, theta), (there,)))
    assert np.abs(told - expected).max() < 0.1 * np.abs(expected - before).max()


def test_a_late_tracker_is_a_residual_that_the_latency_takes_away() -> None:
    """To first order: 5 ms late, all but a tenth of it."""
    on_time, late = (samples(planar_path, 60, 4, QUIET, start_s=start_s) for start_s in (0.0, 0.005))
    residual = PathResidual(replace(late, u_px=on_time.u_px, alpha_rad=on_time.alpha_rad), TRUTH, planar=False)
    residual.reckon(0.0, np.zeros(2))
    residual.linearise_latency(NOTHING)
    theta = NOTHING.copy()
    uncorrected = np.abs(values(residual)).max()
    theta[TAU] = -0.005
    assert np.abs(values(residual, theta)).max() < 0.1 * uncorrected


def test_the_way_out_of_the_plane_is_the_trackers() -> None:
    """±3 mm of elevational motion, seen from the middle of the picture."""
    given = samples(tilting_path, 300, 5, QUIET)
    found = PathResidual(given, TRUTH, planar=False).elevation_mm
    assert np.ptp(found) == pytest.approx(6, abs=1.5)


def test_one_residual_serves_whoever_asks_for_the_same_reference() -> None:
    given = samples(tilting_path, 40, 2, motions.Noise())
    shared, fresh = PathResidual.of(given, TRUTH), PathResidual(given, TRUTH, planar=False)
    fresh.linearise_latency(NOTHING)
    assert PathResidual.of(given, TRUTH) is shared
    assert PathResidual.of(given, replace(TRUTH, polarity=(-1, 1))) is not shared
    assert PathResidual.of(given, TRUTH, planar=True) is not shared
    np.testing.assert_array_equal(shared.linear(NOTHING), fresh.linear(NOTHING))


def test_what_is_kept_of_a_residual_is_of_its_latest_theta_and_nobody_can_spoil_it() -> None:
    residual = PathResidual.of(samples(tilting_path, 40, 2, motions.Noise()), TRUTH)
    here, there = NOTHING.copy(), np.full(NOTHING.size, 1e-3)
    kept = residual.linear(here)
    assert residual.linear(here.copy()) is kept
    assert not np.array_equal(residual.linear(there), kept)
    np.testing.assert_array_equal(residual.linear(here), kept)
    for shared in (kept, residual.parts):
        with pytest.raises(ValueError, match="read-only"):
            shared[0] = 0.0
