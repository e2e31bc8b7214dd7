"""Stamps decide what enters the line: a false one holds nothing up, and nothing that goes back in time gets in."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from probewatch.appliance.core.acquisition.stamp_gate import StampCheck, StampGate

MS = 1_000_000
IN, REFUSED, WENT_BACKWARDS = StampCheck.IN, StampCheck.REFUSED, StampCheck.WENT_BACKWARDS


def checks(*times_ms: float) -> list[StampCheck]:
    gate = StampGate()
    return [gate.step(round(t * MS)) for t in times_ms]


def test_a_stream_in_order_passes() -> None:
    assert checks(0, 33, 66, 1800, 1833) == [IN] * 5


@pytest.mark.parametrize("again_ms", [33, 20, -5000])
def test_a_stamp_that_does_not_go_forward_is_refused(again_ms: float) -> None:
    assert checks(0, 33, again_ms, 66) == [IN, IN, REFUSED, IN]


def test_stamps_all_alike_never_pass_again() -> None:
    assert checks(*[40] * 200) == [IN] + [REFUSED] * 199


@pytest.mark.parametrize("times_ms", [(40, 40, 40, 40), (40, 30, 20, 10), (40, 5000, 20, 9000)])
def test_a_stream_whose_time_nobody_knows_is_lost_until_its_stamps_go_on(times_ms: tuple[int, ...]) -> None:
    gate, lost = StampGate(), []
    for t_ms in (*times_ms, 73):
        gate.step(t_ms * MS)
        lost.append(gate.lost)
    assert lost == [False, False, False, True, False]


def test_a_leap_that_is_true_loses_nothing() -> None:
    gate = StampGate()
    for t_ms in (0, 33, 9000, 9033, 9066, 33, 66, 99):
        gate.step(t_ms * MS)
        assert not gate.lost


def test_one_stamp_far_in_the_future_is_refused_and_holds_nothing_up() -> None:
    assert checks(0, 33, 3_600_000, 66, 99) == [IN, IN, REFUSED, IN, IN]


def test_a_stamp_a_little_in_the_future_is_found_out_by_the_next_three() -> None:
    assert checks(0, 33, 900, 66, 99, 133, 166) == [IN, IN, IN, REFUSED, REFUSED, WENT_BACKWARDS, IN]


def test_a_future_stamp_before_all_others_is_found_out_too() -> None:
    assert checks(10_000, 33, 66, 99, 133) == [IN, REFUSED, REFUSED, WENT_BACKWARDS, IN]


def test_after_a_gap_the_stream_passes_once_three_agree() -> None:
    assert checks(0, 33, 9000, 9033, 9066, 9100) == [IN, IN, REFUSED, REFUSED, IN, IN]


@given(st.lists(st.integers(0, 10**11), max_size=80), st.integers(0, 10**11))
def test_whatever_came_before_good_samples_pass_within_a_second(stamps: list[int], start_ns: int) -> None:
    gate = StampGate()
    for t_ns in stamps:
        gate.step(t_ns)
    passed = [gate.step(start_ns + k * 250 * MS) for k in range(8)]
    assert all(passage is not REFUSED for passage in passed[3:])


@given(st.lists(st.integers(0, 10**11), max_size=80))
def test_what_is_let_in_goes_forward_unless_it_says_that_it_turned_back(stamps: list[int]) -> None:
    gate = StampGate()
    for t_ns in stamps:
        before_ns = gate.last_ns
        passage = gate.step(t_ns)
        if passage is IN and before_ns is not None:
            assert t_ns > before_ns
        assert (gate.last_ns == t_ns) or passage is REFUSED
