"""The whole line by each profile over one rendered gesture with a marker body that has slid by 2.2 mm."""

import pytest

from probewatch.appliance.core.line import Line
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Verdict, VerdictKind
from probewatch.tools.study.hazard import Hazard
from probewatch.tools.study.samples import Conditions, rendered, samples
from probewatch.tools.study.session import Session

CONDITIONS = Conditions(Session("gesture", "rigid", 3, 7.0), Hazard.parse("slide-lateral=2.2@start"))


@pytest.mark.thorough
def test_what_coarse_allows_no_tighter_profile_verifies_and_one_with_a_looser_limit_does() -> None:
    given = list(samples(CONDITIONS, rendered(CONDITIONS.session, None)))

    def told(limits: Limits) -> list[Verdict]:
        line = Line(CONDITIONS.session.reference, limits)
        return [one for sample in given for one in line.step(sample)]

    assert any(one.kind is VerdictKind.OK for one in told(Limits()))
    for profile in ("clinical", "fine"):
        tight = told(Limits(profile=profile))
        assert all(one.kind is not VerdictKind.OK and one.verified_ns is None for one in tight)
        assert any("offset-lateral" in one.reason for one in tight)
    own = told(Limits(profile="clinical", offset_mm=4.0, point_mm=8.0))
    assert any(one.kind is VerdictKind.OK for one in own), "the offset alone kept it from being verified"
