"""What explains a motion that the reference does not: far lags and conventions by name, and silence where two would."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.path.conventions import Convention
from probewatch.appliance.core.path.explanation import Explanation, explain, recent_lag
from probewatch.appliance.core.path.pose_track import PoseTrack
from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.spread_work import run_to_end
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array, inverse, quaternion_from_rotation, rigid, rotation_from_quaternion
from tests.support.motions import TRUTH, planar_path, tilting_path
from tests.support.windows import elevational_path, filled


def explained(window: PathWindow, reference: Calibration) -> Explanation | None:
    return run_to_end(explain(window, reference))


def tremor_path(t_s: Array) -> Array:
    """A hand that holds still: .3 mm and .3° of no period."""
    wobble = np.zeros((t_s.size, 3))
    for hz, phase in ((0.7, 0.3), (1.3, 2.0), (2.9, 1.0), (5.3, 0.5)):
        wobble += np.sin(2 * np.pi * hz * t_s[:, None] + phase + np.array([0.0, 2.0, 4.0])) / hz**0.5
    return tilting_path(0 * t_s) @ rigid(rigid_turn(0.003 * wobble), 0.3 * wobble)


def rigid_turn(vectors: Array) -> Array:
    half = np.linalg.norm(vectors, axis=1, keepdims=True) / 2
    return rotation_from_quaternion(np.hstack([np.cos(half), vectors / 2 * np.sinc(half / np.pi)]))


def reported(window: PathWindow, as_told: Callable[[Array], Array]) -> PathWindow:
    """The window with the poses as a tracker of another convention tells them."""
    times_ns, positions, turns = window.poses._times_ns, window.poses._positions, window.poses._turns
    if not times_ns.size:
        window.poses.arrays(0)
        return reported(window, as_told)
    poses = as_told(rigid(rotation_from_quaternion(turns), positions))
    window.poses.clear()
    for t_ns, pose in zip(times_ns, poses, strict=True):
        window.poses.add(int(t_ns), pose)
    return window


def from_the_start(path: Callable[[Array], Array], seconds: float, late_s: float) -> PathWindow:
    """Poses of the time of the pictures alone."""
    window = filled(path, seconds, 1, late_s=late_s)
    poses, window.poses = window.poses, PoseTrack(10_000_000_000)
    times_s, positions, turns = poses.arrays(0)
    for t_s, matrix in zip(times_s, rigid(rotation_from_quaternion(turns), positions), strict=True):
        if window.start_ns <= t_s * 1e9 <= window.now_ns:
            window.poses.add(round(t_s * 1e9), matrix)
    return window


def reordered(poses: Array) -> Array:
    quaternions = np.roll(quaternion_from_rotation(poses[:, :3, :3]), 1, axis=1)
    return rigid(rotation_from_quaternion(quaternions), poses[:, :3, 3])


SWAP = np.array([[0.0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]])
MIRROR = np.diag([-1.0, 1, 1, 1])


@pytest.mark.parametrize("late_s", [-0.95, -0.4, 0.0, 0.12, 0.45, 0.95])
@pytest.mark.parametrize("path", [tilting_path, tremor_path])
def test_a_lag_up_to_a_second_is_found(path, late_s: float) -> None:  # type: ignore[no-untyped-def]
    found = explained(filled(path, 6.0, 1, late_s=late_s), TRUTH)
    assert found is not None
    assert found.convention is Convention.AGREED
    assert found.latency_s == pytest.approx(late_s, abs=0.01)


@pytest.mark.parametrize("late_s", [-0.4, -0.12, 0.0, 0.12, 0.4])
def test_a_second_and_a_half_and_the_lag_suffice(late_s: float) -> None:
    """From the start: what lies beyond the poses that are known is not waited for."""
    found = explained(from_the_start(tilting_path, 1.6 + abs(late_s), late_s), TRUTH)
    assert found is not None
    assert found.convention is Convention.AGREED
    assert found.latency_s == pytest.approx(late_s, abs=0.01)


def test_a_lag_beyond_what_is_named_gives_none() -> None:
    assert explained(filled(tilting_path, 6.0, 1, late_s=1.1), TRUTH) is None


@pytest.mark.parametrize(
    ("as_told", "convention"),
    [
        (inverse, Convention.INVERTED),
        (lambda poses: poses @ SWAP, Convention.SWAPPED),
        (lambda poses: MIRROR @ poses @ MIRROR, Convention.MIRRORED),
        (lambda poses: rigid(np.swapaxes(poses[:, :3, :3], 1, 2), poses[:, :3, 3]), Convention.TURNED_BACK),
        (reordered, Convention.REORDERED),
    ],
)
def test_each_convention_is_found_by_its_name(as_told: Callable[[Array], Array], convention: Convention) -> None:
    found = explained(reported(filled(tremor_path, 6.0, 2), as_told), TRUTH)
    assert found is not None
    assert found.convention is convention
    assert abs(found.latency_s) < 0.02


@pytest.mark.parametrize("polarity", [(-1, 1), (1, -1), (-1, -1)])
def test_a_flipped_picture_is_no_convention_of_the_tracker(polarity: tuple[int, int]) -> None:
    truth = replace(TRUTH, polarity=polarity)
    found = explained(filled(tilting_path, 6.0, 3, truth=truth), TRUTH)
    assert found is None or found.convention is Convention.FLIPPED


def periodic(t_s: Array) -> Array:
    """A machine's circle: the same again after .7 s."""
    turn = 2 * np.pi * t_s[:, None] / 0.7
    place = np.hstack([4 * np.sin(turn), 3 * np.cos(turn), 0 * turn])
    return rigid(rigid_turn(np.hstack([0 * turn, 0 * turn, 0.05 * np.sin(turn + 1)])), place)


