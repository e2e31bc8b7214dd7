"""What the soak calls growth, on series whose growth is known."""

import numpy as np
import pytest

from tests.cart.growth import Finding, Growth, growth

LIMITS = (8.0, 4.0)


def series(minutes: float, per_h: float, wander: float, seed: int) -> Growth:
    """Readings every 10 s of a level that grows by per_h, wanders slowly and makes one early step."""
    random = np.random.default_rng(seed)
    t_s = np.arange(0, minutes * 60, 10.0)
    drift = np.convolve(random.normal(0, wander, len(t_s) + 11), np.ones(12) / np.sqrt(12), "valid")
    return growth(t_s, 200 + per_h * t_s / 3600 + drift)


@pytest.mark.parametrize("seed", range(5))
def test_half_an_hour_tells_a_leak_from_none(seed: int) -> None:
    assert series(30, 0.0, 0.3, seed).finding(*LIMITS) is Finding.FLAT
    assert series(30, 16.0, 0.3, seed).finding(*LIMITS) is Finding.GROWS


def test_a_short_run_claims_neither() -> None:
    """A tenth of a MiB within half a minute is 12 MiB an hour by a straight line, and tells nothing."""
    assert all(series(4, 0.0, 0.3, seed).finding(*LIMITS) is Finding.UNTOLD for seed in range(10))
    assert series(4, 200.0, 0.3, 0).finding(*LIMITS) is Finding.GROWS, "13 MiB are growth after any time"
    with pytest.raises(ValueError, match="too few"):
        series(0.5, 0.0, 0.1, 0)


def test_the_interval_holds_the_truth() -> None:
    """95 % of them do; what is asked here is that nearly all of two hundred do, slow wander and all."""
    seen = [series(30, 5.0, 0.3, seed) for seed in range(200)]
    held = sum(abs(one.per_h - 5.0) <= one.error_per_h for one in seen)
    assert held >= 180, held


def test_a_leap_is_growth_however_flat_the_rest() -> None:
    t_s = np.arange(0, 1800, 10.0)
    assert growth(t_s, 200 + 5.0 * (t_s > 1500)).finding(*LIMITS) is Finding.GROWS
    assert growth(t_s, np.full(len(t_s), 200.0)).finding(*LIMITS) is Finding.FLAT
