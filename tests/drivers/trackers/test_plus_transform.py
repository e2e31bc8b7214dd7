"""A matrix that is no pose is told by what it is."""

import numpy as np
import pytest

from probewatch.drivers.samples import PoseStatus
from probewatch.drivers.trackers.plus_transform import rigid_reading
from tests.support.recordings import turn

POSE = turn(0.3, 50.0, 20.0)


@pytest.mark.parametrize(
    ("matrix", "said"),
    [
        (POSE @ np.diag([0.08, 0.08, 0.08, 1]), "axes have lengths 0.08 0.08 0.08"),
        (POSE @ np.diag([0.08, 0.07, 1, 1]), "axes have lengths 0.08 0.07 1,"),
        (POSE @ np.diag([1, 1, -1, 1]), "left-handed"),
        (POSE @ np.array([[1, 0.2, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]), "sheared"),
        (POSE.T, "transposed"),
        (np.diag([1, 1, 1, 0.0]), "last row is not 0 0 0 1"),
        (np.diag([0, 1, 1, 1.0]), "an axis is zero"),
        (POSE + 3e6 * np.eye(4, k=3), "further away than any tool"),
        (np.full((4, 4), np.nan), "not finite"),
    ],
)
def test_it_is_not_understood_and_says_what_it_is(matrix, said):
    reading = rigid_reading(matrix, "ProbeToTracker")
    assert (reading.matrix, reading.status) == (None, PoseStatus.NOT_UNDERSTOOD)
    assert reading.reason.startswith("ProbeToTracker ")
    assert said in reading.reason


def test_a_pose_of_six_digits_is_one():
    assert rigid_reading(np.round(POSE, 6), "ProbeToTracker").status is PoseStatus.OK
