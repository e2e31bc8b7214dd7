"""The line over ribs and gas, whose shadows do not turn with tissue: a healthy probe is verified, not accused."""

from functools import cache

import pytest

from appliance.core.line import Line
from appliance.types import Verdict, VerdictKind
from tests.support.kept_pictures import sessions
from tests.support.verdicts import faults
from tools.study.hazard import Hazard
from tools.study.samples import Conditions, rendered, samples
from tools.study.session import Session

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


def test_a_sweep_over_a_rib_accuses_nothing() -> None:
    """Without the mask of shadows, the line named a wrong rotation about the axial axis, 11.9 of its sigmas off."""
    assert faults(watched("elevational-10", "ribs-1", 30.0, 1)) == []


@pytest.mark.parametrize("hazard", ["slide-axial=8@start", "bend-lateral=6@start"])
def test_a_wrong_probe_over_ribs_is_found(hazard: str) -> None:
    verdicts = watched("gesture", "ribs-2", 10.0, 1, hazard)
    assert all(one.kind is not VerdictKind.OK for one in verdicts)
    assert faults(verdicts)
