"""Noise of the residual path: whitening against the dense covariance, and what the structure function finds."""

import numpy as np
import pytest

from appliance.core.path.noise import Noise, Times, Whitener, position_weight

NOISE = Noise(position_mm=0.12, position_drift=0.05, angle_rad=4e-4, angle_drift=3e-4)


def times(n: int = 40, parts: int = 2, seed: int = 0) -> Times:
    random = np.random.default_rng(seed)
    t_s = np.cumsum(random.uniform(0.02, 0.05, n))
    return Times(t_s, np.repeat(np.arange(parts), n // parts), np.zeros(n))


def innovations(given: Times, steps: np.ndarray) -> np.ndarray:
    """(3, n) in-plane position mm and turn rad → (3, m)."""
    whiten = Whitener(given, NOISE)
    return np.concatenate([whiten.positions(steps[:2]), whiten.angles(steps[2:])])


def test_complex_positions_are_whitened_like_real_ones() -> None:
    given, whiten = times(), Whitener(times(), NOISE)
    steps = np.random.default_rng(4).normal(0, 0.2, (2, 5, 40))
    both = whiten.positions(steps[0] + 1j * steps[1])
    np.testing.assert_array_equal([both.real, both.imag], [whiten.positions(part) for part in steps])
    assert both.shape == (5, 40 - len(np.unique(given.chain)))


def test_whitening_is_generalised_least_squares_with_a_free_offset_per_chain() -> None:
    """rᵀ Σ⁻¹ r with Σ = white + walk + 10⁶ · offsets, computed densely, equals the sum of squared innovations."""
    given = times()
    path = np.random.default_rng(1).normal(0, 0.2, (3, 40))
    found = np.sum(innovations(given, np.diff(path, axis=1, prepend=path[:, :1])) ** 2, axis=1)
    for column, (white, drift) in enumerate([(0.12, 0.05), (0.12, 0.05), (4e-4, 3e-4)]):
        expected = 0.0
        for chain in (0, 1):
            rows = given.chain == chain
            t_s = given.t_s[rows]
            sigma = white**2 * np.eye(len(t_s)) + drift**2 * np.minimum.outer(t_s - t_s[0], t_s - t_s[0])
            weight = np.linalg.inv(sigma)
            r = path[column, rows]
            offset = weight.sum(axis=0) @ r / weight.sum()
            expected += (r - offset) @ weight @ (r - offset)
        assert found[column] == pytest.approx(expected, rel=1e-9)


def test_innovations_of_paths_drawn_from_the_model_are_white() -> None:
    given = times(400, 1)
    random = np.random.default_rng(2)
    walk = np.cumsum(random.normal(0, 1, (3, 400)) * np.sqrt(np.diff(given.t_s, prepend=given.t_s[0])), axis=1)
    drift, white = np.array([[0.05, 0.05, 3e-4], [0.12, 0.12, 4e-4]])[..., None]
    path = walk * drift + random.normal(0, 1, (3, 400)) * white
    found = innovations(given, np.diff(path, axis=1, prepend=path[:, :1]))
    np.testing.assert_allclose(np.var(found, axis=1), 1, atol=0.25)
    np.testing.assert_allclose(np.mean(found[:, 1:] * found[:, :-1], axis=1), 0, atol=0.15)
    found = given.estimated_noise(path[0] + 1j * path[1], path[2])
    assert found.position_mm == pytest.approx(0.12, rel=0.15)
    assert found.angle_rad == pytest.approx(4e-4, rel=0.2)


def test_a_step_out_of_the_plane_may_move_the_picture() -> None:
    """After 2 mm of hidden way a jump of 2 mm is no surprise; without it, it is."""
    given = times(40, 1)
    steps = np.zeros((3, 40))
    steps[0, 20] = 2.0
    hidden = np.zeros(40)
    hidden[20] = 2.0
    surprised = np.abs(innovations(given, steps)).max()
    calm = np.abs(innovations(Times(given.t_s, given.chain, hidden), steps)).max()
    assert surprised > 8
    assert calm < 1.5


def test_outliers_do_not_inflate_the_noise() -> None:
    path = np.random.default_rng(3).normal(0, 0.1, (3, 120))
    path[:, ::20] += 5.0
    found = times(120, 1).estimated_noise(path[0] + 1j * path[1], path[2])
    assert found.position_mm == pytest.approx(0.1, rel=0.25)


def test_the_weight_of_a_picture_is_the_diagonal_of_the_inverse_covariance() -> None:
    period_s = 1 / 30
    t_s = np.arange(400) * period_s
    sigma = 0.12**2 * np.eye(400) + 0.05**2 * np.minimum.outer(t_s, t_s)
    middle = np.diag(np.linalg.inv(sigma))[100:300]
    assert position_weight(NOISE, period_s) == pytest.approx(middle.mean(), rel=1e-3)
