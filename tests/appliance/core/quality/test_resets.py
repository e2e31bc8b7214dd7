"""The table of what each cause resets in the evidence, and that the evidence does as it says."""

import pytest

from probewatch.appliance.core.path.tissue_compliance import TissueMotion
from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.quality.evidence import Evidence
from probewatch.appliance.core.quality.resets import RESETS, Cause, Effect, State
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import DRAGS, PRESSES
from tests.support.motions import TRUTH, tilting_path
from tests.support.windows import ORIGIN_NS, filled

VERIFIED_S = 6.0
"""Seconds of motion after which the scales are shown."""


def fresh() -> Evidence:
    return Evidence(TRUTH, Limits(), PathWindow(TRUTH))


def followed() -> Evidence:
    """Evidence that has followed six seconds of motion of the right calibration."""
    evidence, whole = fresh(), filled(tilting_path, VERIFIED_S, 6)
    evidence.window.poses = whole.poses
    for index, seen in enumerate(whole._seen):
        evidence.window.add(seen)
        if index % 10 == 9:
            evidence.solve(evidence.window.now_ns)
    return evidence


def test_every_effect_in_the_table_has_what_makes_it_and_no_other() -> None:
    asked = {(state, effect) for state, effects in RESETS.items() for effect in effects.values()}
    assert fresh()._resets().keys() == {(state, effect) for state, effect in asked if effect is not Effect.KEPT}
    assert RESETS.keys() == set(State)


def test_nothing_shown_outlives_a_cause_but_wrong_pose_timestamps_and_no_cause_clears_a_contradiction() -> None:
    """Poses whose timestamps turn out to be of the future have paired with no picture."""
    assert [cause for cause in Cause if RESETS[State.SHOWN][cause] is Effect.KEPT] == [Cause.POSE_STAMPS]
    assert {*RESETS[State.CONTRADICTIONS].values()} == {Effect.KEPT, Effect.CUT}


@pytest.mark.parametrize("cause", Cause)
def test_what_was_shown_and_the_motion_that_showed_it_go_as_the_table_says(cause: Cause) -> None:
    evidence = followed()
    assert evidence.shows("scale")
    pictures, since_ns = len(evidence.window._seen), ORIGIN_NS + 3_000_000_000
    before = sum(seen.stamp.t_ns < since_ns for seen in evidence.window._seen)
    assert 0 < before < pictures
    evidence.reset(cause, since_ns)
    shown = {Effect.KEPT: True, Effect.CUT: False, Effect.CLEARED: False}
    left = {Effect.KEPT: pictures, Effect.CUT: before, Effect.CLEARED: 0}
    assert evidence.shows("scale") is shown[RESETS[State.SHOWN][cause]]
    assert len(evidence.window._seen) == left[RESETS[State.MOTION][cause]]


def test_the_tissue_is_unknown_again_after_a_loss_of_sight_alone() -> None:
    evidence = fresh()
    assert evidence.window.tissue == DRAGS | PRESSES
    for cause in Cause:
        evidence.window._tissue = TissueMotion(0)
        evidence.reset(cause, ORIGIN_NS)
        assert evidence.window.tissue == (DRAGS | PRESSES if cause is Cause.SIGHT_LOST else 0), cause
