"""The simulated world against theory: speckle, motion, conventions, and that a seed decides everything."""

from collections.abc import Callable
from functools import cache

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.samples import Matrix4
from probewatch.drivers.twins.scene.trajectory import PROGRAMS, Trajectory
from probewatch.drivers.twins.scene.world import World, WorldSettings

SCALE_MM = np.array([0.08, 0.07])
CENTRE_PX = np.array([319.5, 239.5])


def pose(x_mm: float = 0, y_mm: float = 0, z_mm: float = 0, turn_deg: float = 0) -> Matrix4:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec([0, 0, np.radians(turn_deg)]).as_matrix()
    matrix[:3, 3] = x_mm, y_mm, z_mm
    return matrix


@cache
def speckle() -> World:
    return World(seed=5, scene="speckle", settings=WorldSettings(overlay=False))


def intensity(picture_pose: Matrix4) -> np.ndarray:
    real, imaginary = speckle().echoes_at(picture_pose)
    return real**2 + imaginary**2


def correlation(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])


def brought_back(image: np.ndarray, A: Matrix4) -> np.ndarray:
    """The later picture warped by the motion A of the tissue so that it lies over the earlier one."""
    linear = np.diag(1 / SCALE_MM) @ A[:2, :2] @ np.diag(SCALE_MM)
    shift = CENTRE_PX - linear @ CENTRE_PX + A[:2, 3] / SCALE_MM
    warp = np.column_stack([linear, shift])
    return cv2.warpAffine(image, warp, image.shape[::-1], flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)


MIDDLE = np.s_[100:380, 120:520]


def test_envelope_is_rayleigh_before_compression() -> None:
    ratios = []
    for step in range(10):
        envelope = np.sqrt(intensity(pose(z_mm=1.4 * step)))
        ratios.append(envelope.mean() / envelope.std())
    assert np.mean(ratios) == pytest.approx(1.91, abs=0.03)
    assert np.mean([intensity(pose(z_mm=0.3 * step)).mean() for step in range(5)]) == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize(
    ("apart_mm", "expected", "tolerance"), [(0.2, 0.96, 0.02), (0.5, 0.80, 0.04), (1.0, 0.42, 0.05)]
)
def test_speckle_decorrelates_with_elevation(apart_mm: float, expected: float, tolerance: float) -> None:
    starts_mm = np.linspace(0, 1.27, 7)[:-1]
    found = [correlation(intensity(pose(z_mm=z)), intensity(pose(z_mm=z + apart_mm))) for z in starts_mm]
    assert np.mean(found) == pytest.approx(expected, abs=tolerance)


@pytest.mark.parametrize(("turn_deg", "expected"), [(1, 0.92), (3, 0.56), (5, 0.21), (-3, 0.56)])
def test_speckle_decorrelates_with_in_plane_rotation(turn_deg: float, expected: float) -> None:
    later = pose(turn_deg=turn_deg)
    found = correlation(intensity(pose())[MIDDLE], brought_back(intensity(later), np.linalg.inv(later))[MIDDLE])
    assert found == pytest.approx(expected, abs=0.05)


@pytest.mark.parametrize("shift_px", [(0.5, 0), (0, 0.5), (1, 0), (0.25, 0.7), (7.3, 3.6), (13.5, -11.25), (20, 0)])
def test_translation_moves_the_speckle_rigidly(shift_px: tuple[float, float]) -> None:
    moved = pose(*(-SCALE_MM * shift_px))
    before, after = (np.sqrt(intensity(p)) for p in (pose(), moved))
    whole = np.round(shift_px).astype(int)
    shifted = np.roll(after, -whole[::-1], (0, 1))
    warp = np.eye(2, 3, dtype=np.float32)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-7)
    score, warp = cv2.findTransformECC(before[MIDDLE], shifted[MIDDLE], warp, cv2.MOTION_TRANSLATION, stop)
    assert score > 0.995
    np.testing.assert_allclose(warp[:, 2] + whole, shift_px, atol=0.02)


