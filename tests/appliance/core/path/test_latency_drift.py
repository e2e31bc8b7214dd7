"""A drifting latency is carried on to now; noise, a step and an old line are no drift."""

import numpy as np
import pytest

from probewatch.appliance.core.path.latency import Latency
from probewatch.appliance.core.path.latency_drift import LatencyDrift

EVERY_NS, WINDOW_NS = 330_000_000, 3_500_000_000


def told(values_s: list[float], sigma_s: float = 0.005, seed: int = 1) -> LatencyDrift:
    """Estimates that windows of 3.5 s make of a latency, one each third of a second, of their middles."""
    random, drift = np.random.default_rng(seed), LatencyDrift()
    for k, value in enumerate(values_s):
        drift.note(k * EVERY_NS, Latency(value + random.normal(0, 0.0015), sigma_s))
    return drift


def now_ns(values_s: list[float]) -> int:
    return (len(values_s) - 1) * EVERY_NS + WINDOW_NS // 2


DRIFT = [0.01 * k * EVERY_NS / 1e9 for k in range(22)]


@pytest.mark.parametrize("sign", [1, -1])
def test_ten_ms_per_second_is_carried_on_to_now(sign: int) -> None:
    found = told([sign * value for value in DRIFT]).carried_to(now_ns(DRIFT))
    assert found is not None
    truth_s = sign * 0.01 * now_ns(DRIFT) / 1e9
    assert found.value_s == pytest.approx(truth_s, abs=3 * found.sigma_s)
    assert 0.001 < found.sigma_s < 0.005


def test_the_sigma_covers_the_error() -> None:
    truth_s = 0.01 * now_ns(DRIFT) / 1e9
    found = [told(DRIFT, seed=seed).carried_to(now_ns(DRIFT)) for seed in range(100)]
    assert all(one is not None for one in found)
    assert np.mean([abs(one.value_s - truth_s) < 2 * one.sigma_s for one in found if one is not None]) >= 0.95


@pytest.mark.parametrize("level_s", [0.0, 0.045])
def test_a_latency_that_stays_is_no_drift(level_s: float) -> None:
    found = [told([level_s] * 22, seed=seed).carried_to(now_ns([0.0] * 22)) for seed in range(100)]
    assert np.mean([one is None for one in found]) >= 0.95
    assert all(one is None or abs(one.value_s) + 3 * one.sigma_s < 0.07 for one in found)


def test_a_step_within_the_limit_is_not_carried_beyond_it_for_certain() -> None:
    """A window of 3.5 s makes a ramp of it."""
    ramp = [float(np.interp(k * EVERY_NS / 1e9, [4.0, 7.5], [0.0, 0.05])) for k in range(40)]
    for end in range(16, 40):
        found = told(ramp[:end]).carried_to(now_ns(ramp[:end]))
        assert found is None or found.value_s - 3 * found.sigma_s < 0.06


def test_uncertain_and_unknown_estimates_do_not_count() -> None:
    assert told(DRIFT, sigma_s=0.02).carried_to(now_ns(DRIFT)) is None
    assert told(DRIFT, sigma_s=float("nan")).carried_to(now_ns(DRIFT)) is None


def test_an_old_line_is_not_carried_on() -> None:
    assert told(DRIFT).carried_to(now_ns(DRIFT) + 10_000_000_000) is None
    drift = told(DRIFT)
    drift.clear()
    assert drift.carried_to(now_ns(DRIFT)) is None
