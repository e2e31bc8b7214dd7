"""Motion Analyzer: sorts each motion, and tells the Real-time Tracker when to change the keyframe.

It looks at the picture, at the tracker, and at their disagreement, so that a wrong calibration cannot hide itself by
spoiling the sorting: what the tracker alone calls out-of-plane while the picture still matches stays in the evidence.
"""

import numpy as np

from appliance.core.geometry import inverse, vector_from_rotation
from appliance.core.realtime_tracker import Tracked
from appliance.core.registration import Array
from appliance.types import Calibration, Motion, MotionKind, StampedPair
from drivers.samples import Matrix4

_STILL_MM, _STILL_RAD = 0.15, np.deg2rad(0.15)
_TURN_RAD = np.deg2rad(0.7)
_OUT_MM, _OUT_RAD = 0.6, np.deg2rad(1.5)
_FAST_PX = 40.0
_RENEW_CORRELATION = 0.8
_RENEW_OVERLAP = 0.85
_RENEW_PX = 60.0


def predicted_motion(calibration: Calibration, first: Matrix4, second: Matrix4) -> tuple[Array, Array]:
    """A = X B X⁻¹ with B = B_2⁻¹ B_1: (t_a (3,) mm, rotation vector (3,) rad) in picture axes (Eq. 1)."""
    B = inverse(second) @ first
    R, t = calibration.rotation, calibration.offset_mm
    R_a = R @ B[:3, :3] @ R.T
    return R @ B[:3, 3] + t - R_a @ t, vector_from_rotation(R_a)


def sort_motion(tracked: Tracked, calibration: Calibration, keyframe_pose: Matrix4, pose: Matrix4) -> MotionKind:
    """Kind of the motion between keyframe and picture. Poses: (4, 4) sensor → tracker, mm."""
    found = tracked.registration
    if found is None:
        return MotionKind.DECORRELATED
    if tracked.step is not None and np.hypot(*tracked.step[0]) > _FAST_PX:
        return MotionKind.TOO_FAST
    t_a, turn = predicted_motion(calibration, keyframe_pose, pose)
    seen_mm = float(np.hypot(*(found.u_px * calibration.scale_mm_per_px)))
    tracker_out = abs(t_a[2]) > _OUT_MM or float(np.hypot(*turn[:2])) > _OUT_RAD
    if tracker_out and found.correlation < _RENEW_CORRELATION:
        return MotionKind.OUT_OF_PLANE
    if seen_mm < _STILL_MM and abs(found.alpha_rad) < _STILL_RAD and np.linalg.norm(t_a) < 2 * _STILL_MM:
        return MotionKind.STILL
    if tracker_out:
        return MotionKind.OUT_OF_PLANE
    return MotionKind.PLANAR if abs(found.alpha_rad) > _TURN_RAD else MotionKind.TRANSLATION


def analyse(tracked: Tracked, pair: StampedPair, calibration: Calibration, keyframe_pose: Matrix4) -> Motion:
    """Sort the motion of one picture. What broke the chain or outran the registration is kept from the solver."""
    kind = sort_motion(tracked, calibration, keyframe_pose, pair.matrix)
    found = tracked.registration
    usable = found is not None and kind is not MotionKind.TOO_FAST
    return Motion(
        stamp=pair.stamp,
        sequence=pair.frame.sequence,
        keyframe=tracked.keyframe,
        kind=kind,
        u_px=np.zeros(2) if found is None else found.u_px,
        alpha_rad=0.0 if found is None else found.alpha_rad,
        covariance=np.full((3, 3), np.inf) if found is None else found.covariance,
        correlation=0.0 if found is None else found.correlation,
        chain=tracked.chain,
        path_px=tracked.path[0],
        path_rad=tracked.path[1],
        usable=usable,
        reason="" if usable else tracked.reason or kind.value,
    )


def wants_keyframe(motion: Motion, overlap: float) -> bool:
    """Whether this picture should become the keyframe. The old one stays while it serves: long steps drown least in
    tracker noise (mathematics, section 3), so the step d grows until likeness, overlap or capture range end it."""
    return motion.usable and (
        motion.correlation < _RENEW_CORRELATION or overlap < _RENEW_OVERLAP or float(np.hypot(*motion.u_px)) > _RENEW_PX
    )
