"""The window of the two paths: what is forgotten, what the calibration predicts."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from probewatch.appliance.core.path.steps import SensorSteps, picture_steps, predicted_path, products_and_slopes
from probewatch.appliance.core.path.window import PathWindow
from probewatch.drivers.rigid import rigid, rotation_from_vector
from tests.support.motions import TRUTH, planar_path, tilting_path
from tests.support.windows import filled, motion

X = rigid(TRUTH.rotation, TRUTH.offset_mm)


def test_the_window_forgets_by_time_and_a_part_of_it_shares_the_poses() -> None:
    window = PathWindow(TRUTH, span_ns=1_000_000_000)
    for index in range(90):
        window.add(motion(index / 30, index, np.zeros(2), 0.0))
    assert len(window) == 31
    assert window.span_ns == pytest.approx(1e9, abs=10)
    part = window.since(window.now_ns - 500_000_000)
    assert len(part) == 16
    assert part.poses is window.poses
    window.restart()
    assert (len(window), window.now_ns, window.span_ns) == (0, 0, 0)
    assert window.latency() is None
    assert window.samples(0.0).t_s.size == 0


def test_samples_follow_the_window_and_not_an_earlier_question() -> None:
    window = filled(planar_path, 2.0)
    before = window.samples(0.0)
    assert window.samples(0.0) is before
    window.add(motion(2.0, 60, np.ones(2), 0.0))
    assert window.samples(0.0).t_s.size == before.t_s.size + 1


def test_the_predicted_path_is_that_of_the_picture() -> None:
    """Against the centre's place in the tissue, for motion that stays in the plane."""
    pictures = planar_path(np.arange(0, 2, 1 / 30))
    path = predicted_path(pictures @ X, TRUTH)
    home = np.linalg.inv(pictures[0])
    centres = (home @ pictures)[:, :3, 3]
    np.testing.assert_allclose(path.T, centres, atol=1e-5)


def test_steps_are_those_of_x_b_x_inverse() -> None:
    poses = tilting_path(np.arange(0, 1, 0.2)) @ X
    moved, turned = picture_steps(TRUTH.rotation, TRUTH.offset_mm, SensorSteps.between(poses))
    for j in range(1, 5):
        A = X @ np.linalg.inv(poses[j]) @ poses[j - 1] @ np.linalg.inv(X)
        np.testing.assert_allclose(moved[:, j], A[:3, 3], atol=1e-12)
        np.testing.assert_allclose(turned[:, j], Rotation.from_matrix(A[:3, :3]).as_rotvec(), atol=1e-5)


def test_slopes_are_the_derivative_of_the_steps() -> None:
    steps = SensorSteps.between(tilting_path(np.arange(0, 1, 0.2)) @ X)
    slopes = products_and_slopes(TRUTH.rotation, TRUTH.offset_mm)
    for index, change in enumerate(np.eye(6) * 1e-6):
        before, after = (
            picture_steps(
                rotation_from_vector(s * change[:3]) @ TRUTH.rotation, TRUTH.offset_mm + s * change[3:], steps
            )
            for s in (-1, 1)
        )
        np.testing.assert_allclose(slopes[0][index] @ steps.moved, (after[0] - before[0]) / 2e-6, atol=1e-6)
        np.testing.assert_allclose(slopes[1][index] @ steps.turn, (after[1] - before[1]) / 2e-6, atol=1e-6)
