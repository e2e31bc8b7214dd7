"""A trend by its statistics over many seeds: how often it errs, how soon it tells, and when the limit will be met."""

from itertools import pairwise
from math import inf, nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from probewatch.appliance.core.quality.trend import Estimate, Trend, trend

EVERY_S = 300.0
LIMIT = 5.0


def made(values: np.ndarray, sigma: float = 1.0) -> Trend:
    return trend([Estimate(1e9 + EVERY_S * index, value, sigma) for index, value in enumerate(values)], LIMIT)


def first_outside(values: np.ndarray, sigma: float = 1.0) -> int | None:
    found = made(values, sigma)
    outside = np.flatnonzero((found.mean < found.low) | (found.mean > found.high))
    return int(outside[0]) if outside.size else None


def noise(seed: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(count)


@pytest.mark.parametrize("true_sigma", [0.3, 1.0, 3.0])
def test_a_steady_parameter_seldom_leaves_its_control_limits_whatever_its_true_scatter(true_sigma: float) -> None:
    left = sum(first_outside(true_sigma * noise(seed, 400)) is not None for seed in range(200))
    assert left <= 60, "86 of 400 where the stated sigma is right"


@pytest.mark.parametrize(("shift", "within"), [(1.0, 40), (2.0, 10), (3.0, 6)])
def test_a_step_is_seen_after_a_few_estimates(shift: float, within: int) -> None:
    delays = []
    for seed in range(200):
        values = noise(seed, 300)
        values[12:] += shift
        seen = first_outside(values)
        delays.append(300 if seen is None else seen - 11)
    assert np.median(delays) <= within


def test_a_slow_bend_is_told_long_before_its_limit() -> None:
    """.03 of the limit a day, over eight-hour days of 96 estimates."""
    told = []
    for seed in range(20):
        values = 0.3 * noise(seed, 96 * 12) + 0.15 * np.arange(96 * 12) / 96
        seen = first_outside(values, sigma=0.3)
        assert seen is not None
        told.append(values[:seen].mean() if seen else 0.0)
    assert max(told) < LIMIT / 2


def test_the_day_on_which_the_limit_is_met_is_never_told_too_late() -> None:
    late = 0
    for seed in range(100):
        days = np.arange(0, 6, EVERY_S / 86400)
        values = 0.4 * noise(seed, days.size) + 0.2 * days
        found = made(values, sigma=0.4)
        truly = (LIMIT - 0.2 * days[-1]) / 0.2
        late += found.days_left > truly * 1.1
        assert found.per_day == pytest.approx(0.2, abs=4 * found.per_day_sigma)
    assert late <= 5


def test_a_steady_parameter_meets_no_limit_soon() -> None:
    days = np.arange(0, 10, EVERY_S / 86400)
    assert made(0.2 * noise(3, days.size), sigma=0.2).days_left > 100


def test_without_a_baseline_it_tells_no_day() -> None:
    """Half an hour of a healthy cart was said to reach its limits in 0 days."""
    values = 0.5 * noise(3, 20)
    assert made(values[:12], sigma=0.5).days_left == np.inf
    assert made(values, sigma=0.5).days_left < np.inf


def test_near_its_limit_says_so() -> None:
    assert made(np.full(20, 3.6), 0.1).near
    assert made(np.full(20, -3.6), 0.1).near
    assert not made(np.full(20, 3.4), 0.1).near
    assert not made(np.full(20, 3.6), 0.1).moving


@pytest.mark.parametrize("count", [0, 1, 2, 12])
def test_few_estimates_say_nothing(count: int) -> None:
    found = made(noise(1, count))
    assert not found.moving
    assert len(found.mean) == count
    assert all(np.isinf(found.high))


def test_what_has_no_value_or_no_sigma_is_left_out() -> None:
    good = [Estimate(1e9 + k, 0.1, 0.2) for k in range(20)]
    spoiled = [*good[:5], Estimate(1e9, nan, 1.0), Estimate(1e9, 1.0, nan), Estimate(1e9, 1.0, 0.0), *good[5:]]
    spoiled.append(Estimate(2e9, inf, 1.0))
    assert trend(spoiled, LIMIT).estimates == tuple(good)


@given(st.lists(st.tuples(st.floats(-1e6, 1e6), st.floats(1e-6, 1e3)), max_size=60))
def test_any_history_has_a_trend(rows: list[tuple[float, float]]) -> None:
    found = trend([Estimate(60.0 * index, *row) for index, row in enumerate(rows)], LIMIT)
    assert found.days_left >= 0
    assert all(np.isfinite(found.mean))
    assert all(before <= after or np.isinf(before) for before, after in pairwise(found.high[13:]))
