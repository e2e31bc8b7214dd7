"""Solves for ζ, the elevational part of t_x, from a point seen from many directions (Boctor et al. 2005, Eq. 7). Pure.

A picture point p = S Λ (u − centre), in the plane, lies at Rᵀ(p − t_x) in the sensor frame and at B times that in the
tracker's. With t_x(ζ) = t_o + ζ (0, 0, 1)ᵀ the point is a_i + ζ n_i, where a_i = B_i Rᵀ(p_i − t_o) and n_i is minus the
picture's normal. The right ζ makes the cloud of points smallest; with δ the deviation from the mean, ζ = −Σ δn·δa /
Σ|δn|² and its standard deviation is σ / √Σ|δn|². The same sum with three directions instead of one gives all of t_x.

R_x, Λ and polarity are taken as known, and for ζ the in-plane offset t_o as well. A marker that slid shifts all three
components: solve_offset needs turns in the plane beside the tilt and assumes nothing of t_x.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.types import Calibration, Vector
from probewatch.drivers.errors import ProbewatchError
from probewatch.drivers.samples import Matrix4

_CUT_SIGMA = 5.0
"""Robust standard deviations beyond which a view is rejected. Less rejects good views, because the scale of a few views
fluctuates; more lets gross errors draw the offset (tests/appliance/crosswire/test_offset.py)."""
_MEDIAN_OF_CHI3 = 1.5382
"""Median length of a vector of three unit normal components: distances divided by it are standard deviations."""
_LARGEST_OUTLIER_SHARE = 0.2
"""Share of rejected views beyond which this is not a scan with some bad views but a bad scan: 4 of 20 that agree do not
win, 6 of 20 are refused (tests/appliance/crosswire/test_offset.py)."""
_ROBUST_ROUNDS = 12
"""Rounds of reweighting, each a small fit: it runs once a scan, so more would cost little. Not measured."""
_TINY = 1e-9
"""Information, as a share of the largest, and mm, that count as none: the rounding of places in mm is far less."""
_LEAST_INFORMATION_PER_VIEW = 1e-7
"""mm² of cloud for each mm² of offset along its weakest direction: normals that spread by 3e-4 rad, .02°. Less gives
sigmas that come from rounding; Demand requires 5° anyway."""
_SLID_SIGMA, _SLID_MM = 4.0, 1.0
"""Both must be exceeded for a marker to have slid: less of the first refuses scans by chance, less of the second for
what does no harm, as a limit is 4 mm."""


class ScanRefused(ProbewatchError):  # noqa: N818  an answer, as the technician reads it
    """Signals that the scan cannot support the calibration requested of it."""

    exit_code = 65


@dataclass(frozen=True, slots=True)
class Demand:
    """Holds what a scan must support to be believed.

    sigma_mm: largest standard deviation of any solved component. tilt_deg: least tilt spread: below it small systematic
    errors, which no number of views averages out, grow more than tenfold. views: fewest after rejection.
    """

    sigma_mm: float = 0.5
    tilt_deg: float = 5.0
    views: int = 8


@dataclass(frozen=True, slots=True, eq=False)
class OffsetSolution:
    """Holds t_x, or the part of it that was solved.

    offset_mm: (3,) whole t_x. sigma_mm: (3,), NaN for what was taken as known, infinite where the views do not show it.
    localisation_mm: standard deviation of one point per axis, from the cloud that remains. cloud_before_mm,
    cloud_after_mm: RMS distance of the kept points from their mean. tilt_sd_deg: spread of the picture's normal per
    axis, √(Σ|δn|²/2N). tilt_needed_deg: the spread at which as many views of ζ would just meet the demand. kept: (N,)
    bool, False for rejected views.
    """

    offset_mm: Vector
    sigma_mm: Vector
    localisation_mm: float
    cloud_before_mm: float
    cloud_after_mm: float
    tilt_sd_deg: float
    tilt_needed_deg: float
    kept: NDArray[np.bool_]

    @property
    def views(self) -> int:
        return int(self.kept.sum())

    @property
    def rejected(self) -> int:
        return len(self.kept) - self.views

    @property
    def zeta_mm(self) -> float:
        return float(self.offset_mm[2])

    @property
    def zeta_sigma_mm(self) -> float:
        return float(self.sigma_mm[2])


def solve_zeta(
    crossings_px: Vector, poses: Matrix4, calibration: Calibration, demand: Demand | None = None
) -> OffsetSolution:
    """Solves for ζ alone, with t_o and all else of the calibration taken as known.

    crossings_px: (N, 2) (column, row) from the corner pixel. poses: (N, 4, 4) sensor → tracker, mm. Raises ScanRefused
    with figures when views, tilt spread or sigma fall short of the demand.
    """
    return _supported(crossings_px, poses, calibration, [2], demand or Demand())


def solve_offset(
    crossings_px: Vector, poses: Matrix4, calibration: Calibration, demand: Demand | None = None
) -> OffsetSolution:
    """Solves for all of t_x; arguments and refusals are those of solve_zeta."""
    return _supported(crossings_px, poses, calibration, [0, 1, 2], demand or Demand())


def refuse_slid(crossings_px: Vector, poses: Matrix4, calibration: Calibration) -> None:
    """Tests what solve_zeta takes as known: the same views must not demand another in-plane offset.

    Raises ScanRefused where they do, by more than 4 standard deviations and 1 mm; passes where they do not show it.
    """
    solution = _solve(crossings_px, poses, calibration, [0, 1, 2], Demand())
    shift_mm = (solution.offset_mm - calibration.offset_mm)[:2]
    if np.any(np.abs(shift_mm) > np.maximum(_SLID_SIGMA * solution.sigma_mm[:2], _SLID_MM)):
        raise ScanRefused(
            f"the offset in the picture's plane is off as well, by {shift_mm[0]:+.1f} mm laterally and "
            f"{shift_mm[1]:+.1f} mm axially: ζ alone cannot correct it",
            "cross-wire scan",
            "Look whether the marker body has slid; then solve the whole offset: --solve offset",
        )


def renewed(calibration: Calibration, solution: OffsetSolution) -> Calibration:
    """Returns the calibration with the solved components of t_x, their sigma (where it has any) and observability."""
    solved = np.concatenate([np.zeros(5, np.bool_), np.isfinite(solution.sigma_mm)])
    covariance = None
    if calibration.covariance is not None:
        covariance = np.where(solved[:, None] | solved[None, :], 0.0, calibration.covariance)
        covariance[solved, solved] = solution.sigma_mm[solved[5:]] ** 2
    observed = tuple(bool(now or before) for now, before in zip(solved, calibration.observed, strict=True))
    return replace(calibration, offset_mm=solution.offset_mm, covariance=covariance, observed=observed)


def _linear_model(crossings_px: Vector, poses: Matrix4, calibration: Calibration) -> tuple[Vector, Vector]:
    """Returns the points for t_x = 0, (N, 3), and their derivatives by t_x, (N, 3, 3), whose column 2 is n."""
    centre_px = (np.array(calibration.image_size_px) - 1) / 2
    in_plane = (crossings_px - centre_px) * calibration.polarity * calibration.scale_mm_per_px
    in_picture = np.column_stack([in_plane, np.zeros(len(in_plane))])
    turn = poses[:, :3, :3] @ calibration.rotation.T
    return np.einsum("nij,nj->ni", turn, in_picture) + poses[:, :3, 3], -turn


def _supported(
    crossings_px: Vector, poses: Matrix4, calibration: Calibration, solved: list[int], demand: Demand
) -> OffsetSolution:
    solution = _solve(crossings_px, poses, calibration, solved, demand)
    _demand_support(solution, float(np.max(solution.sigma_mm[solved])), demand)
    return solution


def _solve(
    crossings_px: Vector, poses: Matrix4, calibration: Calibration, solved: list[int], demand: Demand
) -> OffsetSolution:
    _demand_views(len(crossings_px), demand)
    points, directions = _linear_model(crossings_px, poses, calibration)
    known = np.where(np.isin(range(3), solved), 0.0, calibration.offset_mm)
    points, directions = points + directions @ known, directions[:, :, solved]
    kept = _consistent(points, directions)
    _demand_views(int(kept.sum()), demand)
    change, information = _least_cloud(points[kept], directions[kept])
    offset = known.copy()
    offset[solved] = change
    residual = _about_mean(points[kept] + directions[kept] @ change)
    before = _about_mean(points[kept] + directions[kept] @ calibration.offset_mm[solved])
    views = len(residual)
    localisation = float(np.sqrt((residual**2).sum() / (3 * views - 3 - len(solved))))
    sigma = np.full(3, np.nan)
    sigma[solved] = localisation * _gain(information, views)
    return OffsetSolution(
        offset_mm=offset,
        sigma_mm=sigma,
        localisation_mm=localisation,
        cloud_before_mm=_rms_length(before),
        cloud_after_mm=_rms_length(residual),
        tilt_sd_deg=_tilt_sd_deg(directions[kept][:, :, -1]),
        tilt_needed_deg=max(demand.tilt_deg, float(np.degrees(localisation / (demand.sigma_mm * np.sqrt(2 * views))))),
        kept=kept,
    )


def _gain(information: Vector, views: int) -> Vector:
    """Returns the standard deviation of each component per mm of localisation; infinite where views do not show it."""
    if np.linalg.eigvalsh(information)[0] < _LEAST_INFORMATION_PER_VIEW * views:
        return np.full(len(information), np.inf)
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(information))))


def _about_mean(values: Vector) -> Vector:
    return np.asarray(values - values.mean(axis=0))


def _rms_length(vectors: Vector) -> float:
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))


def _tilt_sd_deg(normals: Vector) -> float:
    return float(np.degrees(_rms_length(_about_mean(normals)) / np.sqrt(2)))


def _least_cloud(points: Vector, directions: Vector, weights: Vector | None = None) -> tuple[Vector, Vector]:
    """Returns x that makes the cloud points + directions x smallest, and ΣδMᵀδM, with M (N, 3, k) the directions.

    For one direction x is −Σ δn·δa / Σ|δn|². Directions that the views cannot separate give the smallest x.
    """
    weight = np.ones(len(points)) if weights is None else weights
    share = weight / weight.sum()
    away = points - share @ points
    slopes = directions - np.einsum("n,nik->ik", share, directions)
    information = np.einsum("n,nik,nil->kl", weight, slopes, slopes)
    right = -np.einsum("n,nik,ni->k", weight, slopes, away)
    if len(right) == 1:
        return right / max(float(information[0, 0]), _TINY**2), information
    return np.asarray(np.linalg.lstsq(information, right, rcond=_TINY)[0]), information


def _consistent(points: Vector, directions: Vector) -> NDArray[np.bool_]:
    """Returns (N,) False for views more than _CUT_SIGMA robust standard deviations off a fit of least absolute
    distances.

    At most one view in five may be rejected: a worse scan is refused, not trimmed.
    """
    weights = np.ones(len(points))
    for _ in range(_ROBUST_ROUNDS):
        change, _information = _least_cloud(points, directions, weights)
        placed = points + directions @ change
        distance = np.linalg.norm(placed - np.average(placed, axis=0, weights=weights), axis=1)
        scale = max(float(np.median(distance)) / _MEDIAN_OF_CHI3, _TINY)
        weights = 1 / np.maximum(distance, 0.1 * scale)
    kept = distance <= _CUT_SIGMA * scale
    if np.mean(~kept) > _LARGEST_OUTLIER_SHARE:
        raise ScanRefused(
            f"{np.sum(~kept)} of {len(kept)} views contradict the others by more than {_CUT_SIGMA * scale:.1f} mm",
            "cross-wire scan",
            "See that nothing but the wires echoes and that the tank stands still, then scan again",
        )
    return np.asarray(kept, dtype=np.bool_)


def _demand_views(views: int, demand: Demand) -> None:
    if views < demand.views:
        raise ScanRefused(
            f"{views} usable views of the crossing, {demand.views} are needed",
            "cross-wire scan",
            "Move slowly through the crossing again and again, with another tilt each time",
        )


def _demand_support(solution: OffsetSolution, sigma_mm: float, demand: Demand) -> None:
    """Raises ScanRefused where tilt or sigma fall short of the demand; the comparisons are such that NaN is refused."""
    if not solution.tilt_sd_deg >= demand.tilt_deg:
        spread = f"the tilt spread is {solution.tilt_sd_deg:.1f}° over {solution.views} views"
        raise ScanRefused(
            f"{spread}, {demand.tilt_deg:g}° is needed",
            "cross-wire scan",
            "Tilt the probe further: to both sides, forwards and backwards",
        )
    if not (np.isfinite(sigma_mm) and sigma_mm <= demand.sigma_mm):
        spread = f"{solution.views} views of {solution.localisation_mm:.2g} mm over {solution.tilt_sd_deg:.1f}° of tilt"
        asked = f"± {demand.sigma_mm:g} mm is asked (ζ needs {solution.tilt_needed_deg:.1f}°)"
        raise ScanRefused(
            f"{spread} give ± {sigma_mm:.2g} mm, {asked}",
            "cross-wire scan",
            "Scan longer and tilt further; to solve the whole offset, turn the probe in the picture's plane, too",
        )
