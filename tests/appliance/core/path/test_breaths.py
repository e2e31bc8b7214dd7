"""Breaths that differ from one another, followed one by one: alone, and in the solver."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import find_peaks

from probewatch.appliance.core.path.blocks import Blocks
from probewatch.appliance.core.path.breaths import Breaths, peaks
from probewatch.appliance.core.path.samples import PathSamples
from probewatch.appliance.core.path.solver import Prior, Solution, solve
from probewatch.drivers.rigid import Array, rigid, rotation_from_vector
from tests.support.motions import TRUTH, Noise, samples

SECONDS = 26
STARTS_S = np.array([-1.5, 2.2, 6.6, 10.4, 14.9, 18.6, 22.4, 26.9])
"""Breaths of 3.7 to 4.5 s."""
DEPTHS_MM = np.array([3.7, 4.3, 3.9, 4.4, 3.6, 4.1, 4.2])
SCALE_AXIAL = 4
"""Of `Solution.change`."""
_TREMOR_HZ = ((0.31, 0.23, 0.27), (1.1, 1.7, 2.3))


def breathing_mm(t_s: Array) -> Array:
    number = np.searchsorted(STARTS_S, t_s, side="right") - 1
    share = (t_s - STARTS_S[number]) / np.diff(STARTS_S)[number]
    return np.asarray(DEPTHS_MM[number] * (1 - np.cos(np.pi * share) ** 4))


def blocks(seconds: int = SECONDS) -> Blocks:
    t_s = np.arange(30 * seconds) / 30
    return Blocks.of(t_s, np.zeros(t_s.size, dtype=np.int64))


def pressed(t_s: Array) -> Array:
    """A circle with a press at 1.3 times the rate of the breaths, and a tremor."""
    tremor = [0.3 * np.sin(2 * np.pi * np.array([[0.9], [1.4], [2.3]]) * t_s + row).sum(axis=0) for row in range(3)]
    way = [5 * np.sin(2 * np.pi * t_s / 3.1), 2 * np.cos(2 * np.pi * t_s / 3.1), 0 * t_s]
    return rigid(
        rotation_from_vector(0.004 * np.stack(tremor[::-1], axis=1)), np.stack(way, axis=1) + np.stack(tremor, 1)
    )


def rocked(t_s: Array) -> Array:
    """The same with a rock of ±3°."""
    turn = 0.05 * np.sin(2 * np.pi * t_s / 2.3)
    return pressed(t_s) @ rigid(rotation_from_vector(np.outer(turn, [0, 0, 1])), np.zeros((t_s.size, 3)))


def held(t_s: Array) -> Array:
    """A hand that holds still: a tremor of half a millimetre from end to end, and of .1 degrees."""
    slow, quick = ([0.11 * np.sin(2 * np.pi * hz * t_s + k) for k, hz in enumerate(row)] for row in _TREMOR_HZ)
    return rigid(rotation_from_vector(0.02 * np.stack(quick, axis=1)), np.stack(slow, 1) + np.stack(quick, 1))


def breathed(seed: int, scale: float = 1.0, path: Callable[[Array], Array] = pressed) -> PathSamples:
    """scale: of the picture's axis against the reference's, TRUTH."""
    given = samples(path, 30 * SECONDS, seed, Noise())
    moved_px = given.u_px + np.outer(breathing_mm(given.t_s), [0, 1]) / TRUTH.scale_mm_per_px
    return replace(given, u_px=moved_px / np.array([1.0, scale]))


def may_give_way(given: PathSamples, scale: float = 1.0) -> PathSamples:
    """The same where nothing says that the tissue is rigid. A turn is seen by its shear, in the aspect of TRUTH."""
    return replace(given, rigid=False, alpha_rad=given.alpha_rad * scale)


def solved(given: PathSamples) -> Solution:
    return solve(given, TRUTH, Prior(tilt_rad=0.2, rotation_rad=0.2, scale=0.15, offset_mm=10.0, latency_s=0.005))


def test_every_breath_is_found_though_no_two_are_alike() -> None:
    found = Breaths.found(blocks(), breathing_mm(blocks().t_s))
    assert found is not None
    inner = found.ends_s[(found.ends_s > 0) & (found.ends_s < SECONDS)]
    np.testing.assert_allclose(inner, STARTS_S[1:-1], atol=0.15)
    assert found.inside.all()


def test_a_chain_of_a_single_block_has_no_breath_and_hides_none() -> None:
    """numpy warned of the mean of an empty slice."""
    whole = blocks()
    chain = whole.chain.copy()
    chain[-1] += 1
    found = Breaths.found(replace(whole, chain=chain), breathing_mm(whole.t_s))
    assert found is not None


def test_what_is_believed_of_the_breaths_explains_them_once_it_is_fitted() -> None:
    given, truth = blocks(), breathing_mm(blocks().t_s)
    found = Breaths.found(given, truth)
    assert found is not None
    state = found.usual
    for _ in range(6):
        path, slopes = found.linear(given.t_s, state)
        weighed = slopes / 0.02
        missed = given.without_offsets(truth - path)
        known = np.diag(1 / found.sd**2)
        slope = weighed @ missed / 0.02 - known @ (state - found.usual)
        state = state + np.linalg.solve(weighed @ weighed.T + known, slope)
    left = given.without_offsets(truth - found.linear(given.t_s, state)[0])
    assert np.std(given.without_offsets(truth - found.linear(given.t_s, found.usual)[0])) > 0.2
    assert np.std(left) < 0.05


def test_of_breaths_that_are_known_one_whole_breath_is_enough_and_keeps_their_shape() -> None:
    whole = blocks()
    known = Breaths.found(whole, breathing_mm(whole.t_s))
    assert known is not None
    habit = known.habit(known.usual)
    assert habit.length_s == pytest.approx(np.median(np.diff(STARTS_S)), abs=0.3)
    few = blocks(8)
    assert Breaths.found(few, breathing_mm(few.t_s)) is None
    found = Breaths.found(few, breathing_mm(few.t_s), habit)
    assert found is not None
    path, _ = found.linear(few.t_s, found.usual)
    assert np.std(few.without_offsets(breathing_mm(few.t_s) - path)) < 0.4
    rest = blocks(3)
    assert Breaths.found(rest, breathing_mm(rest.t_s), habit) is None, "less than one"


def test_its_derivatives_are_those_of_differences() -> None:
    given = blocks(12)
    found = Breaths.found(given, breathing_mm(given.t_s))
    assert found is not None
    state = found.usual + 0.3 * found.sd * np.random.default_rng(3).standard_normal(found.sd.size)
    _, slopes = found.linear(given.t_s, state)
    for k in range(state.size):
        step = 1e-5 * np.eye(state.size)[k]
        up, down = (found.linear(given.t_s, state + sign * step)[0] for sign in (1, -1))
        np.testing.assert_allclose((up - down) / 2e-5, slopes[k], atol=1e-5)


@pytest.mark.parametrize(
    ("seconds", "size"), [(7, 1.0), (SECONDS, 0.1)], ids=["too few breaths", "shallower than a path drifts"]
)
def test_no_breaths_are_made_of_what_is_none(seconds: int, size: float) -> None:
    given = blocks(seconds)
    assert Breaths.found(given, size * breathing_mm(given.t_s)) is None


@pytest.mark.parametrize("scale", [1.0, 0.92])
def test_the_axial_scale_is_shown_though_the_tissue_breathes(scale: float) -> None:
    """Unfollowed, breathing leaves it unobserved; its error by then is 4 % and more."""
    found = solved(breathed(1, scale))
    sigma = np.sqrt(found.covariance[SCALE_AXIAL, SCALE_AXIAL])
    assert found.calibration.observed[SCALE_AXIAL]
    assert sigma < 0.012
    assert abs(found.change[SCALE_AXIAL] - (scale - 1)) < 3 * sigma


@pytest.mark.parametrize("scale", [1.0, 0.92])
def test_in_tissue_that_may_give_way_a_rock_shows_the_axial_scale_though_it_breathes(scale: float) -> None:
    found = solved(may_give_way(breathed(1, scale, rocked), scale))
    sigma = np.sqrt(found.covariance[SCALE_AXIAL, SCALE_AXIAL])
    assert found.calibration.observed[SCALE_AXIAL]
    assert sigma < 0.012
    assert abs(found.change[SCALE_AXIAL] - (scale - 1)) < 3 * sigma


@pytest.mark.parametrize("seed", range(3))
def test_breaths_that_are_followed_leave_what_follows_the_face_known(seed: int) -> None:
    """This tissue does not; unfollowed, breathing of 4 mm made it up to .2."""
    found = solved(may_give_way(breathed(seed)))
    assert found.noise.followed is not None
    assert abs(found.follow.share) < 0.05


@pytest.mark.parametrize("seed", range(3))
def test_breathing_over_a_probe_that_is_held_draws_no_scale(seed: int) -> None:
    """Left free, it went to −98 % with a sigma of 1.3, and all noise was learned as what that left."""
    found = solved(breathed(seed, path=held))
    assert not found.calibration.observed[SCALE_AXIAL]
    assert abs(found.change[SCALE_AXIAL]) < 0.02
    assert np.max(np.abs(found.change) / np.sqrt(np.diag(found.covariance))) < 3


@pytest.mark.thorough
def test_its_sigma_covers_the_truth() -> None:
    """24 sweeps of one hand over one tissue; the noise of the tracker alone differs."""
    z = []
    for seed in range(24):
        found = solved(breathed(seed))
        z.append(found.change[SCALE_AXIAL] / np.sqrt(found.covariance[SCALE_AXIAL, SCALE_AXIAL]))
    assert np.sqrt(np.mean(np.square(z))) < 1.3
    assert np.max(np.abs(z)) < 3


def test_breaths_with_nothing_in_common_leave_the_scale_unobserved_or_its_sigma_wide() -> None:
    """A drift of the tissue that has no shape to follow."""
    given = samples(pressed, 30 * SECONDS, 2, Noise())
    kernel = np.exp(-np.square((given.t_s[:, None] - given.t_s) / 0.8) / 2) + 1e-9 * np.eye(given.t_s.size)
    random_mm = 1.5 * np.linalg.cholesky(kernel) @ np.random.default_rng(4).standard_normal(given.t_s.size)
    moved = replace(given, u_px=given.u_px + np.outer(random_mm, [0, 1]) / TRUTH.scale_mm_per_px)
    found = solved(moved)
    sigma = np.sqrt(found.covariance[SCALE_AXIAL, SCALE_AXIAL])
    assert not found.calibration.observed[SCALE_AXIAL] or sigma > 0.01
    assert abs(found.change[SCALE_AXIAL]) < 3 * sigma or not found.calibration.observed[SCALE_AXIAL]


def filtered(seed: int) -> PathSamples:
    """`breathed`, by a tracker whose noise of .1 mm is alike from reading to reading: .9 at 60 Hz, .81 at 30."""
    given = samples(pressed, 30 * SECONDS, seed, Noise(position_mm=0.0))
    noise_mm = np.random.default_rng(seed + 50).standard_normal((given.t_s.size, 3))
    for k in range(1, len(noise_mm)):
        noise_mm[k] = 0.81 * noise_mm[k - 1] + np.sqrt(1 - 0.81**2) * noise_mm[k]
    around = [poses.copy() for poses in (given.poses, given.earlier_poses, given.later_poses)]
    for poses in around:
        poses[:, :3, 3] += 0.1 * noise_mm
    moved_px = given.u_px + np.outer(breathing_mm(given.t_s), [0, 1]) / TRUTH.scale_mm_per_px
    return PathSamples(given.t_s, given.chain, moved_px, given.alpha_rad, *around, given.apart_s)


@pytest.mark.thorough
def test_noise_of_a_tracker_that_filters_its_poses_is_no_pulse_and_draws_no_scale() -> None:
    """Taken for a pulse where the breaths are followed, it left the lateral scale with errors of 2.7 sigmas RMS."""
    found = [solved(filtered(seed)) for seed in range(8)]
    assert all(one.noise.followed is not None for one in found)
    scores = np.array([one.change[3:5] / np.sqrt(np.diag(one.covariance)[3:5]) for one in found])
    assert np.all(np.sqrt(np.mean(scores**2, axis=0)) < 1.6)


@pytest.mark.parametrize("walks", [True, False], ids=["a random walk", "steps with level tops"])
def test_peaks_are_those_that_scipy_finds(walks: bool) -> None:
    rng = np.random.default_rng(3)
    for _ in range(300):
        size, apart, prominence = int(rng.integers(1, 200)), int(rng.integers(1, 20)), float(rng.uniform(0, 3))
        values = np.cumsum(rng.normal(size=size)) if walks else rng.integers(0, 6, size=size).astype(float)
        theirs = find_peaks(values, distance=apart, prominence=prominence)[0]
        assert np.array_equal(peaks(values, apart, prominence), theirs)
