"""Implements the guided steps of a live recalibration beside the scan itself: water, latency, and the check at another
point, which closes it.

Not safe for two threads at once; the session has the lock.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from probewatch.appliance.core.path.latency import Latency
from probewatch.appliance.crosswire.checkpoint import LEAST_VIEWS, PASS_MM, PointCheck, check_point
from probewatch.appliance.crosswire.latency import BottomLine
from probewatch.appliance.crosswire.scan import CrosswireScan
from probewatch.appliance.crosswire.water import LARGEST_ERROR, RANGE_C, SCANNER_M_S, for_tissue, speed_of_sound_m_s
from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.types import Calibration, Vector
from probewatch.drivers.samples import Frame, Pose
from probewatch.tools.shared.crosswire_review import difference_in_sigmas
from probewatch.tools.shared.stated_change import stated_change

SETTINGS_M_S = (1400.0, 1700.0)
"""Range of a scanner's speed of sound, m/s, that `probewatch recalibrate --scanner-m-s` takes."""
_ELSEWHERE_MM = 10.0
"""Distance from the crossing of the scan, mm, at which a point counts as another one: what a wrong scale or rotation
misplaces grows with that distance, and 5 % of it are then half of what passes. Less checks the scan against itself. Not
varied.
"""
MOST_PICTURES = 1800
"""Pictures of the latency's line: a minute at 30 Hz. More takes memory and the time of a solution, .1 s a thousand."""


class Sound:
    """Computes what the water does to depths. water_c: None where nobody has measured it, as with ethanol in it.

    corrected: whether the axial scale is to be carried over to tissue; for linear arrays alone. Raises ControlRefused.
    """

    def __init__(self, water_c: float | None, scanner_m_s: float = SCANNER_M_S, corrected: bool = False) -> None:
        self.water_c, self.scanner_m_s = water_c, scanner_m_s
        self.water_m_s: float | None = None
        if not SETTINGS_M_S[0] <= scanner_m_s <= SETTINGS_M_S[1]:
            what = f"the scanner's speed of sound must be {SETTINGS_M_S[0]:g} to {SETTINGS_M_S[1]:g} m/s"
            raise ControlRefused(what, "water", "1540 is usual")
        if water_c is not None:
            try:
                self.water_m_s = speed_of_sound_m_s(water_c)
            except ValueError:
                what = f"the water's temperature must be {RANGE_C[0]:g} to {RANGE_C[1]:g} °C"
                raise ControlRefused(what, "water", "Measure it, or leave it out") from None
        self.corrected = corrected and water_c is not None
        if abs(self.error) > LARGEST_ERROR and not corrected:
            what = f"{self.text}; {100 * LARGEST_ERROR:g} % is the most"
            remedy = "Warm the water to 48 °C, or have the depths corrected (linear arrays)"
            raise ControlRefused(what, "water", remedy)

    @property
    def error(self) -> float:
        """Returns the relative error of depths: positive where they appear too deep; 0 where it is not known."""
        return 0.0 if self.water_m_s is None else self.scanner_m_s / self.water_m_s - 1

    @property
    def text(self) -> str:
        """Returns the scale check in words; empty where the temperature was not measured."""
        if self.water_m_s is None:
            return ""
        deep = "too deep" if self.error > 0 else "too shallow"
        corrected = ", corrected" if self.corrected else ""
        return (
            f"water of {self.water_c:g} °C: {self.water_m_s:.0f} m/s, scanner: {self.scanner_m_s:.0f} m/s: "
            f"depths appear {abs(100 * self.error):.1f} % {deep}{corrected}"
        )

    def for_tissue(self, calibration: Calibration) -> Calibration:
        """Returns the calibration with its scale carried over to where sound travels as the scanner assumes, where that
        was asked for.
        """
        if not self.corrected or self.water_m_s is None:
            return calibration
        return for_tissue(calibration, self.water_m_s, self.scanner_m_s)


