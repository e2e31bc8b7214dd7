"""The line over tissue that gives way: a healthy probe is verified and not accused, and no wrong one hides there."""

import pytest

from appliance.core.line import Line
from appliance.types import Verdict, VerdictKind
from tests.support.kept_pictures import sessions
from tests.support.verdicts import faults
from tools.study.hazard import Hazard
from tools.study.samples import Conditions, rendered, samples
from tools.study.session import Session

pytestmark = pytest.mark.thorough


def watched(tissue: str, seconds: float, seed: int, hazard: str = "none") -> list[Verdict]:
    """What the line says of the gesture over this tissue."""
    session = Session("gesture", tissue, seed, seconds)
    conditions = Conditions(session, Hazard.parse(hazard))
    line = Line(session.reference, conditions.judging.limits)
    return [verdict for sample in samples(conditions, rendered(session, sessions())) for verdict in line.step(sample)]


@pytest.mark.parametrize("tissue", ["half-30+deep", "half-20+deep", "layer-80+deep"])
def test_a_healthy_probe_is_accused_of_nothing(tissue: str) -> None:
    assert faults(watched(tissue, 8.0, 1)) == []


def test_a_healthy_probe_is_verified_by_the_gesture_over_a_half_space() -> None:
    assert any(verdict.kind is VerdictKind.OK for verdict in watched("half-30+deep", 8.0, 3))


@pytest.mark.parametrize("tissue", ["foam-0.1", "foam-0.1+deep"])
@pytest.mark.parametrize("percent", [-10, 11])
def test_tissue_that_follows_as_a_whole_hides_no_wrong_axial_scale(tissue: str, percent: int) -> None:
    """By the share of a turn that ∂u_y/∂x shows alone, −10 % was OK after 2.7 s."""
    verdicts = watched(tissue, 6.0, 1, f"scale-axial={percent}@start")
    assert all(verdict.kind is not VerdictKind.OK for verdict in verdicts)


@pytest.mark.parametrize("hazard", ["slide-lateral=8@start", "depth=10@start"])
def test_a_wrong_probe_is_never_verified(hazard: str) -> None:
    assert all(verdict.kind is not VerdictKind.OK for verdict in watched("half-30+deep", 10.0, 1, hazard))
