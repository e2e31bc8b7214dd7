"""The line behind a scanner that averages: it tells the share in a gesture, and is as right and silent as without."""

from functools import cache

import pytest

from probewatch.appliance.core.line import Line
from probewatch.appliance.types import Verdict, VerdictKind
from probewatch.drivers.samples import Frame, GreyImage
from probewatch.drivers.twins.scene.processing import Processing, ProcessingScanner
from probewatch.tools.study.hazard import Hazard
from probewatch.tools.study.samples import Conditions, frame_times, samples
from probewatch.tools.study.session import Session
from tests.support.verdicts import faults

SHARES = (0.3, 0.5, 0.7)
THOROUGH = pytest.mark.thorough


@cache
def plain(name: str, seconds: float, seed: int) -> tuple[Session, list[GreyImage]]:
    """What the scanner has not averaged, in still and rigid tissue."""
    session = Session(name, "rigid", seed, seconds)
    poses = session.pictures(frame_times(session))
    return session, [session.world.plain_at(pose, k) for k, pose in enumerate(poses)]


def watched(
    name: str, seconds: float, share: float, hazard: str = "none", seed: int = 1
) -> tuple[Line, list[Verdict], int]:
    """The line after a session, its verdicts, and the number of pictures until a share was believed."""
    session, pictures = plain(name, seconds, seed)
    scanner = ProcessingScanner(Processing(persistence=share))
    shown = [session.world.on_screen(scanner.processed(one)) for one in pictures]
    conditions = Conditions(session, Hazard.parse(hazard))
    line, verdicts, told = Line(session.reference, conditions.judging.limits), [], 0
    for sample in samples(conditions, shown):
        verdicts += line.step(sample)
        told += isinstance(sample, Frame) and not line.averaged
    return line, verdicts, told


def first_ok_s(verdicts: list[Verdict]) -> float:
    ok = [one.t_ns for one in verdicts if one.kind is VerdictKind.OK]
    return (ok[0] - verdicts[0].t_ns) / 1e9 if ok else float("inf")


@pytest.mark.parametrize("share", [0.5, *(pytest.param(share, marks=THOROUGH) for share in (0.3, 0.7))])
def test_the_share_is_told_in_two_seconds_of_the_gesture(share: float) -> None:
    line, _, told = watched("gesture", 2.0, share)
    assert line.averaged == pytest.approx(share, abs=0.02)
    assert told <= 55


@THOROUGH
def test_without_averaging_none_is_told() -> None:
    assert watched("gesture", 2.0, 0.0)[0].averaged == 0


@THOROUGH
@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_gesture_is_verified_and_nothing_is_found_late(share: float, seed: int) -> None:
    _, verdicts, _ = watched("gesture", 8.0, share, seed=seed)
    assert faults(verdicts) == []
    assert first_ok_s(verdicts) <= 6.0
    latency = next(check for check in verdicts[-1].checks if check.name == "latency")
    assert abs(latency.value) <= 3.0


@THOROUGH
@pytest.mark.parametrize("share", SHARES)
def test_a_fan_without_a_gesture_before_it_accuses_nothing(share: float) -> None:
    """What was seen too short looked like a scale that is wrong: FAULT scale at .3."""
    _, verdicts, _ = watched("fan", 30.0, share, seed=2)
    assert faults(verdicts) == []


@THOROUGH
@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("hazard", ["scale-axial=10", "scale-lateral=-10", "latency=120"])
def test_what_is_wrong_is_named_nothing_else_and_never_verified(share: float, hazard: str) -> None:
    """Ten seconds of the gesture name a lag; a scale they may leave open."""
    _, verdicts, _ = watched("gesture", 10.0, share, hazard + "@start")
    name = "latency" if "latency" in hazard else "scale"
    assert faults(verdicts) in ([name], [] if name == "scale" else [name])
    assert first_ok_s(verdicts) == float("inf")
