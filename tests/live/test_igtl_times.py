"""When a server's poses were true: the driver's stamps beside the clock of a simulated OpenIGTLink server."""

import numpy as np

from probewatch.drivers.registry import open_tracker
from probewatch.drivers.samples import PoseStatus
from tests.support.simulated_igtl import bench

RATE = 0.2
"""Seconds of the clock per second: leaves a busy host more time for the same milliseconds."""


def test_the_bound_of_the_stamps_holds() -> None:
    """Every pose tells by its place which measurement it was, and so when it was made."""
    with bench(RATE) as server, open_tracker(f"igtl://{server.target}", server.clock) as tracker:
        origin_ns, errors = server.clock.origin_ns, []
        places = np.array([server.world.measured_pose(n / 60, n)[:3, 3] for n in range(900)])
        for _ in range(1000):
            pose = tracker.read(1.0)
            if pose is None or pose.status is not PoseStatus.OK or pose.matrix is None:
                continue
            far_mm = np.linalg.norm(places - pose.matrix[:3, 3], axis=1)
            assert far_mm.min() < 1e-3
            true_ns = origin_ns + int(far_mm.argmin()) * 1e9 / 60
            errors.append((abs(pose.stamp.t_ns - true_ns), pose.stamp.err_ns))
            if len(errors) == 400:
                break
        assert len(errors) == 400
        held = sum(error_ns <= err_ns for error_ns, err_ns in errors) / len(errors)
        median_ms = np.median([error_ns for error_ns, _ in errors[200:]]) / 1e6
        print(f"bound holds for {held:.1%}; median error {median_ms:.2f} ms, bound {errors[-1][1] / 1e6:.2f} ms")
        assert held >= 0.99
