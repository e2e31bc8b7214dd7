"""Two marker bodies on one probe: what moves between them is named by the tracker alone, and nothing else is."""

from collections.abc import Iterable

import numpy as np
import pytest

from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.core.detectors.witness import LEARN_NS, Witness
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Check, Fault, VerdictKind
from probewatch.drivers.rigid import inverse, rigid, rotation_from_vector
from probewatch.drivers.samples import Matrix4, Pose, PoseStatus, Stamp
from probewatch.tools.development.witness_law import TRACKERS, Tracker, delays_s, noise, session

HZ = 60.0
RELATIVE_POSE = rigid(rotation_from_vector(np.array([0.3, -0.2, 1.0])), np.array([80.0, 10.0, -5.0]))
IMAGE = np.zeros((4, 4), np.uint8)
MINUTE = 65.0


def moved(change: np.ndarray) -> Matrix4:
    """The relative pose changed by (6,) mm and deg in the axes of the first body."""
    return rigid(
        rotation_from_vector(np.deg2rad(change[3:])) @ RELATIVE_POSE[:3, :3], RELATIVE_POSE[:3, 3] + change[:3]
    )


def hand(t_s: float) -> Matrix4:
    turn = np.array([0.4 * np.sin(t_s), 0.3 * np.cos(1.3 * t_s), 0.2 * t_s])
    return rigid(rotation_from_vector(turn), np.array([100 * np.sin(0.7 * t_s), 50 * np.cos(t_s), -1500.0]))


def poses(changes: np.ndarray, rate_hz: float = HZ, first: int = 0) -> Iterable[Pose]:
    """One for each row of (n, 6); a row of NaN hides the second body."""
    for k, change in enumerate(changes, first):
        matrix = hand(k / rate_hz)
        witness = None if np.isnan(change).any() else matrix @ moved(change)
        yield Pose(Stamp(round(k / rate_hz * 1e9), 0), k, matrix, 0.1, PoseStatus.OK, witness=witness)


def readings(seconds: float, tracker: Tracker = TRACKERS[0], seed: int = 5) -> np.ndarray:
    return noise(tracker, round(seconds * tracker.rate_hz), np.random.default_rng(seed)).astype(np.float64)


def fed(detector: Witness, changes: np.ndarray, rate_hz: float = HZ, first: int = 0) -> list[bool]:
    """Whether it names something after each pose."""
    said = []
    for pose in poses(changes, rate_hz, first):
        detector.pose(pose)
        said.append(named(detector))
    return said


def named(detector: Witness) -> bool:
    return any(check.verdict is VerdictKind.FAULT for check in detector.checks())


def of(detector: Witness, name: str) -> Check:
    return next(check for check in detector.checks() if check.name == name)


@pytest.mark.parametrize("change", [[1.0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 1.0, 0], [0, 0.6, -0.8, 0, 0, 0]])
def test_a_millimetre_or_a_degree_is_named_within_half_a_second(change: list[float]) -> None:
    detector, changes = Witness(Limits()), readings(MINUTE + 1)
    step = round(MINUTE * HZ)
    changes[step:] += change
    said = fed(detector, changes)
    assert not any(said[:step])
    assert 0 < said.index(True) - step <= 0.5 * HZ
    assert all(said[said.index(True) :])
    check = of(detector, "witness-turn" if any(change[3:]) else "witness-slide")
    assert (check.fault, check.verdict) == (Fault.MARKER_BODY_MOVED, VerdictKind.FAULT)
    assert check.value == pytest.approx(1.0, abs=0.15)


def test_which_body_moved_makes_no_difference_and_a_bend_of_the_first_shows_in_both() -> None:
    detector, step = Witness(Limits()), round(MINUTE * HZ)
    bend = rigid(rotation_from_vector(np.deg2rad([0.0, 1.2, 0.0])), np.zeros(3))
    for k, pose in enumerate(poses(readings(MINUTE + 1))):
        assert pose.matrix is not None
        turned = Pose(pose.stamp, k, pose.matrix @ bend, 0.1, PoseStatus.OK, witness=pose.witness)
        detector.pose(turned if k >= step else pose)
    assert {check.verdict for check in detector.checks()} == {VerdictKind.FAULT}
    assert of(detector, "witness-slide").value == pytest.approx(80 * np.deg2rad(1.2), abs=0.3)


def test_without_a_second_body_there_is_no_check_and_hidden_from_the_start_it_concludes_nothing() -> None:
    detector = Witness(Limits())
    assert not any(fed(detector, np.full((600, 6), np.nan)))
    assert detector.checks() == ()
    assert detector.relative_pose is None


