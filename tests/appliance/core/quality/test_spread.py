"""A solution that is spread over pictures: the same as one made at once, of the motion of when it fell due, or none."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.quality.evidence import Evidence
from probewatch.appliance.core.quality.examination import examine_nothing
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Check, Fault, VerdictKind
from tests.support.motions import TRUTH, tilting_path
from tests.support.windows import filled

S_NS = 1_000_000_000
MOST_PIECE_US = 6000
"""As much as the line spends at a picture at 30 Hz."""
PIECES = 60
"""More than the solution of the window below has."""


def whole_window(seconds: float = 10.0) -> PathWindow:
    return filled(tilting_path, seconds, 1)


def known(window: PathWindow) -> Evidence:
    return Evidence(TRUTH, Limits(), window)


def run_out(evidence: Evidence) -> int:
    pieces = 0
    while evidence.under_way:
        evidence.go_on(0)
        pieces += 1
    return pieces


def values(checks: tuple[Check, ...]) -> list[tuple[object, ...]]:
    return [(one.name, repr(one.value), repr(one.sigma), one.verdict, one.shown_ns) for one in checks]


@pytest.mark.parametrize("most_us", [0, 5000])
def test_what_comes_while_it_is_under_way_is_not_in_it(most_us: int) -> None:
    whole = whole_window(12.0)
    motions = list(whole._seen)
    at_once, spread = (known(PathWindow(TRUTH)) for _ in range(2))
    for evidence in (at_once, spread):
        evidence.window.poses = whole.poses.as_now()
        for motion in motions[:300]:
            evidence.window.add(motion)
    due_ns = motions[299].stamp.t_ns
    at_once.solve(due_ns)
    spread.begin(due_ns)
    for motion in motions[300:]:
        spread.window.add(motion)
        spread.go_on(most_us)
    assert not spread.under_way
    assert values(spread.checks()) == values(at_once.checks())
    assert spread.status.verified_ns == at_once.status.verified_ns is not None
    assert all(one.shown_ns is None or one.shown_ns <= due_ns for one in spread.checks())


def lost(evidence: Evidence) -> None:
    evidence.lose_sight()


def changed(evidence: Evidence) -> None:
    evidence.restart()


def pictures_forgotten(evidence: Evidence) -> None:
    evidence.forget(evidence.window.start_ns)


def poses_forgotten(evidence: Evidence) -> None:
    evidence.forget_poses(evidence.window.start_ns)


@pytest.mark.parametrize("done", [1, 7, 15, PIECES])
@pytest.mark.parametrize("withdrawn", [lost, changed, pictures_forgotten, poses_forgotten])
def test_a_solution_of_what_was_withdrawn_is_dropped(withdrawn: Callable[[Evidence], None], done: int) -> None:
    """PIECES: until only the last piece is left."""
    evidence = known(whole_window())
    evidence.begin(evidence.window.now_ns)
    pieces = run_out(evidence)
    assert evidence.status.verified_ns is not None
    assert 15 < pieces < PIECES
    evidence = known(whole_window())
    evidence.begin(evidence.window.now_ns)
    for _ in range(min(done, pieces - 1)):
        evidence.go_on(0)
    assert evidence.under_way
    withdrawn(evidence)
    run_out(evidence)
    assert evidence.status.verified_ns is None
    assert values(evidence.checks()) == values(examine_nothing(Limits()).checks)


def test_a_sign_from_elsewhere_drops_it(monkeypatch: pytest.MonkeyPatch) -> None:
    evidence = known(whole_window(1.5))
    flip = next(one for one in evidence.checks() if one.fault is Fault.POLARITY)
    evidence.begin(evidence.window.now_ns)
    evidence.go_on(0)
    flip = replace(flip, value=1.0, verdict=VerdictKind.FAULT)
    monkeypatch.setattr("probewatch.appliance.core.quality.evidence.obvious_flip", lambda *_: flip)
    evidence.check_obvious_flip()
    assert not evidence.under_way
    assert flip in evidence.checks()


def test_a_report_waits_for_it() -> None:
    at_once, spread = known(whole_window()), known(whole_window())
    at_once.solve(at_once.window.now_ns)
    spread.begin(spread.window.now_ns)
    spread.go_on(0)
    assert values(spread.final(spread.finish())) == values(at_once.final(at_once.finish()))
    assert not spread.under_way


@pytest.mark.parametrize("seconds", [10.0, pytest.param(30.0, marks=pytest.mark.thorough)])
def test_no_piece_is_long(seconds: float) -> None:
    """By its own account; `make bench` measures it."""
    evidence = known(whole_window(seconds))
    evidence.begin(evidence.window.now_ns)
    costs_us = list[int]()
    while evidence.under_way:
        evidence.go_on(0)
        costs_us.append(evidence._solution.next_us)
    assert max(costs_us) <= MOST_PIECE_US
    assert sum(costs_us) > 2 * MOST_PIECE_US, "or there is nothing to spread"
