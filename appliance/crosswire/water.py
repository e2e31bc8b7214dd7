"""Computes the speed of sound in the tank against the scanner's setting, and what it does to a calibration. Pure."""

from dataclasses import replace

import numpy as np

from probewatch.appliance.types import Calibration

SCANNER_M_S = 1540.0
"""Speed of sound, m/s, to which scanners are set for soft tissue."""
_MARCZAK = (1402.385, 5.038813, -5.799136e-2, 3.287156e-4, -1.398845e-6, 2.787860e-9)
"""Coefficients of Marczak, Water as a standard in the measurements of speed of sound in liquids, J. Acoust. Soc. Am.
102(5), 1997: m/s by powers of °C, pure water at atmospheric pressure, 0 to 95 °C, within 0.02 m/s."""
RANGE_C = (0.0, 95.0)
"""Temperatures, °C, for which it holds."""
LARGEST_ERROR = 0.015
"""Largest relative error: 0.6 mm at 4 cm of depth, as much as all the rest together. More bends depths, less calls for
thermostats."""


def speed_of_sound_m_s(water_c: float) -> float:
    """Returns the speed of sound in pure water at °C. Raises ValueError outside of 0 to 95 °C, NaN included."""
    if not RANGE_C[0] <= water_c <= RANGE_C[1]:
        raise ValueError(f"{water_c:g} °C is outside of {RANGE_C[0]:g} to {RANGE_C[1]:g} °C")
    return float(np.polynomial.polynomial.polyval(water_c, _MARCZAK))


def for_tissue(
    calibration: Calibration, water_m_s: float, scanner_m_s: float = SCANNER_M_S, face_row_px: float = 0.0
) -> Calibration:
    """Converts a calibration made in water, in which sound is too slow or too fast, to one for where sound travels at
    the speed that the scanner assumes.

    In the tank a pixel of depth was shorter by water_m_s ÷ scanner_m_s. The axial scale grows by the inverse, counted
    from the probe's face at face_row_px, so that the picture's centre, to which the offset refers, lies deeper. This
    holds for linear arrays: for a curved one the lateral scale would change with depth, too.
    """
    factor = scanner_m_s / water_m_s
    scale = calibration.scale_mm_per_px * np.array([1.0, factor])
    middle_px = (calibration.image_size_px[1] - 1) / 2 - face_row_px
    deeper_mm = (scale[1] - calibration.scale_mm_per_px[1]) * middle_px * calibration.polarity[1]
    return replace(
        calibration,
        scale_mm_per_px=scale,
        offset_mm=calibration.offset_mm - np.array([0.0, deeper_mm, 0.0]),
    )
