"""Views of a cross-wire as a guided scan gives them, without pictures: known truth, seeded noise."""

import numpy as np
from scipy.spatial.transform import Rotation

from probewatch.appliance.crosswire.scan import View
from probewatch.appliance.crosswire.whole import WholeSolution
from probewatch.appliance.types import Calibration

SIZE_PX = (640, 480)
TRUE = Calibration(
    Rotation.from_rotvec([0.62, -0.41, 0.93]).as_matrix(),
    (1, 1),
    np.array([0.08, 0.07]),
    np.array([11.0, 62.0, 14.0]),
    SIZE_PX,
)
CROSSING_MM = np.array([64.0, -87.0, -1520.0])
_HAND = Rotation.from_rotvec([1.9, 0.7, -0.5])
_APART_S = 0.2


def guided_views(
    seed: int,
    number: int = 150,
    *,
    true: Calibration = TRUE,
    tilt_deg: tuple[float, float, float] = (12.0, 12.0, 12.0),
    reach_mm: tuple[float, float] = (16.0, 11.0),
    noise_mm: float = 0.1,
    noise_deg: float = 0.02,
    noise_px: float = 0.5,
    late_s: float = 0.0,
    one_way: bool = False,
) -> list[View]:
    """tilt_deg: standard deviations about the picture's axes. reach_mm: how far from its middle the crossing appears.

    Noise of the tracker is white per axis and of every pose; passages at 2 to 6 mm/s go to and fro unless one_way.
    """
    random = np.random.default_rng((seed, 5))

    def measured(turn: np.ndarray, in_picture: np.ndarray) -> np.ndarray:
        pose = np.eye(4)
        pose[:3, :3] = (_HAND * Rotation.from_rotvec(turn)).as_matrix() @ true.rotation
        pose[:3, 3] = CROSSING_MM - pose[:3, :3] @ true.rotation.T @ (in_picture - true.offset_mm)
        pose[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec(random.normal(0, np.radians(noise_deg), 3)).as_matrix()
        pose[:3, 3] += random.normal(0, noise_mm, 3)
        return pose

    views = []
    for index in range(number):
        place = random.uniform(-1, 1, 2) * reach_mm
        turn = np.radians(random.normal(0, tilt_deg))
        speed = random.uniform(2, 6) * (1 if one_way else random.choice([-1, 1]))
        poses = [measured(turn, np.array([*place, speed * (dt - late_s)])) for dt in (0, -_APART_S / 2, _APART_S / 2)]
        centre = place / (np.array(true.polarity) * true.scale_mm_per_px) + (np.array(true.image_size_px) - 1) / 2
        spot = np.eye(2) * max(noise_px, 0.01) ** 2
        views.append(View(index * 10**9, centre + random.normal(0, noise_px, 2), spot, *poses, _APART_S))
    return views


def errors(solution: WholeSolution, true: Calibration = TRUE) -> np.ndarray:
    """(8,) in the order and units of PARAMETERS."""
    found = solution.calibration
    return np.concatenate(
        [
            Rotation.from_matrix(found.rotation @ true.rotation.T).as_rotvec(),
            found.scale_mm_per_px / true.scale_mm_per_px - 1,
            found.offset_mm - true.offset_mm,
        ]
    )
