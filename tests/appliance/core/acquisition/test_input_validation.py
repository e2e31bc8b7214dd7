"""At the door of the line: what no device should deliver gives a reason, not an exception, and is never verified."""

from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.acquisition.input_validation import FURTHEST_MM, checked_pose, refused_picture
from probewatch.appliance.core.line import Line
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration, Verdict, VerdictKind
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp
from probewatch.drivers.trackers import pose_bounds
from probewatch.drivers.twins.scene.world import World
from tests.appliance.core.test_line import truth
from tests.support.rendered import SMALL

HEALTHY = World(1, settings=SMALL)


def verdicts(pictures: list[np.ndarray], poses: list[np.ndarray] | None = None) -> tuple[Line, list[Verdict]]:
    """What the line says of pictures of any kind, each bracketed by two poses."""
    height, width = pictures[0].shape[:2]
    reference: Calibration = replace(truth(HEALTHY), image_size_px=(width, height))
    line, found = Line(reference, Limits()), []
    for k, picture in enumerate(pictures):
        t_ns = round(1e9 + k * 1e9 / 30)
        matrix = HEALTHY.probe_pose(k / 30) if poses is None else poses[k]
        found += line.step(Frame(Stamp(t_ns, 0), k, picture))
        found += line.step(Pose(Stamp(t_ns + 5_000_000, 0), k, matrix, 0.1, PoseStatus.OK))
    return line, found


def noisy(shape: tuple[int, ...], dtype: type) -> list[np.ndarray]:
    random = np.random.default_rng(0)
    return [random.integers(0, 250, shape).astype(dtype) for _ in range(12)]


@pytest.mark.parametrize(
    ("pictures", "reason"),
    [
        (noisy((240, 320, 3), np.uint8), "convert colour to grey"),
        (noisy((240, 320), np.uint16), "uint16 grey values, not 8 bits"),
        (noisy((240, 320), np.float32), "float32 grey values, not 8 bits"),
    ],
    ids=["colour", "16-bit", "float"],
)
def test_pictures_of_another_kind_are_refused_with_what_to_do(pictures: list[np.ndarray], reason: str) -> None:
    _, found = verdicts(pictures)
    assert len(found) >= 10
    assert all(v.kind is VerdictKind.NOT_VERIFIED and reason in v.reason for v in found)


@pytest.mark.parametrize("shape", [(1, 1), (1, 320), (240, 1), (2, 2), (17, 9)], ids=str)
def test_a_region_of_hardly_a_pixel_gives_a_reason(shape: tuple[int, int]) -> None:
    _, found = verdicts(noisy(shape, np.uint8))
    assert len(found) >= 10
    assert all(v.kind is VerdictKind.NOT_VERIFIED and v.reason for v in found)


def test_two_identical_pictures_show_no_motion_and_no_fault() -> None:
    image = HEALTHY.frame(0.0, 0)
    _, found = verdicts([image, image.copy(), HEALTHY.frame(1 / 15, 2)])
    assert {v.kind for v in found} == {VerdictKind.NOT_VERIFIED}


@pytest.mark.parametrize(
    ("spoilt", "reason"),
    [
        (np.full((4, 4), np.nan), "not finite"),
        (np.diag([np.inf, 1, 1, 1]), "not finite"),
        (np.zeros((4, 4)), "not a rigid transform"),
        (np.diag([1.0, 1, -1, 1]), "not a rigid transform"),
        (np.diag([2.0, 2, 2, 1]), "not a rigid transform"),
        (np.eye(4) + np.outer([0, 0, 0, 1], [3.0, 4, 5, 0]), "not a rigid transform"),
        (np.eye(4) + np.outer([1e155, 0, 0, 0], [0, 0, 0, 1]), "further away than any tool"),
        (np.eye(3), "of shape (3, 3)"),
    ],
    ids=["nan", "inf", "zeros", "mirror", "scaled", "transposed", "far", "3x3"],
)
def test_poses_that_are_no_rigid_transform_are_faults_of_the_tracker(spoilt: np.ndarray, reason: str) -> None:
    pose = checked_pose(Pose(Stamp(0, 0), 1, spoilt, 0.1, PoseStatus.OK))
    assert (pose.matrix, pose.status) == (None, PoseStatus.NOT_UNDERSTOOD)
    assert reason in pose.reason
    pictures = [HEALTHY.frame(k / 30, k) for k in range(4)]
    line, found = verdicts(pictures, [spoilt] * 4)
    assert line.report().paired == 0
    assert not any(v.kind is VerdictKind.OK for v in found)


def test_the_line_takes_no_pose_that_drivers_refuse_as_too_far() -> None:
    assert FURTHEST_MM == pose_bounds.FURTHEST_MM


def test_a_second_body_without_a_rigid_pose_is_left_out_and_the_first_stays() -> None:
    matrix = HEALTHY.measured_pose(0.3, 1)
    spoilt = checked_pose(Pose(Stamp(0, 0), 1, matrix, 0.1, PoseStatus.OK, witness=np.zeros((4, 4))))
    assert (spoilt.matrix is matrix, spoilt.witness, spoilt.status) == (True, None, PoseStatus.OK)
    whole = Pose(Stamp(0, 0), 1, matrix, 0.1, PoseStatus.OK, witness=matrix)
    assert checked_pose(whole) is whole


def test_what_is_right_passes() -> None:
    pose = Pose(Stamp(0, 0), 1, HEALTHY.measured_pose(0.3, 1), 0.1, PoseStatus.OK)
    assert checked_pose(pose) is pose
    assert refused_picture(HEALTHY.frame(0.0, 0)) == ""
    assert refused_picture(np.zeros((0, 5), np.uint8)) == "the picture is empty"
