"""Bounds how far a point of the picture may be from where the reference puts it, in millimetres. Pure.

What the examination leaves open of the calibration and the latency is a normal distribution of nine numbers. To first
order the error of a point is linear in them, so it is normal as well, with a mean and a covariance in the axes of the
picture; its length is the same in the tracker's. The latency contributes by the speed at which the hand moves it.
"""

from dataclasses import dataclass
from math import isfinite

import numpy as np
from scipy.special import gammaincinv

from probewatch.appliance.core.parameters import MEASURED, PER_UNIT
from probewatch.appliance.core.path.residual import OFFSET, ROTATION
from probewatch.appliance.core.quality.examination import Finding
from probewatch.appliance.limits import Limits, Region
from probewatch.appliance.types import POINT_ACROSS, POINT_LEVELS, Calibration, Fault, PointError, VerdictKind
from probewatch.drivers.rigid import Array, skew


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """Holds how the truth may differ from the reference and a punctual tracker: θ, the parameters of X and the latency.

    mean: (9,), covariance: (9, 9), in rad, relative, mm and s, including what the model of the motion leaves out.
    stamps_err_s: bound of the error that the stamps share. shown_ns: the oldest of the times of `Solution.shown_ns`.
    """

    mean: Array
    covariance: Array
    stamps_err_s: float
    shown_ns: int


def change_of(finding: Finding, stamps_err_s: float) -> Change | None:
    """Returns the values and sigmas of the checks, with the correlations of the solution that they come from. Returns
    None where any was not observed, or where polarity or latency is not known to be in order: no bound holds then.
    """
    known = {check.name: check for check in finding.checks}
    checks = [known[name] for name in MEASURED]
    needed = known[Fault.POLARITY.value], known[Fault.LATENCY.value]
    if finding.solution is None or not all(isfinite(check.value) and isfinite(check.sigma) for check in checks):
        return None
    if any(check.verdict is not VerdictKind.OK for check in needed):
        return None
    value, sigma = np.array([(check.value, check.sigma) for check in checks]).T / PER_UNIT
    covariance = _widened(finding.solution.covariance, sigma)
    return Change(value, covariance, stamps_err_s, int(min(finding.solution.shown_ns)))


def _widened(covariance: Array, sigma: Array) -> Array:
    """Returns the covariance, (9, 9), with these sigmas. What the checks add is independent of everything else; where
    they know a parameter more precisely, as may be with the latency, its whole row and column shrink.
    """
    solved = np.sqrt(np.diag(covariance))
    sharper = np.minimum(1.0, sigma / solved)
    widened = np.asarray(covariance * np.outer(sharper, sharper))
    np.fill_diagonal(widened, sigma**2)
    return widened


