"""The threshold that healthy scanning asks for, against tails whose truth is known."""

import numpy as np
import pytest

from probewatch.appliance.limits import FALSE_ALARM_H, MOST_NAMED_NATS, NAMED_NATS
from probewatch.tools.shared.noise_tail import LEVELS_NATS, least_hours, minutes_text, tail_of


def test_the_least_scanning_is_that_which_keeps_the_shipped_threshold_without_a_peak() -> None:
    hours = least_hours()
    assert tail_of([], hours).threshold_nats == pytest.approx(NAMED_NATS)
    assert tail_of([], 2 * hours).threshold_nats < NAMED_NATS < tail_of([], hours / 2).threshold_nats
    assert minutes_text(hours) == "46 min"


@pytest.mark.parametrize("length", [0.6, 1.0, 2.0])
def test_the_threshold_is_above_the_true_one_in_nineteen_of_twenty(length: float) -> None:
    """An exponential tail of known length, 4 peaks an hour, in 4 hours; the promise asks for its own quantile."""
    true = LEVELS_NATS[0] + length * np.log(FALSE_ALARM_H * 4)
    random = np.random.default_rng(1)
    told = [
        tail_of(LEVELS_NATS[0] + random.exponential(length, random.poisson(16)), 4.0).threshold_nats for _ in range(200)
    ]
    assert np.mean(np.array(told) >= true) >= 0.95


def test_a_tail_that_becomes_flatter_is_not_taken_for_its_steep_beginning() -> None:
    steep = [6.2] * 40
    flat = [12.5, 13.5, 15.0, 17.0, 19.0, 21.0]
    found = tail_of(steep + flat, 10.0)
    assert found.from_nats > LEVELS_NATS[0]
    assert found.threshold_nats > MOST_NAMED_NATS


def test_more_peaks_and_fewer_hours_ask_for_more() -> None:
    few, many = tail_of([7.0], 2.0), tail_of([7.0] * 10, 2.0)
    assert few.threshold_nats < many.threshold_nats
    assert tail_of([7.0], 1.0).threshold_nats > few.threshold_nats
    assert (few.exceedances, few.hours) == (1, 2.0)
