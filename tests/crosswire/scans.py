"""Whole scans with known truth: ζ in closed form and from nothing, all eight parameters, ten points elsewhere."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from probewatch.appliance.crosswire.checkpoint import reconstructed_mm
from probewatch.appliance.crosswire.offset import Demand, solve_zeta
from probewatch.appliance.crosswire.running import RunningCalibration
from probewatch.appliance.crosswire.scan import View
from probewatch.drivers.rigid import interpolate
from tests.support.crossings import SIZE_PX, TRUE, errors, guided_views

POINTS = 10
PASSAGES = 120
"""Of a guided scan of three minutes: the simulated hand makes 54 in one (probewatch recalibrate --simulated)."""


@dataclass(frozen=True)
class Scanned:
    """ratios: (8,) error ÷ stated sigma. zeta, closed: the same of ζ alone, from nothing and in closed form.

    points_mm: RMS distance of ten reconstructed points from where they are, each seen once with all noise of a view;
    calibration_mm: what of that is the calibration's, with noise-free views.
    """

    ratios: np.ndarray
    zeta: float
    closed: float
    points_mm: float
    calibration_mm: float
    accepted: bool


def scanned(seed: int) -> Scanned:
    """Noise as of an optical tracker, 0.1 mm and 0.02° per axis of each pose, and half a pixel of the crossing; one
    view in forty is of something else.
    """
    random = np.random.default_rng((seed, 91))
    views = guided_views(seed, PASSAGES, late_s=random.uniform(-0.08, 0.08))
    for index in np.flatnonzero(random.random(PASSAGES) < 1 / 40):
        far = views[index].centre_px + random.choice([-1, 1], 2) * random.uniform(40, 200, 2)
        views[index] = _moved(views[index], np.clip(far, 0, np.array(SIZE_PX) - 1))
    running = RunningCalibration(SIZE_PX)
    for view in views:
        running.add(view)
    state = running.state()
    assert state.whole is not None
    assert state.closed is not None
    found, off = state.whole.calibration, errors(state.whole)
    offs = [points_off_mm(found, seed, quiet) for quiet in (False, True)]
    closed = _closed(state, views)
    return Scanned(off / state.whole.sigma, off[7] / state.whole.sigma[7], closed, *offs, not state.refusals)


def _moved(view: View, centre_px: np.ndarray) -> View:
    return View(
        view.t_ns, centre_px, view.covariance_px, view.matrix, view.earlier, view.later, view.apart_s, view.confidence
    )


def _closed(state, views: list[View]) -> float:
    """ζ by Eq. 7 with all else as it truly is and poses of the right time, ÷ its sigma."""
    late_s = state.whole.latency_s
    poses = []
    for view in views:
        part = 0.5 + late_s / view.apart_s
        poses.append(interpolate(view.earlier, view.later, part))
    solution = solve_zeta(np.array([view.centre_px for view in views]), np.array(poses), TRUE, Demand())
    return (solution.zeta_mm - TRUE.offset_mm[2]) / solution.zeta_sigma_mm


def points_off_mm(found, seed: int, quiet: bool) -> float:
    """RMS distance of ten points anywhere from where the calibration puts them. quiet: seen without noise."""
    random = np.random.default_rng((seed, 92))
    noise = 0.0 if quiet else 1.0
    offs = []
    for _ in range(POINTS):
        where_mm = np.array([64.0, -87.0, -1520.0]) + random.uniform(-80, 80, 3)
        turn = Rotation.from_rotvec(np.radians(random.normal(0, 25, 3))).as_matrix()
        place_mm = np.array([*(random.uniform(-1, 1, 2) * (20, 13)), 0.0])
        pose = np.eye(4)
        pose[:3, :3] = turn @ TRUE.rotation
        pose[:3, 3] = where_mm - pose[:3, :3] @ TRUE.rotation.T @ (place_mm - TRUE.offset_mm)
        shaken = Rotation.from_rotvec(noise * random.normal(0, np.radians(0.02), 3)).as_matrix()
        pose[:3, :3] = pose[:3, :3] @ shaken
        pose[:3, 3] += noise * random.normal(0, 0.1, 3)
        centre = place_mm[:2] / TRUE.scale_mm_per_px + (np.array(SIZE_PX) - 1) / 2 + noise * random.normal(0, 0.5, 2)
        offs.append(reconstructed_mm(found, [View(0, centre, np.eye(2), pose)])[0] - where_mm)
    return float(np.sqrt(np.mean(np.sum(np.square(offs), axis=1))))


@dataclass(frozen=True)
class ScanScore:
    """Shares of the scans: ζ within 2.5 of its sigmas; of all eight parameters: within one."""

    scans: int
    zeta: float
    closed: float
    covered: float
    each: tuple[float, ...]
    points_mm: float
    calibration_mm: float
    accepted: float


def scan_score(found: list[Scanned]) -> ScanScore:
    ratios = np.abs([one.ratios for one in found])
    return ScanScore(
        len(found),
        float(np.mean([abs(one.zeta) < 2.5 for one in found])),
        float(np.mean([abs(one.closed) < 2.5 for one in found])),
        float(np.mean(ratios < 1)),
        tuple(float(value) for value in np.mean(ratios < 1, axis=0)),
        float(np.sqrt(np.mean([one.points_mm**2 for one in found]))),
        float(np.sqrt(np.mean([one.calibration_mm**2 for one in found]))),
        float(np.mean([one.accepted for one in found])),
    )
