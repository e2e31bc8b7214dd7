"""Delays are counted where they belong, and none is lost."""

from hypothesis import given
from hypothesis import strategies as st

from probewatch.appliance.service.host.delay_histogram import DelayHistogram
from probewatch.appliance.service.host.tick_meter import TickMeter


def test_a_bound_belongs_to_the_count_below_it() -> None:
    histogram = DelayHistogram((1.0, 10.0))
    for delay_ms in (0.5, 1.0, 1.001, 10.0, 10.001, 500.0):
        histogram.note(delay_ms)
    assert histogram.fields() == {"le_ms": [1.0, 10.0], "counts": [2, 2, 2], "sum_ms": 522.502}


@given(st.lists(st.floats(0, 1e6)))
def test_every_delay_is_in_one_count(delays_ms: list[float]) -> None:
    histogram = DelayHistogram((1.0, 10.0, 100.0))
    for delay_ms in delays_ms:
        histogram.note(delay_ms)
    assert sum(histogram.fields()["counts"]) == len(delays_ms)


def test_the_ticks_are_counted_since_the_start() -> None:
    meter = TickMeter(50_000_000)
    for tick in range(5001):
        meter.note(tick * 50_000_000)
    histogram = meter.fields()["histogram"]
    at_50_ms = histogram["le_ms"].index(50.0)
    assert (histogram["counts"][at_50_ms], sum(histogram["counts"])) == (5000, 5000)
    assert histogram["sum_ms"] == 250_000
