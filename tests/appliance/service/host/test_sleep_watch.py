"""Sleep of the computer is told from two clocks that are read one after the other."""

import pytest

from probewatch.appliance.service.host.sleep_watch import SleepWatch, slept_ns

MS_NS = 1_000_000
HOUR_NS = 3_600_000_000_000


def looked(*bounds: tuple[int, int]) -> list[float | None]:
    told = iter(bounds)
    watch = SleepWatch(lambda: next(told))
    return [watch.look() for _ in bounds]


def test_a_sleep_is_told_once_with_its_length() -> None:
    awake, woken = (HOUR_NS, HOUR_NS + 1000), (2 * HOUR_NS, 2 * HOUR_NS + 1000)
    assert looked(awake, awake, woken, woken, woken) == [None, None, pytest.approx(3600), None, None]


def test_a_process_that_waits_between_the_two_clocks_has_not_slept() -> None:
    """Before the first or behind it, for ten seconds: the bounds are wide, and nothing follows from them."""
    wide = (HOUR_NS - 10_000 * MS_NS, HOUR_NS + 10_000 * MS_NS)
    assert looked((HOUR_NS, HOUR_NS), wide, (HOUR_NS, HOUR_NS), wide) == [None] * 4
    assert looked(wide, (HOUR_NS, HOUR_NS), wide) == [None] * 3


def test_a_sleep_is_found_though_a_look_before_it_knew_little() -> None:
    wide = (HOUR_NS - 10_000 * MS_NS, HOUR_NS + 10_000 * MS_NS)
    found = looked((HOUR_NS, HOUR_NS + 1000), wide, (HOUR_NS + 2000 * MS_NS, HOUR_NS + 2000 * MS_NS))
    assert found == [None, None, pytest.approx(2, abs=0.01)]


def test_this_computer_is_awake() -> None:
    least_ns, most_ns = slept_ns()
    assert least_ns <= most_ns
    watch = SleepWatch()
    assert [watch.look() for _ in range(1000)] == [None] * 1000
