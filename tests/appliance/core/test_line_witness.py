"""A second marker body in the whole line: what it names, and what motion makes of it."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.line import Line
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Fault, Verdict, VerdictKind
from probewatch.drivers.rigid import rigid, rotation_from_vector
from probewatch.drivers.samples import Matrix4, Pose, Sample
from probewatch.drivers.twins.faults import Schedule, spoil_pose
from tests.appliance.core.test_line import SMALL, truth
from tests.support.sessions import ORIGIN_NS, kept, session

RELATIVE_POSE = rigid(np.eye(3), np.array([80.0, 0.0, 10.0]))
BENT = rigid(rotation_from_vector(np.deg2rad([0.0, 3.0, 0.0])), np.zeros(3))
UNWITNESSED = 6.0


def witnessed(duration_s: float, bend: Matrix4, fault: str = "", at_s: float = UNWITNESSED) -> Iterator[Sample]:
    """The gesture with a second body: it is bent, or the first is spoiled by that fault, from at_s on."""
    world, rng = kept(3, "gestured", settings=SMALL), np.random.default_rng(4)
    for sample in session(world, duration_s, Schedule()):
        if not isinstance(sample, Pose):
            yield sample
            continue
        assert sample.matrix is not None
        late = (sample.stamp.t_ns - ORIGIN_NS) / 1e9 >= at_s
        noise = rigid(rotation_from_vector(rng.normal(0, 1e-3, 3)), rng.normal(0, 0.1, 3))
        first = spoil_pose(sample.matrix, {fault}) if late and fault else sample.matrix
        yield replace(
            sample, matrix=first, witness=sample.matrix @ RELATIVE_POSE @ (bend if late else np.eye(4)) @ noise
        )


def verdicts(samples: Iterator[Sample]) -> list[Verdict]:
    line = Line(truth(kept(3, "gestured", settings=SMALL)), Limits())
    return [verdict for sample in samples for verdict in line.step(sample)]


def seconds(verdict: Verdict) -> float:
    return (verdict.t_ns - ORIGIN_NS) / 1e9


@pytest.mark.thorough
def test_the_second_body_bends_and_motion_shows_that_the_calibration_holds() -> None:
    said = verdicts(witnessed(16.0, BENT))
    faults = [verdict for verdict in said if verdict.fault is not None]
    assert {verdict.fault for verdict in faults} == {Fault.MARKER_BODY_MOVED}
    assert UNWITNESSED < seconds(faults[0]) <= UNWITNESSED + 0.5
    assert "witness-turn" in faults[0].reason
    after = [verdict for verdict in said if verdict.t_ns > faults[-1].t_ns]
    assert after
    assert after[-1].kind is VerdictKind.OK
    assert faults[-1].t_ns - faults[0].t_ns > 1e9


@pytest.mark.thorough
def test_the_first_body_bends_and_motion_names_what_is_wrong_of_it_too() -> None:
    said = verdicts(witnessed(9.0, np.eye(4), "bend-marker"))
    first = next(verdict for verdict in said if verdict.fault is not None)
    assert UNWITNESSED < seconds(first) <= UNWITNESSED + 0.5
    last = said[-1]
    assert last.fault is Fault.ROTATION
    assert {check.fault for check in last.checks if check.verdict is VerdictKind.FAULT} >= {
        Fault.ROTATION,
        Fault.MARKER_BODY_MOVED,
    }
    assert "witness-turn" in last.reason


@pytest.mark.thorough
def test_without_faults_a_second_body_changes_nothing() -> None:
    said = verdicts(witnessed(7.0, np.eye(4)))
    assert not [verdict.reason for verdict in said if verdict.fault is not None]
    assert said[-1].kind is VerdictKind.OK
    assert {"witness-slide", "witness-turn"} <= {check.name for check in said[-1].checks}
