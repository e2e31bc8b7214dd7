"""Host time from a frame counter: accuracy under bad delays, and every way in which a counter can jump."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.counter_clock import CounterClock

HZ = 60
SETTLED = 5 * HZ
Floats = NDArray[np.float64]


@dataclass
class Session:
    """truth_s, arrival_s: (n,). counter: (n,) as the device shows it."""

    truth_s: Floats
    arrival_s: Floats
    counter: NDArray[np.int64]


def session(seed: int, seconds: float = 40, step: int = 1, start: int = 0) -> Session:
    """A counter with 100 ppm skew, 1 ppm drift; delays of 16 ms mean, one reading in seven in a burst to 70 ms."""
    random = np.random.default_rng(seed)
    n = round(seconds * HZ / step)
    counter = start + step * np.arange(n)
    rate = 1 + 100e-6 + 1e-6 * np.sin(np.arange(n) * step / HZ / 20)
    truth_s = 1000 + np.cumsum(rate * step / HZ)
    delay_s = random.exponential(0.016, n)
    at = 0
    while (at := at + int(random.exponential(180))) < n:
        length = int(random.integers(5, 60))
        delay_s[at : at + length] = random.uniform(0.03, 0.07, len(delay_s[at : at + length]))
        at += length
    arrival_s = np.maximum.accumulate(truth_s + np.minimum(delay_s, 0.07))
    return Session(truth_s, arrival_s, counter)


def stamped(clock: CounterClock, readings: Session) -> tuple[Floats, Floats]:
    """(error, bound) of every reading, s."""
    stamps = [
        clock.stamp(int(c) % 2**32, round(a * 1e9)) for c, a in zip(readings.counter, readings.arrival_s, strict=True)
    ]
    t_ns = [s.t_ns for s in stamps]
    assert all(later >= earlier for earlier, later in pairwise(t_ns)), "stamps run forward"
    return np.array(t_ns) / 1e9 - readings.truth_s, np.array([s.err_ns for s in stamps]) / 1e9


def least_squares_errors(readings: Session, points: int = 20) -> Floats:
    """Errors of the usual filter: a straight line through the last 20 arrivals, its constant delay forgiven."""
    errors = []
    for end in range(SETTLED, len(readings.counter)):
        window = slice(end - points + 1, end + 1)
        line = np.polyfit(readings.counter[window] - readings.counter[end], readings.arrival_s[window], 1)
        errors.append(line[1] - readings.truth_s[end])
    return np.asarray(errors) - np.median(errors)


def test_accuracy_and_stated_bound() -> None:
    errors, bounds, compared = [], [], []
    for seed in range(6):
        readings = session(seed)
        clock = CounterClock(HZ)
        error, bound = stamped(clock, readings)
        assert clock.restarts == 0
        errors.append(np.abs(error[SETTLED:]))
        bounds.append(bound[SETTLED:])
        compared.append(np.abs(least_squares_errors(readings)))
    error, bound, other = map(np.concatenate, (errors, bounds, compared))
    assert np.median(error) < 0.5e-3
    assert np.quantile(error, 0.99) < 2e-3
    assert np.mean(error <= bound) >= 0.997
    assert np.median(bound) < 2e-3, "a bound that says nothing would cover everything"
    assert np.median(other) > 10 * np.median(error)
    assert np.quantile(other, 0.99) > 10 * np.quantile(error, 0.99)


def test_a_20_hz_unit_steps_a_60_hz_counter_by_three() -> None:
    error, bound = stamped(CounterClock(HZ), session(1, seconds=60, step=3))
    late = slice(10 * 20, None)
    assert np.quantile(np.abs(error[late]), 0.99) < 4e-3
    assert np.mean(np.abs(error[late]) <= bound[late]) >= 0.99


def test_wrap_of_the_counter_goes_unnoticed() -> None:
    plain, _ = stamped(CounterClock(HZ), session(2, start=0))
    clock = CounterClock(HZ)
    wrapped, _ = stamped(clock, session(2, start=2**32 - 1000))
    assert clock.restarts == 0
    np.testing.assert_allclose(wrapped, plain, atol=1e-7)


@pytest.mark.parametrize("jump", [-100_000, 40, 100_000], ids=["restart", "two thirds of a second", "far ahead"])
def test_a_jump_of_the_counter_restarts_the_line(jump: int) -> None:
    readings = session(3, start=200_000)
    readings.counter[1200:] += jump
    clock = CounterClock(HZ)
    error, bound = stamped(clock, readings)
    assert clock.restarts == 1
    assert np.all(np.abs(error[1200:]) <= np.maximum(bound[1200:], 0.075))
    assert np.median(np.abs(error[1200 + SETTLED :])) < 0.5e-3


@pytest.mark.parametrize("shift_s", [-0.1, 0.1], ids=["earlier", "later"])
def test_a_small_shift_of_the_device_clock_is_noticed_by_misfit(shift_s: float) -> None:
    readings = session(4)
    readings.truth_s[1200:] += shift_s
    readings.arrival_s[1200:] += shift_s
    readings.arrival_s = np.maximum.accumulate(readings.arrival_s + 1e-6 * np.arange(len(readings.arrival_s)))
    clock = CounterClock(HZ)
    error, _ = stamped(clock, readings)
    assert clock.restarts >= 1
    assert np.median(np.abs(error[1200 + 2 * SETTLED :])) < 3e-3


def test_bound_shrinks_as_evidence_comes_in() -> None:
    _, bound = stamped(CounterClock(HZ), session(5))
    assert bound[0] >= 0.05
    assert bound[60] > bound[300] > 0.9 * bound[2000]


def test_the_stamp_never_lies_after_the_arrival() -> None:
    readings = session(6, seconds=10)
    clock = CounterClock(HZ)
    for counter, arrival_s in zip(readings.counter, readings.arrival_s, strict=True):
        arrival_ns = round(arrival_s * 1e9)
        assert clock.stamp(int(counter), arrival_ns).t_ns <= arrival_ns