class LatencyStep:
    """Measures the latency while the probe is moved up and down over the bottom of the tank. found: None while the
    motion does not show it.
    """

    def __init__(self) -> None:
        self._line = BottomLine()
        self._begun_anew = 0
        self.found: Latency | None = None

    @property
    def full(self) -> bool:
        """Returns whether as much is collected as is kept; no more is taken."""
        return self._line.pictures >= MOST_PICTURES

    def take(self, sample: Frame | Pose) -> None:
        """Takes the next sample of the feed; after a minute no more are taken."""
        if not self.full:
            self._line.step(sample)

    def solve(self) -> None:
        """Solves for the latency from all samples so far. A whole minute that does not show it is thrown away, and
        another one begins.
        """
        if self.full and self.found is not None:
            return
        self.found = self._line.latency()
        if self.full and self.found is None:
            self._line, self._begun_anew = BottomLine(), self._begun_anew + 1

    def fields(self) -> dict[str, Any]:
        return {
            "pictures": self._line.pictures,
            "seen": self._line.seen,
            "full": self.full,
            "begun_anew": self._begun_anew,
            "latency_ms": None if self.found is None else 1e3 * self.found.value_s,
            "sigma_ms": None if self.found is None else 1e3 * self.found.sigma_s,
        }


class CheckStep:
    """Makes a second, short scan of a crossing elsewhere. known_mm: its place, tracker axes, if found by a pointer."""

    def __init__(self, latency_ms: float, scale: tuple[float, float], known_mm: Vector | None) -> None:
        self.scan = CrosswireScan(latency_ms, scale)
        self._known_mm = known_mm

    def judged(self, calibration: Calibration, crossing_mm: Vector) -> tuple[PointCheck | None, str]:
        """Returns the check of that calibration at the point, and why it does not pass, if so. crossing_mm: the
        crossing of the scan.
        """
        views = self.scan.views
        if len(views) < LEAST_VIEWS:
            return None, f"{len(views)} passages through the other crossing, {LEAST_VIEWS} are needed"
        check = check_point(calibration, views, self._known_mm)
        apart_mm = float(np.linalg.norm(check.points_mm.mean(axis=0) - crossing_mm))
        if apart_mm < _ELSEWHERE_MM:
            what = f"it is {apart_mm:.0f} mm from where the scan was made"
            return check, f"{what}: move the tank by {_ELSEWHERE_MM:g} mm and more, and check again"
        if not check.passed:
            return check, f"{check.error_mm:.2f} mm RMS, {PASS_MM:g} mm is the most: see that nothing slips; scan again"
        return check, ""

    def fields(self, calibration: Calibration, crossing_mm: Vector) -> dict[str, Any]:
        check, why = self.judged(calibration, crossing_mm)
        return {
            "views": len(self.scan.views),
            "error_mm": None if check is None else check.error_mm,
            "largest_mm": None if check is None else check.largest_mm,
            "known": self._known_mm is not None,
            "why": why,
        }

    def record(self, calibration: Calibration, crossing_mm: Vector) -> str:
        """Returns the record for the provenance of a check that has passed."""
        check, _ = self.judged(calibration, crossing_mm)
        assert check is not None
        how = "from where it is" if check.known else "about one place"
        return f"{len(self.scan.views)} views put another point within {check.error_mm:.2f} mm RMS {how}"


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Holds what motion over tissue, without a phantom, last showed: how far the calibration is from the reference,
    (8,) in the order and units of PARAMETERS, NaN where that was not observed, and its sigma.
    """

    change: Vector
    sigma: Vector

    def less(self, new: Calibration, reference: Calibration) -> tuple[Vector, Vector]:
        """Returns (8,) the estimate less the new calibration, and that ÷ the sigmas of both. Small rotations add."""
        change = difference_in_sigmas(new, reference)[0] + self.change
        variance = np.square(self.sigma) + (0.0 if new.covariance is None else np.diag(new.covariance))
        return change, np.asarray(change / np.sqrt(variance))


def estimate_of(status: Mapping[str, Any]) -> Estimate | None:
    """Returns the estimate in the service's status before the scan, None where it had observed nothing."""
    change, sigma = stated_change(status.get("checks", ()))
    return Estimate(change, sigma) if np.any(np.isfinite(change)) else None
