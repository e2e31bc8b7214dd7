"""Models what a piece of metal does to the poses of an electromagnetic tracker. It is pure.

Eddy currents in the metal make a field of their own, whose error falls off with the cube of the distance from the metal
to the sensor (Nixon, McCallum, Fright, Price: The Effects of Metals and Interfering Fields on Electromagnetic Trackers,
Presence 7(2), 1998). Here it pushes the pose away from the metal and tips it over in the same direction.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from probewatch.drivers.samples import Matrix4

PLACE_MM = (70.0, -60.0, 75.0)
"""Place of the metal relative to where the probe is when the metal comes; tracker frame."""
DISPLACED_MM = 6.0
"""Displacement at that distance, once the metal lies there: strong enough for motion to name it
(docs/known-anomalies.md, 3)."""
TIPPED_DEG_PER_MM = 0.4
"""Chosen for 2.4° at 6 mm; the source states no ratio of turn to push, and none was measured."""
COMES_IN_S, LEAVES_AT_S = 2.0, 30.0
"""Seconds in which the metal is pushed up to the probe, and when it is taken away again as slowly, so that no pose
leaps."""


def near_metal(pose: Matrix4, pose_before: Matrix4, since_s: float, displaced_mm: float = DISPLACED_MM) -> Matrix4:
    """Returns the pose that is measured since_s after the metal began to come. pose: (4, 4) true sensor → tracker, mm.

    pose_before: the true pose at that moment, from which the metal's place is counted.
    """
    share = float(np.clip(min(since_s, LEAVES_AT_S + COMES_IN_S - since_s) / COMES_IN_S, 0.0, 1.0))
    place_mm = np.array(PLACE_MM)
    from_metal_mm = pose[:3, 3] - (pose_before[:3, 3] + place_mm)
    distance_mm = float(np.linalg.norm(from_metal_mm))
    away = from_metal_mm / distance_mm
    push_mm = share**2 * (3 - 2 * share) * displaced_mm * (np.linalg.norm(place_mm) / distance_mm) ** 3
    axis = np.cross((0.0, 0.0, 1.0), away)
    measured = pose.copy()
    measured[:3, 3] += push_mm * away
    measured[:3, :3] = Rotation.from_rotvec(np.radians(TIPPED_DEG_PER_MM) * push_mm * axis).as_matrix() @ pose[:3, :3]
    return measured
