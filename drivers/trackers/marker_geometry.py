"""Compares the marker body as the tracker measures it with its definition: how large the misfit is, and whether one
marker alone is displaced.

A rigid fit (Kabsch's method: the rotation from the singular value decomposition of the cross-covariance) leaves a
residual at every marker. If the fit is good with one particular marker left out, and with no other, that marker is
loose. If no single marker explains the misfit, the body is bent.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from probewatch.drivers.samples import Matrix4

LEAST_MARKERS = 3
"""Three points that are not on one line determine a rigid pose; two leave the rotation about their line open."""

_LOOSE_SHARE = 0.35
"""Share of the second smallest misfit, with one marker left out, below which the smallest misfit identifies its marker
as loose. More blames one marker for a body that is bent; less calls a loose marker a bent body. A marker 5 mm off is
named (tests/drivers/trackers/ndi/test_models.py); where the limit between the two lies was not measured.
"""

_TOLERANCE_MM = 0.5
"""Misfit (RMS) up to which no single marker is judged. It is above the fit of whole tools in recordings of a Polaris,
0.13 to 0.30 mm, and below the limit of the check, 0.75 (docs/trackers.md).
"""

_NEAREST_MM = 15.0
"""How far a marker may be from its place and still be assigned to it. More mistakes strays and neighbours for it, which
are 51 mm and more away on the simulated body; less does not see a marker that has moved far.
"""

_FLATTEST = 1e-3
"""Ratio of the markers' second extent to the first above which they span a plane: 0.1 mm on 100 mm, which is noise.
Less lets noise determine the rotation about the line.
"""

Points = NDArray[np.float64]
"""Array (n, 3), millimetres; a row of NaN is a marker that was not seen."""


@dataclass(frozen=True, slots=True)
class MarkerGeometry:
    """Holds the result of a comparison of markers with their definition.

    rms_mm: RMS of the residuals of all markers seen. worst_mm: largest residual. markers: how many were compared.

    loose: index of the one marker that is displaced while the rest keep their shape; None where there is none.
    loose_mm: how far it is from its place among the others; 0 where none is loose. bent: whether there is a misfit that
    no single marker explains. A misfit within tolerance is neither, and `loose` needs four markers.
    pose: (4, 4) definition → measured.
    """

    rms_mm: float
    worst_mm: float
    markers: int
    loose: int | None
    loose_mm: float
    bent: bool
    pose: Matrix4


def marker_geometry(measured: Points, definition: Points, tolerance_mm: float = _TOLERANCE_MM) -> MarkerGeometry | None:
    """Compares markers in the order of the definition. Returns None where fewer than three are seen or they lie on a
    line.

    measured, definition: (n, 3) mm, in any two frames. Raises ValueError for unequal shapes.
    """
    if measured.shape != definition.shape or measured.ndim != 2 or measured.shape[1] != 3:
        raise ValueError(f"markers of shape {measured.shape} cannot be compared with {definition.shape}")
    seen = np.flatnonzero(np.isfinite(measured).all(axis=1))
    if len(seen) < LEAST_MARKERS or not _spans_a_plane(definition[seen]):
        return None
    pose, residuals_mm = _fit(measured[seen], definition[seen])
    rms_mm = float(np.sqrt(np.mean(residuals_mm**2)))
    loose, loose_mm = _loose(measured, definition, seen, tolerance_mm) if rms_mm > tolerance_mm else (None, 0.0)
    bent = rms_mm > tolerance_mm and loose is None
    return MarkerGeometry(rms_mm, float(residuals_mm.max()), len(seen), loose, loose_mm, bent, pose)


def in_order(found: Points, definition: Points, pose: Matrix4, nearest_mm: float = _NEAREST_MM) -> Points:
    """Puts markers found without numbers in the order of the definition: each goes to its nearest place, closest pair
    first.

    found: (m, 3) mm, in the tracker's frame. pose: (4, 4) definition → tracker. Returns (n, 3), NaN where no marker
    lies within nearest_mm.
    """
    ordered = np.full_like(definition, np.nan)
    expected = definition @ pose[:3, :3].T + pose[:3, 3]
    far_mm = np.linalg.norm(found[:, None] - expected[None], axis=2)
    for _ in range(min(far_mm.shape)):
        i, j = np.unravel_index(int(np.argmin(far_mm)), far_mm.shape)
        if far_mm[i, j] > nearest_mm:
            break
        ordered[j] = found[i]
        far_mm[i, :], far_mm[:, j] = np.inf, np.inf
    return ordered


def _fit(measured: Points, definition: Points) -> tuple[Matrix4, Points]:
    """Returns (pose (4, 4), residuals (n,) mm) of the best rigid fit."""
    centre_m, centre_d = measured.mean(axis=0), definition.mean(axis=0)
    U, _, Vt = np.linalg.svd((measured - centre_m).T @ (definition - centre_d))
    handed = np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    pose = np.eye(4)
    pose[:3, :3] = U @ handed @ Vt
    pose[:3, 3] = centre_m - pose[:3, :3] @ centre_d
    return pose, _distances(measured, definition, pose)


def _distances(measured: Points, definition: Points, pose: Matrix4) -> Points:
    distances: Points = np.linalg.norm(measured - definition @ pose[:3, :3].T - pose[:3, 3], axis=1)
    return distances


def _loose(
    measured: Points, definition: Points, seen: NDArray[np.intp], tolerance_mm: float
) -> tuple[int | None, float]:
    """Returns the marker without which the others fit far better than with it, and how far it is displaced, mm."""
    if len(seen) <= LEAST_MARKERS:
        return None, 0.0
    without = sorted(_without(marker, measured, definition, seen) for marker in seen)
    (best_mm, marker, off_mm), (second_mm, *_) = without[:2]
    explained = best_mm <= tolerance_mm and best_mm < _LOOSE_SHARE * second_mm
    return (marker, off_mm) if explained else (None, 0.0)


def _without(marker: int, measured: Points, definition: Points, seen: NDArray[np.intp]) -> tuple[float, int, float]:
    """Returns (worst residual of the others in mm, the marker, how far it is displaced in mm)."""
    others = seen[seen != marker]
    if not _spans_a_plane(definition[others]):
        return np.inf, int(marker), 0.0
    pose, residuals_mm = _fit(measured[others], definition[others])
    off_mm = _distances(measured[[marker]], definition[[marker]], pose)[0]
    return float(residuals_mm.max()), int(marker), float(off_mm)


def _spans_a_plane(points: Points) -> bool:
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] > _FLATTEST * max(spread[0], 1e-9))
