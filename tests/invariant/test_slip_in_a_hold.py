"""A marker body that slides as the hand has just come to rest: pictures to contact."""

import pytest

from probewatch.appliance.core.quality import stationary_time
from probewatch.tools.study import hazard
from probewatch.tools.study.hazard import Hazard
from probewatch.tools.study.outcome import run
from probewatch.tools.study.samples import Conditions, rendered
from probewatch.tools.study.session import Session
from tests.support.kept_pictures import sessions

SLIDES_S, FOR_S = 9.0, 1.0
"""Two seconds after the hand came to rest, amid a breath: no picture is like the rest's first anchor."""
AGE_S, TICK_S = 30.0, 0.02
"""Of what the hold does not show; and how often the supervisor looks."""


@pytest.mark.thorough
@pytest.mark.parametrize("blind_s", [None, 1000.0], ids=["as shipped", "were a slip taken for the hand"])
def test_no_rest_carries_an_ok_across_a_slide_that_no_picture_could_show(
    monkeypatch: pytest.MonkeyPatch, blind_s: float | None
) -> None:
    """5 mm out of the plane, where neither the slip watches nor a held probe's motion see it."""
    monkeypatch.setattr(hazard, "ONSET_S", SLIDES_S)
    monkeypatch.setattr(hazard, "CREEP_S", FOR_S)
    if blind_s is not None:
        monkeypatch.setattr(stationary_time, "_BLIND_NS", round(blind_s * 1e9))
    session = Session("gesture-hold", "breathing", 1, 50.0)
    outcome = run(Conditions(session, Hazard.parse("slide-elevational=-5@creeping")), rendered(session, sessions()))
    assert outcome.closed > 0.5, "it was verified before"
    assert (outcome.opened_s <= AGE_S + TICK_S) is (blind_s is None)
