"""The line over ribs and gas, whose shadows do not turn with tissue: a healthy probe is verified, not accused."""

from functools import cache

import numpy as np
import pytest

from probewatch.appliance.core.line import Line
from probewatch.appliance.core.registration.pyramid import pyramid
from probewatch.appliance.core.registration.shadow import Shadows
from probewatch.appliance.types import Verdict, VerdictKind
from probewatch.tools.study.hazard import Hazard
from probewatch.tools.study.samples import Conditions, rendered, samples
from probewatch.tools.study.session import Session
from tests.support.kept_pictures import sessions
from tests.support.verdicts import faults

pytestmark = pytest.mark.thorough


@cache
def watched(name: str, tissue: str, seconds: float, seed: int, hazard: str = "none") -> list[Verdict]:
    session = Session(name, tissue, seed, seconds)
    conditions = Conditions(session, Hazard.parse(hazard))
    line = Line(session.reference, conditions.judging.limits)
    return [verdict for sample in samples(conditions, rendered(session, sessions())) for verdict in line.step(sample)]


@pytest.mark.parametrize("tissue", ["ribs-1", "ribs-2", "gas-1", "peel-0.6"])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_gesture_is_verified_in_six_seconds(tissue: str, seed: int) -> None:
    verdicts = watched("gesture", tissue, 6.0, seed)
    assert faults(verdicts) == []
    assert any(one.kind is VerdictKind.OK for one in verdicts)


def test_the_shadow_of_gas_is_found_in_every_picture() -> None:
    """With a threshold of .15 three of sixty kept it, and a third of the line's keyframes: ∂u_x/∂y then showed 9 % too
    little of the turn.
    """
    shadows = Shadows()
    pictures = rendered(Session("gesture", "gas-1", 2, 6.0), sessions())[::3]
    seen = [shadows.outside(pyramid(picture), np.ones(picture.shape, bool)) for picture in pictures]
    assert not any(one is None or one.all() for one in seen)


def test_a_sweep_over_a_rib_accuses_nothing() -> None:
    """Without the mask of shadows, the line named a wrong rotation about the axial axis, 11.9 of its sigmas off."""
    assert faults(watched("elevational-10", "ribs-1", 30.0, 1)) == []


@pytest.mark.parametrize("hazard", ["slide-axial=8@start", "bend-lateral=6@start"])
def test_a_wrong_probe_over_ribs_is_found(hazard: str) -> None:
    verdicts = watched("gesture", "ribs-2", 10.0, 1, hazard)
    assert all(one.kind is not VerdictKind.OK for one in verdicts)
    assert faults(verdicts)
