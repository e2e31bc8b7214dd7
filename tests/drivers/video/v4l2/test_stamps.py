"""Kernel stamps → mid-exposure host time; the wrapping counter."""

import itertools

import pytest

from probewatch.drivers.video.v4l2 import abi
from probewatch.drivers.video.v4l2.stamps import Counter, FrameTimes

MS = 1_000_000
PERIOD = 40 * MS
T = 1_000_000 * MS
SOE = abi.BUF_FLAG_TIMESTAMP_MONOTONIC | abi.BUF_FLAG_TSTAMP_SRC_SOE
EOF = abi.BUF_FLAG_TIMESTAMP_MONOTONIC
COPIED, UNKNOWN = 0x4000, 0


def test_the_start_of_a_picture_lies_half_a_period_before_its_middle() -> None:
    stamp = FrameTimes(PERIOD).stamp(SOE, T, T + 45 * MS)
    assert stamp.t_ns == T + 20 * MS
    assert stamp.err_ns == pytest.approx(20 * MS, abs=MS)


def test_the_end_of_a_picture_lies_half_a_period_after_its_middle() -> None:
    stamp = FrameTimes(PERIOD).stamp(EOF, T, T + 2 * MS)
    assert stamp.t_ns == T - 20 * MS
    assert stamp.err_ns == pytest.approx(20 * MS, abs=MS)


@pytest.mark.parametrize("flags", [SOE, EOF])
@pytest.mark.parametrize("exposed_ms", [0.0, 10.0, 39.9])
def test_the_bound_holds_wherever_in_its_period_the_picture_was_made(flags: int, exposed_ms: float) -> None:
    truth = T + round(exposed_ms * MS)
    kernel = T if flags == SOE else T + PERIOD
    stamp = FrameTimes(PERIOD).stamp(flags, kernel, T + PERIOD + 3 * MS)
    assert abs(stamp.t_ns - truth) <= stamp.err_ns


@pytest.mark.parametrize("flags", [COPIED, UNKNOWN])
def test_another_clock_is_not_believed_and_the_bound_says_so(flags: int) -> None:
    times = FrameTimes(PERIOD)
    stamp = times.stamp(flags, 5, T)
    assert times.foreign == 1
    assert stamp.err_ns >= PERIOD
    assert T - stamp.t_ns <= stamp.err_ns


def test_a_monotonic_flag_with_a_stamp_of_another_epoch_is_not_believed() -> None:
    times = FrameTimes(PERIOD)
    times.stamp(EOF, T + 3600_000 * MS, T)
    assert times.foreign == 1


def test_a_stamp_from_the_future_is_drawn_back_and_widens_the_bound() -> None:
    times = FrameTimes(PERIOD)
    stamp = times.stamp(EOF, T + 36 * MS, T)
    assert times.ahead == 1
    assert stamp.t_ns == T - 20 * MS
    assert stamp.err_ns >= 20 * MS + 36 * MS
    assert times.stamp(SOE, T + 136 * MS, T + 100 * MS).t_ns <= T + 100 * MS


def test_stamps_run_forward_also_after_a_change_of_clock() -> None:
    times = FrameTimes(PERIOD)
    first = times.stamp(SOE, T, T + 41 * MS)
    second = times.stamp(UNKNOWN, 0, T + 39 * MS)
    assert second.t_ns > first.t_ns
    assert second.err_ns >= PERIOD + first.t_ns - (T + 19 * MS)


def test_the_counter_never_wraps_and_gaps_are_losses() -> None:
    counter = Counter()
    numbers = [counter.count(n) for n in (0xFFFFFFFD, 0xFFFFFFFE, 0xFFFFFFFF, 0, 1, 4)]
    assert [b - a for a, b in itertools.pairwise(numbers)] == [1, 1, 1, 1, 3]
    assert (counter.lost, counter.restarts) == (2, 0)


def test_a_counter_that_runs_backward_or_stands_still_begins_again() -> None:
    counter = Counter()
    numbers = [counter.count(n) for n in (100, 101, 0, 1, 1)]
    assert [b - a for a, b in itertools.pairwise(numbers)] == [1, 1, 1, 1]
    assert (counter.lost, counter.restarts) == (0, 2)