def test_hidden_it_concludes_nothing_and_a_bend_made_meanwhile_is_named_when_it_is_seen_again() -> None:
    detector, changes = Witness(Limits()), readings(MINUTE + 10)
    away, back = round(MINUTE * HZ), round((MINUTE + 5) * HZ)
    changes[away:back] = np.nan
    changes[back:] += [0, 0, 0, 1.5, 0, 0]
    said = fed(detector, changes[:back])
    assert not any(said)
    assert {check.verdict for check in detector.checks()} == {VerdictKind.NOT_VERIFIED}
    assert np.isnan(of(detector, "witness-turn").value)
    assert fed(detector, changes[back:], first=back).index(True) <= 0.5 * HZ


def test_named_it_stays_named_while_the_second_body_is_hidden() -> None:
    detector, changes = Witness(Limits()), readings(MINUTE + 10)
    changes[round(MINUTE * HZ) :] += [2.0, 0, 0, 0, 0, 0]
    changes[round((MINUTE + 1) * HZ) :] = np.nan
    assert fed(detector, changes)[-1]


def test_an_outlier_of_a_few_readings_is_none() -> None:
    detector, changes = Witness(Limits()), readings(MINUTE)
    changes[3000:3007] += [20.0, 0, 0, 10.0, 0, 0]
    assert not any(fed(detector, changes))


def test_bent_back_it_is_gone_by_itself() -> None:
    detector, changes = Witness(Limits()), readings(MINUTE + 4)
    step = round(MINUTE * HZ)
    changes[step : step + 60] += [0, 1.5, 0, 0, 0, 0]
    said = fed(detector, changes)
    assert any(said)
    assert not said[-1]


def test_motion_that_shows_the_first_in_place_has_the_second_learned_anew() -> None:
    detector, changes = Witness(Limits()), readings(2 * MINUTE)
    step = round(MINUTE * HZ)
    changes[step:] += [0, 2.0, 0, 0, 0, 0]
    fed(detector, changes[: step + 60])
    now_ns = round((MINUTE + 1) * 1e9)
    observation = Observation(now_ns, IMAGE, repeated=False)
    assert [detector.see(observation), detector.see(observation)] == [True, False]
    before = round(MINUTE * 1e9)
    detector.on_verified(lambda fault: True, before)
    assert named(detector)
    detector.on_verified(lambda fault: fault is not Fault.ROTATION, now_ns)
    assert named(detector)
    detector.on_verified(lambda fault: True, now_ns)
    assert not named(detector)
    assert not any(fed(detector, changes[step + 60 :], first=step + 60))
    assert detector.relative_pose is not None
    assert detector.relative_pose[1, 3] == pytest.approx(RELATIVE_POSE[1, 3] + 2.0, abs=0.1)


def test_a_lie_that_is_kept_finds_a_bend_that_was_made_while_nobody_looked() -> None:
    detector = Witness(Limits(), moved(np.array([0, 0, 0, 3.0, 0, 0])))
    assert fed(detector, readings(5)).index(True) <= (LEARN_NS / 1e9 + 0.5) * HZ
    assert not any(fed(Witness(Limits(), RELATIVE_POSE), readings(20)))


def test_names_that_were_exchanged_are_named_against_a_kept_relative_pose() -> None:
    detector = Witness(Limits(), inverse(RELATIVE_POSE))
    assert fed(detector, readings(5))[-1]


def test_one_tool_under_two_names_is_no_second_body() -> None:
    detector = Witness(Limits())
    for k in range(600):
        matrix = hand(k / HZ)
        detector.pose(Pose(Stamp(round(k / HZ * 1e9), 0), k, matrix, 0.1, PoseStatus.OK, witness=matrix.copy()))
    assert detector.checks() == ()


def test_readings_that_were_stamped_wrongly_are_forgotten() -> None:
    detector = Witness(Limits())
    fed(detector, readings(1))
    detector.forget_poses(0)
    fed(detector, readings(1.5))
    assert np.isnan(of(detector, "witness-slide").value)
    fed(detector, readings(5), first=90)
    assert of(detector, "witness-slide").value < 0.5


@pytest.mark.parametrize("tracker", TRACKERS[:3])
@pytest.mark.parametrize(("at_s", "size_mm"), [(30, 1.4), (75, 0.75), (75, 0.3)])
def test_the_law_is_that_of_the_detector(tracker: Tracker, at_s: int, size_mm: float) -> None:
    changes = readings(90, tracker)
    changes[round(at_s * tracker.rate_hz) :] += [0, size_mm, 0, 0, 0, 0]
    found = session(changes, tracker.rate_hz, np.array([1.0, 1.0]))
    detector = Witness(Limits())
    said = fed(detector, changes, tracker.rate_hz)
    assert any(said) == found.named.any() == (size_mm > 0.5)
    if any(said):
        assert abs(found.ends[found.named.argmax()] - 1 - said.index(True)) <= tracker.rate_hz / 10
    else:
        assert detector.thresholds == pytest.approx(found.limits[-1], rel=0.05)


def test_delays_of_the_law_at_a_tenth_of_a_millimetre() -> None:
    assert np.quantile(delays_s(TRACKERS[0], np.array([1.0, 0, 0, 0, 0, 0])), 0.95) <= 0.5
