"""Computes how far a calibration may misplace points of the picture, by its own covariance. Pure."""

import numpy as np

from probewatch.appliance.types import PARAMETERS, Calibration
from probewatch.drivers.rigid import skew

_EIGHT = len(PARAMETERS)


def expected_error_mm(calibration: Calibration) -> float:
    """Returns the RMS distance, mm, by which the calibration's own covariance lets points of the picture be misplaced.

    Nine points count, from the centre to a quarter of the sides from the edges. Raises ValueError without covariance.
    """
    if calibration.covariance is None:
        raise ValueError("a calibration without covariance promises nothing")
    half = np.array(calibration.image_size_px) / 4
    signed = np.array(calibration.polarity) * calibration.scale_mm_per_px
    total = 0.0
    for place in [(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)]:
        in_picture = np.array([*(half * place * signed), 0.0])
        slope = np.zeros((3, _EIGHT))
        slope[:, :3] = -skew(in_picture - calibration.offset_mm)
        slope[0, 3], slope[1, 4] = -in_picture[0], -in_picture[1]
        slope[:, 5:8] = np.eye(3)
        total += float(np.trace(slope @ calibration.covariance @ slope.T)) / 9
    return float(np.sqrt(total))
