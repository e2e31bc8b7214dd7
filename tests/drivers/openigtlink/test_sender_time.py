"""Stamps of a sender that tells its time in steps, as Windows does: the bound covers the step."""

from random import Random

import numpy as np
import pytest
from numpy.typing import NDArray

from probewatch.drivers.openigtlink.sender_time import SenderTime

UTC_NS = 1_750_000_000_000_000_000
SECONDS = 30
SETTLED_S = 5
Floats = NDArray[np.float64]


def stamped(told_s: Floats, truth_s: Floats, delay_s: Floats) -> tuple[Floats, Floats]:
    """(error, bound) of every measurement that has a new time, s."""
    clock, arrival_s, found = SenderTime(0, 0), np.maximum.accumulate(truth_s + delay_s), []
    for index, new in enumerate(np.diff(told_s, prepend=-1.0) > 0):
        time_ns = UTC_NS + round(told_s[index] * 1e9)
        clock.note(time_ns)
        if not new:
            continue
        stamp = clock.stamp(time_ns, 10**9 + round(arrival_s[index] * 1e9))
        found.append((truth_s[index], stamp.t_ns / 1e9 - 1 - truth_s[index], stamp.err_ns / 1e9))
    since_s, error, bound = np.array(found).T
    return error[since_s > SETTLED_S], bound[since_s > SETTLED_S]


@pytest.mark.parametrize("tick_s", [0.001, 0.010, 0.015625, 0.016])
@pytest.mark.parametrize("rate_hz", [20.0, 60.0, 100.0])
@pytest.mark.parametrize("delay_s", [0.0002, 0.004])
def test_the_bound_covers_the_steps_in_which_a_sender_tells_its_time(
    tick_s: float, rate_hz: float, delay_s: float
) -> None:
    random = np.random.default_rng(5)
    truth_s = np.arange(1, SECONDS * rate_hz) * 1.00005 / rate_hz + 0.0031
    told_s = np.floor(truth_s / tick_s) * tick_s
    error, bound = stamped(told_s, truth_s, random.exponential(delay_s, len(truth_s)))
    held = np.mean(np.abs(error) <= bound)
    print(f"held {held:.4f}, median bound {np.median(bound) * 1e3:.2f} ms, worst {np.abs(error).max() * 1e3:.2f} ms")
    assert held >= 0.997
    assert np.median(bound) < tick_s + 3 * delay_s + 2e-3


@pytest.mark.parametrize("left_out", [0.0, 0.1])
@pytest.mark.parametrize("jitter_s", [0.0, 0.0003])
def test_times_that_are_exact_keep_their_narrow_bound(left_out: float, jitter_s: float) -> None:
    """Also where measurements are left out, whose differences are multiples of the period."""
    random = np.random.default_rng(6)
    truth_s = np.arange(1, SECONDS * 60) / 60
    truth_s = truth_s[random.random(len(truth_s)) >= left_out]
    told_s = truth_s + random.normal(0, jitter_s, len(truth_s))
    _, bound = stamped(told_s, truth_s, random.exponential(0.0005, len(truth_s)))
    assert np.median(bound) < 2.5e-3


@pytest.mark.parametrize("seed", [62, 116])
def test_times_that_leap_by_centuries_end_no_thread(seed: int) -> None:
    """A server tells any 64 bits. With these seeds a leap after a pause of two minutes amid late messages ended the
    thread of its tracker; the bound stays one that can be handed on.
    """
    random, clock, arrival_ns = Random(seed), SenderTime(0, 0), 10**13
    for _ in range(400):
        arrival_ns += random.choice([10**7, 16 * 10**6, 3 * 10**8, 10**9])
        true_ns = 10**15 + arrival_ns
        leapt = [1, 2**31 * 10**9, (2**32 - 1) * 10**9, random.randrange(1, 2**32 * 10**9)]
        told_ns = random.choice([*leapt, true_ns, true_ns - random.randrange(10**9)])
        clock.note(told_ns)
        assert 0 <= clock.stamp(told_ns, arrival_ns).err_ns <= 60 * 10**9
