"""When an NDI tracker's poses were true: the driver's stamps beside the clock of a simulated Polaris, in real time."""

from itertools import pairwise
from pathlib import Path

import numpy as np

from probewatch.drivers.samples import PoseStatus
from tests.support.simulated_ndi import bench, poses


def test_stamps_are_within_their_bounds(tmp_path: Path) -> None:
    with bench(tmp_path, rate=1.0) as cart, cart.open() as tracker:
        found = poses(tracker, 90)
        assert {pose.status for pose in found} == {PoseStatus.OK}
        assert [b.sequence - a.sequence for a, b in pairwise(found)].count(1) >= 60
        errors_ns = np.array(
            [abs(p.stamp.t_ns - cart.clock.origin_ns - cart.twin.device.frame_s(p.sequence) * 1e9) for p in found]
        )
        assert np.median(errors_ns[60:]) < 2e6
        assert np.mean(errors_ns <= [pose.stamp.err_ns for pose in found]) >= 0.95
