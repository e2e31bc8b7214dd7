"""Rotation vectors, inverses and interpolation, against SciPy and against their own definitions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from probewatch.drivers.rigid import (
    angle_from_rotation,
    interpolate,
    inverse,
    nearest_rotation,
    pose_matrix,
    quaternion_from_rotation,
    rigid,
    rotation_from_quaternion,
    rotation_from_vector,
    skew,
    vector_from_rotation,
)

coordinate = st.floats(-1, 1)
axes = (
    st.tuples(coordinate, coordinate, coordinate)
    .filter(lambda v: np.linalg.norm(v) > 0.01)
    .map(lambda v: np.array(v) / np.linalg.norm(v))
)
angles_rad = st.one_of(
    st.floats(0, np.pi - 1e-6),
    st.floats(-15, -1).map(lambda exponent: 10.0**exponent),
    st.floats(-6, -1).map(lambda exponent: np.pi - 10.0**exponent),
)
places_mm = st.tuples(*[st.floats(-2000, 2000)] * 3).map(np.array)
rotations = st.builds(lambda axis, angle: rotation_from_vector(axis * angle), axes, angles_rad)
poses = st.builds(rigid, rotations, places_mm)


@given(axes, angles_rad)
def test_a_rotation_vector_comes_back(axis: np.ndarray, angle_rad: float) -> None:
    found = vector_from_rotation(rotation_from_vector(axis * angle_rad))
    np.testing.assert_allclose(found, axis * angle_rad, rtol=0, atol=1e-9)


@given(axes)
def test_half_a_turn_comes_back_as_the_same_rotation(axis: np.ndarray) -> None:
    """At π the vector's sign is free, the rotation is not."""
    R = rotation_from_vector(axis * np.pi)
    found = vector_from_rotation(R)
    assert np.linalg.norm(found) == pytest.approx(np.pi, abs=1e-7)
    np.testing.assert_allclose(rotation_from_vector(found), R, atol=1e-7)


@given(axes, st.floats(-15, -6))
def test_small_turns_keep_their_leading_digits(axis: np.ndarray, exponent: float) -> None:
    turn = axis * 10.0**exponent
    np.testing.assert_allclose(rotation_from_vector(turn) - np.eye(3), skew(turn), atol=float(turn @ turn))
    np.testing.assert_allclose(vector_from_rotation(rotation_from_vector(turn)), turn, atol=2e-15)


def test_no_turn_is_the_identity_exactly() -> None:
    np.testing.assert_array_equal(rotation_from_vector(np.zeros(3)), np.eye(3))
    np.testing.assert_allclose(vector_from_rotation(np.eye(3)), 0, atol=1e-15)


@given(axes, angles_rad)
def test_rodrigues_agrees_with_scipy(axis: np.ndarray, angle_rad: float) -> None:
    expected = Rotation.from_rotvec(axis * angle_rad)
    np.testing.assert_allclose(rotation_from_vector(axis * angle_rad), expected.as_matrix(), atol=1e-12)
    w, *xyz = quaternion_from_rotation(expected.as_matrix())
    assert w >= 0
    np.testing.assert_allclose(np.abs([*xyz, w] @ expected.as_quat()), 1, atol=1e-12)


def test_stacks_are_taken_one_by_one() -> None:
    turns = np.random.default_rng(1).uniform(-1, 1, (4, 5, 3))
    R = rotation_from_vector(turns)
    assert R.shape == (4, 5, 3, 3)
    np.testing.assert_allclose(R[2, 3], rotation_from_vector(turns[2, 3]), atol=1e-15)
    np.testing.assert_allclose(vector_from_rotation(R), turns, atol=1e-12)


@given(poses)
def test_a_pose_and_its_inverse_cancel(pose: np.ndarray) -> None:
    np.testing.assert_allclose(inverse(pose) @ pose, np.eye(4), atol=1e-9)
    np.testing.assert_allclose(inverse(np.stack([pose, np.eye(4)]))[0], inverse(pose), atol=1e-12)


@given(rotations, st.floats(0, 1e-3), st.integers(0, 2**16))
def test_the_nearest_rotation_undoes_rounding(R: np.ndarray, rounding: float, seed: int) -> None:
    found = nearest_rotation(R + np.random.default_rng(seed).uniform(-rounding, rounding, (3, 3)))
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(found) == pytest.approx(1)
    assert np.linalg.norm(found - R) <= 3 * rounding + 1e-12


def test_the_nearest_rotation_to_a_mirror_is_proper() -> None:
    assert np.linalg.det(nearest_rotation(np.diag([1.0, 1.0, -1.0]))) == pytest.approx(1)


@given(poses, poses)
def test_interpolation_starts_and_ends_at_its_poses(first: np.ndarray, second: np.ndarray) -> None:
    np.testing.assert_allclose(interpolate(first, second, 0.0), first, atol=1e-7)
    np.testing.assert_allclose(interpolate(first, second, 1.0), second, atol=1e-7)


@given(poses, axes, st.floats(0, 3.1), places_mm, st.floats(0, 1))
def test_interpolation_turns_and_moves_evenly(
    first: np.ndarray, axis: np.ndarray, angle_rad: float, way_mm: np.ndarray, fraction: float
) -> None:
    second = rigid(first[:3, :3] @ rotation_from_vector(axis * angle_rad), first[:3, 3] + way_mm)
    found = interpolate(first, second, fraction)
    turn = vector_from_rotation(first[:3, :3].T @ found[:3, :3])
    np.testing.assert_allclose(turn, fraction * axis * angle_rad, atol=1e-8)
    np.testing.assert_allclose(found[:3, 3] - first[:3, 3], fraction * way_mm, atol=1e-9)


@pytest.mark.parametrize("angle_rad", [0.0, 1e-9, 1e-4, 0.3, np.pi / 2, 3.0, np.pi - 1e-7, np.pi])
def test_the_angle_of_a_rotation(angle_rad: float) -> None:
    axis = np.array([0.36, -0.48, 0.8])
    assert angle_from_rotation(rotation_from_vector(angle_rad * axis)) == pytest.approx(angle_rad, abs=1e-14)


@given(axes, angles_rad)
def test_quaternions_become_rotations_one_by_one_and_in_stacks(axis: np.ndarray, angle_rad: float) -> None:
    expected = Rotation.from_rotvec(axis * angle_rad).as_matrix()
    q = quaternion_from_rotation(expected)
    np.testing.assert_allclose(rotation_from_quaternion(np.stack([q, -q])), np.stack([expected] * 2), atol=1e-12)
    pose = pose_matrix((2 * q[0], 2 * q[1], 2 * q[2], 2 * q[3]), (1.0, 2.0, 3.0))
    np.testing.assert_allclose(pose, rigid(expected, np.array([1.0, 2.0, 3.0])), atol=1e-12)
