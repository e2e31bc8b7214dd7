"""What excuses a failure in real time, and what does not: the judgement, and that what is measured is true."""

import os
import subprocess
import sys
from collections.abc import Callable
from math import nan

import pytest

from tests.rules.machine_load import MOST_OTHERS, MOST_WAITED, TOO_SLOW, Load, LoadMeter
from tests.rules.retried import second_result

BUSY = Load(MOST_OTHERS, MOST_WAITED)


@pytest.mark.parametrize(
    ("others", "waited"),
    [
        pytest.param(0.0, 0.0, id="quiet"),
        pytest.param(0.0, 1.0, id="the tests kept themselves waiting"),
        pytest.param(1.0, 0.0, id="others took what the tests left over"),
        pytest.param(MOST_OTHERS - 0.001, 1.0, id="others just below"),
        pytest.param(1.0, MOST_WAITED - 0.001, id="waited just below"),
        pytest.param(nan, 1.0, id="others unknown"),
        pytest.param(1.0, nan, id="waiting unknown"),
        pytest.param(nan, nan, id="all unknown"),
    ],
)
def test_a_machine_is_too_busy_only_if_both_figures_say_so(others: float, waited: float) -> None:
    assert BUSY.too_busy()
    assert not Load(others, waited).too_busy()


@pytest.mark.parametrize(("waited", "slow"), [(TOO_SLOW, True), (TOO_SLOW - 0.01, False), (nan, False)])
def test_a_machine_is_too_slow_where_tests_wait_whoever_keeps_them(waited: float, slow: bool) -> None:
    assert Load(0.0, waited).too_slow() is slow


@pytest.mark.parametrize(
    ("code", "busy", "good", "said"),
    [
        (0, False, True, "passed alone"),
        (0, True, True, "passed alone"),
        (1, False, False, f"failed alone ({BUSY})"),
        (1, True, True, f"NOT JUDGED: this computer was too busy ({BUSY})"),
        *((code, True, False, f"failed alone ({BUSY})") for code in (2, 3, 4, 5, -9)),
    ],
)
def test_only_a_test_that_ran_and_failed_on_a_busy_machine_is_not_judged(
    code: int, busy: bool, good: bool, said: str
) -> None:
    assert second_result(code, BUSY, busy) == (good, said)


def spins(seconds: float) -> list[str]:
    """A program that takes so much of a processor, however long that may last."""
    return [sys.executable, "-c", f"import time\nwhile time.thread_time() < {seconds}: pass"]


def orphans(command: list[str]) -> list[str]:
    """A program that leaves this one behind and ends."""
    return [sys.executable, "-c", f"import subprocess; subprocess.Popen({command})"]


@pytest.mark.parametrize("wrapped", [list, orphans])
def test_what_tests_start_and_leave_behind_is_their_own(wrapped: Callable[[list[str]], list[str]]) -> None:
    """Its end is the end of its output."""
    with LoadMeter() as meter:
        subprocess.run(wrapped(spins(0.2)), stdout=subprocess.PIPE, check=True)
    assert meter.own_s >= 0.2


@pytest.mark.thorough
def test_threads_that_share_one_processor_have_waited() -> None:
    """Four of them, so that each may run for a quarter of the time at most."""
    one = min(os.sched_getaffinity(0))
    with LoadMeter() as meter:
        pinned = [subprocess.Popen(["taskset", "-c", str(one), *spins(0.8)]) for _ in range(4)]
        assert [process.wait() for process in pinned] == [0] * 4
    assert meter.load.waited >= MOST_WAITED