@pytest.mark.parametrize("instants_s", [(0.3, 0.5), (2.6, 2.8), (5.1, 5.4)])
def test_pictures_move_as_the_probe_poses_say(instants_s: tuple[float, float]) -> None:
    world = World(seed=2, settings=WorldSettings(overlay=False))
    first, second = (world.probe_pose(t_s) for t_s in instants_s)
    X = world.sensor_to_picture
    A = X @ np.linalg.inv(second) @ first @ np.linalg.inv(X)
    before, after = (world.frame(t_s, index) for index, t_s in enumerate(instants_s))
    assert np.linalg.norm(A[:2, 3]) > 0.5
    as_predicted = correlation(before[MIDDLE], brought_back(after, A)[MIDDLE])
    unmoved = correlation(before[MIDDLE], after[MIDDLE])
    mirrored = correlation(before[MIDDLE], brought_back(after, np.linalg.inv(A))[MIDDLE])
    assert as_predicted > 0.85
    assert as_predicted > max(unmoved, mirrored) + 0.3


def test_phase_correlation_sees_the_predicted_shift() -> None:
    world = World(seed=2, program="lateral", settings=WorldSettings(overlay=False))
    X = world.sensor_to_picture
    A = X @ np.linalg.inv(world.probe_pose(0.1)) @ world.probe_pose(0.0) @ np.linalg.inv(X)
    before, after = (world.frame(t_s, 0)[MIDDLE].astype(np.float32) for t_s in (0.0, 0.1))
    found_px, _ = cv2.phaseCorrelate(before, after, cv2.createHanningWindow(before.shape[::-1], cv2.CV_32F))
    np.testing.assert_allclose(found_px, A[:2, 3] / SCALE_MM, atol=0.1)


def test_image_to_probe_is_the_chain_of_the_convention() -> None:
    world = World()
    pixel = np.array([100.0, 50.0, 0, 1])
    in_picture = np.array([*((pixel[:2] - CENTRE_PX) * SCALE_MM), 0, 1])
    np.testing.assert_allclose(world.sensor_to_picture @ world.image_to_probe @ pixel, in_picture, atol=1e-9)
    assert np.linalg.det(world.sensor_to_picture[:3, :3]) == pytest.approx(1)


def test_measured_poses_scatter_as_the_settings_say() -> None:
    world = World()
    difference = np.array([world.measured_pose(1.0, index) for index in range(400)]) - world.probe_pose(1.0)
    assert difference[:, :3, 3].std(axis=0) == pytest.approx(0.1, rel=0.15)
    errors = [np.linalg.inv(world.probe_pose(1.0)) @ world.measured_pose(1.0, index) for index in range(400)]
    turns_deg = np.degrees(Rotation.from_matrix([error[:3, :3] for error in errors]).as_rotvec())
    assert turns_deg.std(axis=0) == pytest.approx(0.02, rel=0.15)


def test_a_seed_decides_everything() -> None:
    world = World(3)
    frames = [seen.frame(1.0, index) for seen, index in ((world, 7), (World(3), 7), (World(4), 7), (world, 8))]
    assert np.array_equal(frames[0], frames[1])
    assert correlation(frames[0][MIDDLE], frames[2][MIDDLE]) < 0.3
    assert not np.array_equal(frames[0], frames[3])
    assert correlation(frames[0][MIDDLE], frames[3][MIDDLE]) > 0.95
    assert np.array_equal(World(3).measured_pose(0.5, 9), World(3).measured_pose(0.5, 9))


def test_overlay_stays_where_it_is_when_the_picture_is_flipped() -> None:
    world = World(seed=2)
    plain, flipped = world.frame(1.0, 0), world.frame(1.0, 0, {"flip-lateral"})
    corner = np.s_[:80, :100]
    assert plain[corner].max() > 200
    assert np.array_equal(plain[corner], flipped[corner])
    assert correlation(plain[MIDDLE], flipped[:, ::-1][MIDDLE]) > 0.95


