"""A window of registered pictures and poses, as the line fills it, from a path whose truth is known."""

from collections.abc import Callable

import numpy as np

from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.types import Calibration, Motion, MotionKind
from probewatch.drivers.rigid import Array, rigid, rotation_from_vector
from probewatch.drivers.samples import Stamp
from tests.support.motions import TRUTH, picture_path

ORIGIN_NS = 7_000_000_000
FPS, POSE_HZ = 30.0, 60.0
BEFORE_S = 0.5
"""For which there are poses before the first picture."""


def motion(t_s: float, index: int, path_px: Array, path_rad: float, chain: int = 1) -> Motion:
    """As the Motion Analyzer hands it on; only the path counts for the window."""
    return Motion(
        Stamp(ORIGIN_NS + round(t_s * 1e9), 0),
        index,
        0,
        MotionKind.PLANAR,
        np.zeros(2),
        0.0,
        np.eye(3) * 1e-4,
        0.95,
        chain,
        path_px,
        path_rad,
        True,
    )


def filled(
    path: Callable[[Array], Array],
    seconds: float,
    seed: int = 0,
    *,
    truth: Calibration = TRUTH,
    reference: Calibration = TRUTH,
    late_s: float = 0.0,
    position_mm: float = 0.1,
    angle_deg: float = 0.02,
    picture_px: float = 0.02,
    field: Callable[[Array], Array] = lambda poses: poses,
) -> PathWindow:
    """path: (n,) s → (n, 4, 4) picture → tissue. late_s: poses are stamped so much later than they were. field: what it
    makes of the poses, but for their noise.
    """
    random = np.random.default_rng(seed)
    window = PathWindow(reference)
    X = rigid(truth.rotation, truth.offset_mm)
    pose_t = np.arange(-BEFORE_S, seconds + 0.5, 1 / POSE_HZ)
    poses = field(path(pose_t) @ X)
    poses = poses @ rigid(
        rotation_from_vector(random.normal(0, np.deg2rad(angle_deg), (len(poses), 3))), np.zeros((len(poses), 3))
    )
    poses[:, :3, 3] += random.normal(0, position_mm, (len(poses), 3))
    for t, pose in zip(pose_t, poses, strict=True):
        window.poses.add(ORIGIN_NS + round((t + late_s) * 1e9), pose)
    frame_t = np.arange(0, seconds, 1 / FPS)
    u_px, alpha = picture_path(truth, path(frame_t))
    u_px += random.normal(0, picture_px, u_px.shape)
    for index, t in enumerate(frame_t):
        window.add(motion(t, index, u_px[index], alpha[index]))
    return window


def elevational_path(t_s: Array) -> Array:
    """(n,) → (n, 4, 4): 4 mm to and fro out of the plane, nothing in it."""
    place = np.stack([0 * t_s, 0 * t_s, 4 * np.sin(1.5 * t_s)], axis=1)
    return rigid(np.tile(np.eye(3), (len(t_s), 1, 1)), place)
