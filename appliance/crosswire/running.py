"""Updates a cross-wire calibration during its scan: views are added or struck out, and the state holds what they give.
Pure.

    scan, running = CrosswireScan(), RunningCalibration((640, 480))
    for sample in samples:
        for view in scan.step(sample):
            running.add(view)
        state = running.state(scan.misses_mm)

Every state holds the solution from nothing, ζ in closed form beside it, the cloud, what is covered, where to go next,
and each reason why it cannot be accepted yet. Solving 300 views takes .1 s.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.acquisition.input_validation import ORTHOGONAL_WITHIN
from probewatch.appliance.crosswire.coverage import TURNS, Coverage, coverage
from probewatch.appliance.crosswire.offset import Demand, OffsetSolution, ScanRefused, solve_zeta
from probewatch.appliance.crosswire.scan import View
from probewatch.appliance.crosswire.whole import LEAST_VIEWS, UNOBSERVED, WholeSolution, solve_whole
from probewatch.appliance.types import PARAMETERS, Calibration, Vector

_MOVEMENTS = {
    "rotation-lateral": "bring the crossing to different depths of the picture while the handle leans to and fro",
    "rotation-axial": "bring the crossing to both sides of the picture while the probe twists",
    "rotation-elevational": "bring the crossing to all four corners of the picture",
    "scale-lateral": "bring the crossing to the left and to the right of the picture",
    "scale-axial": "bring the crossing to the top and to the bottom of the picture",
    "offset-lateral": "twist the probe, and lean it to the sides",
    "offset-axial": "lean the handle to and fro, and to the sides",
    "offset-elevational": "lean the handle to and fro, and twist the probe",
}
"""Maps each parameter to the motion that shows it."""
_MISSES = 5
"""The number of approaches without a meeting from which wires are said not to cross, if there are more of them than
passages. Fewer blame the wires for a hand that turned back; more let a technician scan in vain for longer."""
_MOST = 1e6
"""mm, px, s: the largest number accepted. No probe is a kilometre away, and its squares would swamp all others."""
_UNKNOWN_LATENCY_S = 0.1
"""Standard deviation, s, of the latency where none is stated: what trackers on carts have, and the shipped limit's
60 ms within it."""
_LARGEST_LATENCY_SIGMA_S = 0.02
"""Largest sigma of the latency, s: at 5 mm/s .1 mm. More lets ζ move with the direction of the passages."""


class Reason(StrEnum):
    """Names what prevents a scan from being accepted."""

    TOO_FEW_VIEWS = "too few views"
    TOO_LITTLE_TILT = "too little tilt"
    WIRES_DO_NOT_CROSS = "wires do not cross"
    NOISE_TOO_HIGH = "noise too high"
    NOT_OBSERVED = "parameter not observed"
    LATENCY_NOT_KNOWN = "latency not known"
    CONTRADICTION = "views contradict one another"


@dataclass(frozen=True, slots=True)
class Refusal:
    """Holds one reason against a scan. what: the fact, with figures. remedy: what the technician does. parameter: the
    name of the one concerned, else empty.
    """

    reason: Reason
    what: str
    remedy: str
    parameter: str = ""


@dataclass(frozen=True, slots=True)
class WholeDemand:
    """Holds what a scan must support to become a calibration.

    views: fewest, after rejection. tilt_deg: least standard deviation of the turns about the lateral and axial axis:
    below it small systematic errors, which no number of views averages out, grow more than tenfold. noise_mm: most per
    view and axis. rotation_deg, scale_percent, offset_mm: largest standard deviation of any of them.
    """

    views: int = 20
    tilt_deg: float = 5.0
    noise_mm: float = 0.6
    rotation_deg: float = 0.5
    scale_percent: float = 1.0
    offset_mm: float = 0.5

    @property
    def sigma(self) -> Vector:
        """Returns the largest standard deviations, (8,), in the units of PARAMETERS."""
        return np.array(
            [*(np.radians(self.rotation_deg),) * 3, *(self.scale_percent / 100,) * 2, *(self.offset_mm,) * 3]
        )


@dataclass(frozen=True, slots=True, eq=False)
class Running:
    """Holds what the views so far give. All arrays are by index of the view as it was added.

    views: how many were added. used: (N,) bool, neither struck out nor rejected. struck: indices struck out by hand.
    rejected: indices that contradict the others. whole: None while there is no solution. closed: ζ in closed form, with
    the rest of the reference where there is one, else of `whole`; None where it cannot be had. cloud_mm: (N, 3) where
    each view puts the crossing, relative to it, tracker axes; NaN without solution. refusals: none means acceptable.
    """

    views: int
    used: NDArray[np.bool_]
    struck: tuple[int, ...]
    rejected: tuple[int, ...]
    whole: WholeSolution | None
    closed: OffsetSolution | None
    cloud_mm: Vector
    coverage: Coverage
    refusals: tuple[Refusal, ...]

    @property
    def zeta_mm(self) -> float:
        """Returns the elevational offset; NaN without a solution."""
        return np.nan if self.whole is None else float(self.whole.calibration.offset_mm[2])

    @property
    def zeta_sigma_mm(self) -> float:
        return np.nan if self.whole is None else float(self.whole.sigma[-1])


class RunningCalibration:
    """Collects views and solves them on request. image_size_px: (width, height). reference: the calibration in force,
    if there is one; its polarity is kept, and ζ in closed form relies on it. latency_sigma_s: how well the latency is
    known with which the scan was paired.
    """

    def __init__(
        self,
        image_size_px: tuple[int, int],
        reference: Calibration | None = None,
        demand: WholeDemand | None = None,
        latency_sigma_s: float = _UNKNOWN_LATENCY_S,
    ) -> None:
        self.image_size_px, self.reference = image_size_px, reference
        self.demand = demand or WholeDemand()
        self._latency_sigma_s = latency_sigma_s
        self._views: list[View] = []
        self._struck: set[int] = set()
        self._solved: tuple[WholeSolution | None, str] | None = None

    @property
    def views(self) -> tuple[View, ...]:
        return tuple(self._views)

    def add(self, view: View) -> int:
        """Takes a view; returns its index. Raises ValueError for one without finite numbers of a pose and a picture."""
        _refuse_senseless(view, self.image_size_px)
        self._views.append(view)
        self._solved = None
        return len(self._views) - 1

    def strike(self, index: int, struck: bool = True) -> None:
        """Leaves a view out by hand, or takes it back. Raises IndexError."""
        self._views[index]  # which raises
        (self._struck.add if struck else self._struck.discard)(index % len(self._views))
        self._solved = None

    def correct(self, index: int, centre_px: tuple[float, float]) -> None:
        """Moves the crossing of a view by hand, (column, row). Raises IndexError, or ValueError outside the picture."""
        if not all(0 <= value <= side - 1 for value, side in zip(centre_px, self.image_size_px, strict=True)):
            raise ValueError(f"({centre_px[0]:.1f}, {centre_px[1]:.1f}) lies outside of the picture")
        self._views[index] = replace(self._views[index], centre_px=np.array(centre_px, float))
        self._solved = None

    def state(self, misses_mm: Sequence[float] = ()) -> Running:
        """Returns what all views give that are not struck out. misses_mm: that of CrosswireScan."""
        chosen = [index for index in range(len(self._views)) if index not in self._struck]
        views = [self._views[index] for index in chosen]
        if self._solved is None:
            self._solved = self._solve(views)
        whole, contradiction = self._solved
        used, cloud = np.zeros(len(self._views), np.bool_), np.full((len(self._views), 3), np.nan)
        used[chosen] = True if whole is None else whole.kept
        if whole is not None:
            cloud[chosen] = whole.points_mm - whole.crossing_mm
        kept = [view for index, view in enumerate(self._views) if used[index]]
        covered = coverage(kept, self.image_size_px, whole, self.demand.sigma)
        return Running(
            views=len(self._views),
            used=used,
            struck=tuple(sorted(self._struck)),
            rejected=tuple(index for index in chosen if not used[index]),
            whole=whole,
            closed=self._closed(kept, whole),
            cloud_mm=cloud,
            coverage=covered,
            refusals=tuple(self._refusals(whole, contradiction, len(kept), covered, misses_mm)),
        )

    def _solve(self, views: list[View]) -> tuple[WholeSolution | None, str]:
        if len(views) < LEAST_VIEWS:
            return None, ""
        polarity = (1, 1) if self.reference is None else self.reference.polarity
        try:
            return solve_whole(views, self.image_size_px, polarity, self._latency_sigma_s), ""
        except ScanRefused as error:
            return None, error.what
        except np.linalg.LinAlgError:
            return None, "the views do not determine a calibration"

    def _closed(self, kept: list[View], whole: WholeSolution | None) -> OffsetSolution | None:
        base = self.reference or (None if whole is None else whole.calibration)
        if base is None or len(kept) < LEAST_VIEWS:
            return None
        centres, poses = np.array([view.centre_px for view in kept]), np.array([view.matrix for view in kept])
        try:
            return solve_zeta(centres, poses, base, Demand(sigma_mm=np.inf, tilt_deg=0.0, views=LEAST_VIEWS))
        except ScanRefused:
            return None

    def _refusals(
        self,
        whole: WholeSolution | None,
        contradiction: str,
        views: int,
        covered: Coverage,
        misses_mm: Sequence[float],
    ) -> list[Refusal]:
        """Returns everything that prevents acceptance, with what to mend first at the front."""
        found: list[Refusal] = []
        if len(misses_mm) >= _MISSES and len(misses_mm) > len(self._views):
            what = f"{len(misses_mm)} times the wires came near and stayed {np.median(misses_mm):.1f} mm apart"
            found.append(Refusal(Reason.WIRES_DO_NOT_CROSS, what, "Stretch the wires so that they touch"))
        if views < self.demand.views:
            what = f"{views} usable views of the crossing, {self.demand.views} are needed"
            remedy = "Pass slowly through the crossing again and again, with another tilt each time"
            found.append(Refusal(Reason.TOO_FEW_VIEWS, what, remedy))
        if contradiction:
            remedy = "See that nothing but the wires echoes and that the tank stands still; strike out what is wrong"
            found.append(Refusal(Reason.CONTRADICTION, contradiction, remedy))
        if whole is not None:
            found += self._tilts(covered)
            found += self._noise(whole)
            found += self._unknown(whole)
        return found

    def _tilts(self, covered: Coverage) -> list[Refusal]:
        """Returns refusals by tilt about the lateral and axial axis: leaning to the sides alone shows nothing of ζ."""
        return [
            Refusal(
                Reason.TOO_LITTLE_TILT,
                f"about the {name} axis the tilt spread is {spread:.1f}°, {self.demand.tilt_deg:g}° is needed",
                f"Tilt further, 10° and more to either side: {TURNS[axis]}",
                f"rotation-{name}",
            )
            for axis, (name, spread) in enumerate(zip(("lateral", "axial"), covered.spread_deg[:2], strict=True))
            if not spread >= self.demand.tilt_deg
        ]

    def _noise(self, whole: WholeSolution) -> list[Refusal]:
        if whole.localisation_mm <= self.demand.noise_mm:
            return []
        what = f"one view scatters by {whole.localisation_mm:.2f} mm per axis, {self.demand.noise_mm:g} mm is the most"
        remedy = "Move slower; see that marker body, tank and wires are fixed, and that the tracker sees well"
        return [Refusal(Reason.NOISE_TOO_HIGH, what, remedy)]

    def _unknown(self, whole: WholeSolution) -> list[Refusal]:
        found = []
        if not whole.latency_sigma_s <= _LARGEST_LATENCY_SIGMA_S:
            what = f"how late the tracker is, is known to ± {1000 * whole.latency_sigma_s:.0f} ms only"
            found.append(Refusal(Reason.LATENCY_NOT_KNOWN, what, "Pass through the crossing in both directions"))
        for name, sigma, wanted in zip(PARAMETERS, whole.sigma, self.demand.sigma, strict=True):
            if not sigma <= wanted:
                what = f"{name} is known to ± {_shown(name, sigma)} only, ± {_shown(name, wanted)} is asked"
                found.append(Refusal(Reason.NOT_OBSERVED, what, f"To show it: {_MOVEMENTS[name]}", name))
        return found


def _refuse_senseless(view: View, image_size_px: tuple[int, int]) -> None:
    poses = [pose for pose in (view.matrix, view.earlier, view.later) if pose is not None]
    numbers = [view.centre_px, view.covariance_px, np.array([view.apart_s]), *poses]
    if not all(np.all(np.abs(part) < _MOST) for part in numbers):
        raise ValueError("a view holds a number that is not finite, or too large")
    if not all(0 <= value <= side - 1 for value, side in zip(view.centre_px, image_size_px, strict=True)):
        raise ValueError("a view's crossing lies outside of the picture")
    if np.linalg.eigvalsh(view.covariance_px)[0] < 0:
        raise ValueError("a view's covariance is none")
    for pose in poses:
        if np.abs(pose[:3, :3] @ pose[:3, :3].T - np.eye(3)).max() > ORTHOGONAL_WITHIN:
            raise ValueError("a view's pose is not a rigid motion")


def _shown(name: str, value: float) -> str:
    """Returns a standard deviation of a parameter as text, in the units that people read."""
    factor, unit = {"rotation": (np.degrees(1.0), "°"), "scale": (100.0, " %"), "offset": (1.0, " mm")}[
        name.partition("-")[0]
    ]
    return f"more than {UNOBSERVED:g}{unit}" if value * factor > UNOBSERVED else f"{value * factor:.2g}{unit}"