def test_the_ruler_alone_of_what_is_drawn_moves_with_the_depth() -> None:
    world = World(seed=2, settings=WorldSettings(depth_zoom=1.03))
    plain, deeper = world.frame(1.0, 0), world.frame(1.0, 0, {"depth"})
    ticks = [np.flatnonzero(image[:, -6] > 200) for image in (plain, deeper)]
    assert len(ticks[0]) == 7
    assert np.diff(ticks[1]).mean() / np.diff(ticks[0]).mean() == pytest.approx(1.03, abs=0.005)
    corner = np.s_[:80, :100]
    assert np.array_equal(plain[corner], deeper[corner])


def test_crossing_lights_up_where_the_truth_says() -> None:
    settings = WorldSettings(overlay=False)
    world = World(seed=1, program="freehand", scene="cross-wire", settings=settings)
    seen = 0
    for t_s in np.arange(0, 12, 0.01):
        to_picture = world.sensor_to_picture @ np.linalg.inv(world.probe_pose(t_s))
        crossing_mm = (to_picture @ [*world.crossing_mm, 1])[:3]
        if abs(crossing_mm[2]) > 0.02:
            continue
        amplitude, _ = world.echoes_at(world.trajectory.pose(t_s))
        row, column = np.unravel_index(np.argmax(amplitude), amplitude.shape)
        np.testing.assert_allclose((np.array([column, row]) - CENTRE_PX) * SCALE_MM, crossing_mm[:2], atol=0.12)
        seen += 1
    assert seen >= 5


def test_freehand_tilts_by_twenty_degrees_and_more() -> None:
    hand = Trajectory(1, "freehand")
    normals = np.array([hand.pose(t_s)[:3, 2] for t_s in np.arange(0, 30, 0.5)])
    assert np.degrees(np.ptp(np.arcsin(normals[:, :2]), axis=0)).min() > 20


@pytest.mark.parametrize("program", PROGRAMS)
def test_motion_is_smooth_to_the_second_derivative(program: str) -> None:
    step_s = 0.01
    hand = Trajectory(7, program)
    poses = np.array([hand.pose(t_s)[:3].ravel() for t_s in np.arange(0, 30, step_s)])
    accelerations = np.diff(poses, 2, axis=0) / step_s**2
    assert np.abs(np.diff(accelerations, axis=0)).max() < 100 * step_s


def test_sweep_is_what_a_healthy_scan_needs() -> None:
    step_s = 0.02
    for seed in range(1, 6):
        hand = Trajectory(seed, "sweep")
        poses = np.array([hand.pose(t_s) for t_s in np.arange(0, 26, step_s)])
        places_mm = -np.einsum("nji,nj->ni", poses[:, :3, :3], poses[:, :3, 3])
        speeds = np.diff(places_mm, axis=0) / step_s
        turns_deg = np.degrees(Rotation.from_matrix(poses[:, :3, :3]).as_rotvec())
        assert 10 < np.ptp(places_mm[:, 0]) < 20
        assert 7 < np.ptp(places_mm[:, 1]) < 20
        assert np.ptp(places_mm[:, 2]) <= 0.31
        assert 10 <= np.ptp(turns_deg[:, 2]) <= 16
        assert np.abs(turns_deg[:, :2]).max() < 2
        assert np.linalg.norm(speeds, axis=1).max() < 11
        assert np.linalg.norm(speeds[0]) > 1
        for axis in (0, 1):
            assert np.sum(np.diff(np.sign(speeds[:, axis])) != 0) >= 6
        still_s = step_s * np.sum(np.linalg.norm(speeds, axis=1) < 0.05)
        assert 1.5 < still_s < 4


@pytest.mark.parametrize(
    ("make", "names"),
    [
        (lambda: World(program="dance"), "dance"),
        (lambda: World(scene="moon"), "moon"),
        (lambda: WorldSettings(scale_mm_per_px=(0.22, 0.26)), "twice"),
    ],
)
def test_impossible_worlds_are_refused(make: Callable[[], object], names: str) -> None:
    with pytest.raises(ConfigurationError, match=names):
        make()
