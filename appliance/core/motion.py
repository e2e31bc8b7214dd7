"""Implements the Motion Analyzer, which sorts each motion and has the Real-time Tracker change the keyframe.

It considers the picture, the tracker, and their disagreement, so that a wrong calibration cannot hide itself by
spoiling the sorting: what the tracker alone calls out-of-plane counts for nothing while the picture looks the same.
"""

from collections.abc import Sequence
from math import cos, sin

import numpy as np

from probewatch.appliance.core.registration.realtime_tracker import Tracked
from probewatch.appliance.types import Calibration, Motion, MotionKind, StampedPair
from probewatch.drivers.rigid import Array, inverse, vector_from_rotation
from probewatch.drivers.samples import Matrix4

_STILL_MM = 0.15
_TURN_RAD = np.deg2rad(0.7)
"""RMS displacement over the picture since its keyframe, mm, and turn, rad, up to which a motion is called still, or a
translation. They only name it; no estimate depends on them.
"""
_OUT_MM, _ALIKE = 0.25, 0.95
"""RMS displacement out of the plane, mm, above which, and correlation below which, a motion is called out-of-plane,
which keeps its keyframe for longer. Speckle correlates by .95 at 0.2 mm
(tests/appliance/core/registration/test_registration.py); with smaller changes, tracker noise would show.
"""
_FAST_PX = 40.0
"""Step between two pictures, px, beyond which a motion is too fast. Longer steps were not tried: 40 px are registered
within .05 px (tests/appliance/core/registration/test_registration.py). What is refused is lost to the solver.
"""
_SPECKLE_MM, _PLACES = (1.5, 0.45), 5
"""Lateral and axial displacement, mm, after which speckle has nothing in common with itself, three standard deviations
of the echo of the study's probe of 5 MHz; and the number of rows and of columns of places at which it is evaluated.
More asks for quicker hands; in the gesture every second picture has gone as far.
"""
_STAYS = 3
"""Largest number of the 25 places that may have stayed: those about which the picture turns. Not varied."""
_RENEW_CORRELATION, _RENEW_OUT_CORRELATION = 0.8, 0.7
"""Correlation with the keyframe below which it is renewed, in general and out of the plane. More renews it more often,
and each time adds the error of one registration to the path; less comes near to what the self-check of the Real-time
Tracker refuses. Not measured.
"""
_RENEW_OVERLAP = 0.85
_RENEW_PX = 60.0
"""Share of the keyframe in view, and displacement from it, px, at which it is renewed, for the same reasons: a leap of
70 px is still found (tests/appliance/core/registration/test_realtime_tracker.py).
"""


def predicted_motion(calibration: Calibration, first: Matrix4, second: Matrix4) -> tuple[Array, Array]:
    """Returns A = X B X⁻¹ with B = B_2⁻¹ B_1 (Eq. 1) as (t_a (3,) mm, rotation vector (3,) rad) in picture axes."""
    B = inverse(second) @ first
    R, t = calibration.rotation, calibration.offset_mm
    R_a = R @ B[:3, :3] @ R.T
    return R @ B[:3, 3] + t - R_a @ t, vector_from_rotation(R_a)


def plane_step(u_px: Array, alpha_rad: float, calibration: Calibration) -> Array:
    """Returns the step of the picture plane, (3,), lateral and axial mm and turn rad in the axes of the earlier
    picture, that corresponds to a step (u, α) of the tissue in the picture: the inverse of Eq. 3.
    """
    lateral, axial = calibration.polarity
    turn = -alpha_rad * lateral * axial
    c, s = cos(turn), sin(turn)
    x, y = -(u_px * calibration.scale_mm_per_px * calibration.polarity)
    return np.array([c * x - s * y, s * x + c * y, turn])


def sort_motion(tracked: Tracked, calibration: Calibration, keyframe_pose: Matrix4, pose: Matrix4) -> MotionKind:
    """Returns the kind of the motion between keyframe and picture. Poses: (4, 4) sensor → tracker, mm."""
    found = tracked.registration
    if found is None:
        return MotionKind.DECORRELATED
    if tracked.step is not None and np.hypot(*tracked.step[0]) > _FAST_PX:
        return MotionKind.TOO_FAST
    reach_mm = calibration.scale_mm_per_px * calibration.image_size_px / np.sqrt(12)
    turned_mm = found.alpha_rad * np.hypot(*reach_mm)
    seen_mm = float(np.linalg.norm([*(found.u_px * calibration.scale_mm_per_px), turned_mm]))
    hidden_mm = out_of_plane_mm(calibration, keyframe_pose, pose)
    if hidden_mm > max(_OUT_MM, seen_mm) and found.correlation < _ALIKE:
        return MotionKind.OUT_OF_PLANE
    if seen_mm < _STILL_MM:
        return MotionKind.STILL
    return MotionKind.PLANAR if abs(found.alpha_rad) > _TURN_RAD else MotionKind.TRANSLATION


def out_of_plane_mm(calibration: Calibration, first: Matrix4, second: Matrix4) -> float:
    """Returns how far the picture went out of its plane between two poses, (4, 4) sensor → tracker, as the root mean
    square over the picture, mm.
    """
    t_a, turn = predicted_motion(calibration, first, second)
    reach_mm = calibration.scale_mm_per_px * calibration.image_size_px / np.sqrt(12)
    return float(np.linalg.norm([t_a[2], turn[0] * reach_mm[1], turn[1] * reach_mm[0]]))


def quick(calibration: Calibration, poses: Sequence[Matrix4]) -> bool:
    """Returns whether tissue all over the picture moved by more than the length of its speckle, from the last but one
    of these poses to the last, and by as much per step from the first: one step alone may be a tracker's noise.
    """
    steps = len(poses) - 1
    return steps > 0 and all(
        _apart(calibration, first, poses[-1], times) for first, times in ((poses[0], steps), (poses[-2], 1))
    )


def _apart(calibration: Calibration, first: Matrix4, second: Matrix4, times: int) -> bool:
    t_a, turn = predicted_motion(calibration, first, second)
    reach_mm = calibration.scale_mm_per_px * calibration.image_size_px / 2
    places = np.linspace(-1, 1, _PLACES)
    lateral = (t_a[0] - turn[2] * reach_mm[1] * places) / _SPECKLE_MM[0]
    axial = (t_a[1] + turn[2] * reach_mm[0] * places) / _SPECKLE_MM[1]
    stays = np.add.outer(lateral**2, axial**2) < times**2
    return int(np.count_nonzero(stays)) <= _STAYS


def analyse(tracked: Tracked, pair: StampedPair, calibration: Calibration, keyframe_pose: Matrix4) -> Motion:
    """Sorts the motion of one picture. What broke the chain or outran the registration is kept from the solver."""
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
        tissue=tracked.tissue,
    )


def wants_keyframe(motion: Motion, overlap: float) -> bool:
    """Returns whether this picture should become the keyframe. The old one is kept while it serves: long steps suffer
    least from tracker noise (docs/method.md, section 3), so the step d grows until correlation, overlap or capture
    range end it.

    Out of the plane the picture shows no displacement that would be lost, and every change of keyframe adds its error
    to the path, so a lower correlation will do there.
    """
    out = motion.kind is MotionKind.OUT_OF_PLANE
    least = _RENEW_OUT_CORRELATION if out else _RENEW_CORRELATION
    reached = float(np.hypot(*motion.u_px)) > _RENEW_PX
    return motion.usable and (motion.correlation < least or overlap < _RENEW_OVERLAP or reached)