class Places:
    """Bounds the error at a grid of places of the picture, and at both ends of the row at the named depth."""

    def __init__(self, reference: Calibration, limits: Limits) -> None:
        self._depth_mm = limits.point_depth_mm
        self._at_mm = grid_mm(reference, limits.region, POINT_ACROSS)
        self._region = len(self._at_mm)
        if self._depth_mm is not None:
            self._at_mm = np.concatenate([self._at_mm, _row_mm(reference, limits.region, self._depth_mm)])
        self._slope = slope_of_places(self._at_mm, reference)

    def error(self, change: Change, pace: Array) -> PointError:
        """Returns the error of a point that the change leaves open. pace: (3, 4) as of `Pace`."""
        bounds_mm = bounds_at(self._at_mm, self._slope, change, pace).bounds_mm
        region_mm, deep_mm = bounds_mm[:, : self._region], bounds_mm[:, self._region :]
        return PointError(
            worst_mm=_both(region_mm.max(axis=1)),
            median_mm=_both(np.median(region_mm, axis=1)),
            depth_mm=self._depth_mm,
            at_depth_mm=None if self._depth_mm is None else _both(deep_mm.max(axis=1)),
            shown_ns=change.shown_ns,
            region_mm=tuple(region_mm[-1].tolist()),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """Holds bounds at n places. mean (n, 3) and covariance (n, 3, 3): those of the error, truth minus reference, mm in
    the axes of the picture. bounds_mm: (len(POINT_LEVELS), n).
    """

    mean: Array
    covariance: Array
    bounds_mm: Array


def bounds_at(at_mm: Array, slope: Array, change: Change, pace: Array) -> Bounds:
    """Returns the bounds at these places. at_mm: (n, 3) in the axes of the picture, mm from its middle. slope: their
    `slope_of_places`. pace: (3, 4) as of `Pace`.
    """
    speeds = at_mm @ pace[:, :3].T + pace[:, 3]
    slope = np.concatenate([slope, speeds[:, :, None]], axis=2)
    mean, covariance = slope @ change.mean, slope @ change.covariance @ slope.transpose(0, 2, 1)
    room_mm = change.stamps_err_s * np.linalg.norm(speeds, axis=1)
    return Bounds(mean, covariance, longest(mean, covariance) + room_mm)


def slope_of_places(at_mm: Array, reference: Calibration) -> Array:
    """Returns how places in the room, in the axes of the picture, move with the parameters of X: (n, 3, 8). at_mm:
    (n, 3) in these axes, mm from the picture's middle.
    """
    slope = np.zeros((len(at_mm), 3, OFFSET.stop))
    slope[:, :, ROTATION] = skew(at_mm - reference.offset_mm)
    slope[:, 0, 3], slope[:, 1, 4] = at_mm[:, 0], at_mm[:, 1]
    slope[:, :, OFFSET] = -np.eye(3)
    return slope


def longest(mean: Array, covariance: Array) -> Array:
    """Returns lengths that normal vectors do not exceed, each with one of the probabilities POINT_LEVELS:
    (len(POINT_LEVELS), n). mean: (n, 3). covariance: (n, 3, 3).

    The square of the length is a sum of weighted noncentral χ²; it is approximated by a shifted χ² with the same mean,
    variance and third cumulant (Buckley and Eagleson 1988). The bounds then hold for 94.7 to 95.6 % and for 99.6 to
    99.75 %, whatever the mean and covariance (test_point_error.py).
    """
    powers = covariance @ covariance
    seen = np.einsum("nij,nj->ni", covariance, mean)
    first = np.trace(covariance, axis1=1, axis2=2) + np.sum(mean**2, axis=1)
    second = 2 * (np.trace(powers, axis1=1, axis2=2) + 2 * np.sum(mean * seen, axis=1))
    third = 8 * (np.sum(powers * covariance, axis=(1, 2)) + 3 * np.sum(seen**2, axis=1))
    freedom = 8 * second**3 / third**2
    chi = 2 * gammaincinv(freedom / 2, np.array(POINT_LEVELS)[:, None])
    square = first + np.sqrt(second / (2 * freedom)) * (chi - freedom)
    return np.asarray(np.sqrt(np.maximum(square, 0.0)))


def grid_mm(reference: Calibration, region: Region, across: int) -> Array:
    """Returns places of the region, edges included, (across², 3), in the axes of the picture, mm from its middle."""
    columns, rows = np.linspace(region.left, region.right, across), np.linspace(region.top, region.bottom, across)
    shares = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    return _in_picture(reference, shares)


def _row_mm(reference: Calibration, region: Region, depth_mm: float) -> Array:
    """Returns both ends of the row at that depth, because the worst place of a row is one of them."""
    share = depth_mm / (reference.image_size_px[1] * float(reference.scale_mm_per_px[1]))
    return _in_picture(reference, np.array([[region.left, share], [region.right, share]]))


def _in_picture(reference: Calibration, shares: Array) -> Array:
    """Converts shares of width and height from the upper left corner, (n, 2), to mm in the picture's axes, (n, 3)."""
    size_mm = np.array(reference.image_size_px) * reference.scale_mm_per_px * reference.polarity
    return np.pad((shares - 0.5) * size_mm, ((0, 0), (0, 1)))


def _both(bounds_mm: Array) -> tuple[float, float]:
    narrow, wide = bounds_mm.tolist()
    return narrow, wide