@pytest.mark.parametrize("late_s", [0.0, 0.3])
def test_where_the_next_round_explains_as_much_nothing_is_said(late_s: float) -> None:
    assert explained(filled(periodic, 6.0, 4, late_s=late_s), TRUTH) is None


def steady(t_s: Array) -> Array:
    """10 mm/s along one line: any lag explains it as well as any other."""
    return rigid(np.tile(np.eye(3), (t_s.size, 1, 1)), np.stack([10 * t_s, 0 * t_s, 0 * t_s], axis=1))


@pytest.mark.parametrize("path", [steady, elevational_path, lambda t_s: planar_path(0 * t_s)])
def test_motion_that_shows_nothing_gives_none(path) -> None:  # type: ignore[no-untyped-def]
    assert explained(filled(path, 6.0, 5), TRUTH) is None


@pytest.mark.parametrize("seconds", [0.01, 0.05, 0.5, 0.75])
def test_too_little_gives_none(seconds: float) -> None:
    assert explained(filled(tilting_path, seconds, 6), TRUTH) is None


def test_no_poses_give_none() -> None:
    window = filled(tilting_path, 6.0, 7)
    window.poses.clear()
    assert explained(window, TRUTH) is None
    assert explained(PathWindow(TRUTH), TRUTH) is None


def test_motion_that_has_nothing_to_do_with_the_poses_is_not_explained() -> None:
    window, other = filled(tilting_path, 6.0, 8), filled(lambda t_s: tremor_path(1.3 * t_s + 5), 6.0, 9)
    window.poses = other.poses
    assert explained(window, TRUTH) is None


@pytest.mark.parametrize("late_s", [0.1, -0.3])
def test_a_lag_of_the_latest_motion_is_found_with_the_time_since_which_it_explains_it(late_s: float) -> None:
    window = filled(tilting_path, 3.0, 2, late_s=late_s)
    found = run_to_end(recent_lag(window, TRUTH, 0.08))
    assert found is not None
    since_ns, explanation = found
    assert explanation.latency_s == pytest.approx(late_s, abs=0.02)
    assert 1.0 < (window.now_ns - since_ns) / 1e9 <= 2.0


@pytest.mark.parametrize(
    ("path", "seconds", "late_s"),
    [(tilting_path, 3.0, 0.0), (tilting_path, 3.0, 0.06), (tilting_path, 0.8, 0.3), (elevational_path, 3.0, 0.3)],
)
def test_no_lag_is_found_where_a_lesser_one_explains_the_motion_or_there_is_too_little(
    path: Callable[[Array], Array], seconds: float, late_s: float
) -> None:
    assert run_to_end(recent_lag(filled(path, seconds, 2, late_s=late_s), TRUTH, 0.08)) is None
