"""The whole line with a limit in millimetres, beside the same line without one, over a rendered gesture."""

import pytest

from probewatch.appliance.core.line import Line
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Verdict, VerdictKind
from probewatch.tools.study.hazard import Hazard
from probewatch.tools.study.point import errors_mm, places_mm
from probewatch.tools.study.samples import Conditions, rendered, samples, seconds
from probewatch.tools.study.session import Session

CONDITIONS = Conditions(Session("gesture", "rigid", 3, 7.0), Hazard.parse("bend-axial=0.8/slide-lateral=-1.2"))


def told(point_mm: float | None) -> list[Verdict]:
    line = Line(CONDITIONS.session.reference, Limits(point_mm=point_mm))
    return [one for sample in samples(CONDITIONS, rendered(CONDITIONS.session, None)) for one in line.step(sample)]


@pytest.mark.thorough
def test_it_only_withholds_and_the_bound_holds() -> None:
    plain, narrow = told(None), told(0.5)
    known = [one for one in plain if one.kind is VerdictKind.OK and one.point is not None]
    assert len(known) > 30, "a gesture of seven seconds shows all nine"
    places = places_mm(CONDITIONS)
    for one in known:
        assert one.point is not None
        assert (errors_mm(CONDITIONS, seconds(one.t_ns), places) ** 2).sum(axis=1).max() < one.point.worst_mm[1] ** 2
        assert one.point.median_mm[1] < one.point.worst_mm[1] < 6.0
    for without, beyond in zip(plain, narrow, strict=True):
        assert without.point == beyond.point
        assert without.fault == beyond.fault
        assert beyond.kind is not VerdictKind.OK
        assert beyond.verified_ns is None
        if without.kind is VerdictKind.OK and without.point is not None:
            assert beyond.reason.startswith("error of a point ")
            assert beyond.reason.endswith(" mm, limit 0.5 mm")
