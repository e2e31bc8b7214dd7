"""Figure 4 of the paper: recovered λ_x and λ_y against the number of frames, for each step d and for the keyframe
chain."""

from collections.abc import Callable, Iterator

import numpy as np

from probewatch.appliance.core.handeye.motions import HandEye, Motions
from probewatch.appliance.core.handeye.scaled_rotation import solve_scaled_rotation
from probewatch.appliance.core.path.samples import PathSamples
from probewatch.appliance.core.path.solver import Prior, solve
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array, rotation_from_vector
from tests.paper.matching import Pairs, first, first_pictures, keyframe_chain
from tests.paper.solvers.norm_constraint import solve_norm_constraint
from tests.paper.sweeps import SCALE, SIZE_PX, Sweep, X, sweep

STEPS = (1, 3, 5, 10, 20, 30, 40)
FRAMES = np.arange(4, 101, 2)
_FIRST_HEADING_DEG, _LAST_HEADING_DEG, _TURNED_BY = 80.0, 5.0, 70
_WITHIN = 0.10
CHAIN = "keyframes"

Curves = dict[str, Array]
"""Name of a method → (len(FRAMES), 2) λ in mm per px, NaN where there is no answer yet."""


def curves(seed: int, position_mm: float) -> Iterator[tuple[str, Array]]:
    """Every method on one sweep that sets out axially and turns lateral within 70 frames."""
    headings = np.interp(np.arange(FRAMES[-1]), [0, _TURNED_BY], [_FIRST_HEADING_DEG, _LAST_HEADING_DEG])
    seen = sweep(seed, headings, position_mm)
    pairs = Pairs(seen)
    for d in STEPS:
        motions = pairs.apart(d)
        yield f"norm d={d}", _by_frames(solve_norm_constraint, motions, d)
        yield f"linear d={d}", _by_frames(solve_scaled_rotation, motions, d)
    yield CHAIN, _by_chain(seen)


def _by_frames(method: Callable[[Array, Array], HandEye], motions: Motions, d: int) -> Array:
    found = np.full((len(FRAMES), 2), np.nan)
    for row, frames in enumerate(FRAMES):
        given = first(motions, frames - d)
        if frames - d < 2:
            continue
        try:
            found[row] = method(given.u, given.t_b).scale
        except ValueError:
            continue
    return found


def _by_chain(seen: Sweep) -> Array:
    """The service's solver from a reference that is 5° and 10 % off, told that the motion is planar."""
    turn = rotation_from_vector(np.deg2rad([3.0, -3.0, 3.0]))
    reference = Calibration(turn @ X[:3, :3], (1, 1), SCALE * [1.1, 0.9], X[:3, 3], SIZE_PX)
    prior = Prior(planar=True, offset_mm=2.0, latency_s=0.002)
    samples = keyframe_chain(seen)
    found = np.full((len(FRAMES), 2), np.nan)
    for row, frames in enumerate(FRAMES):
        found[row] = _scale(first_pictures(samples, int(frames)), reference, prior)
    return found


def _scale(samples: PathSamples, reference: Calibration, prior: Prior) -> Array:
    try:
        calibration = solve(samples, reference, prior).calibration
    except ValueError:
        return np.full(2, np.nan)
    return calibration.scale_mm_per_px


def converged_after(curve: Array) -> Array:
    """(2,) number of frames from which on λ stays within 10 %; NaN where it never does."""
    good = np.abs(curve / SCALE - 1) < _WITHIN
    last_bad = np.array([np.flatnonzero(~good[:, axis])[-1] if not good[:, axis].all() else -1 for axis in (0, 1)])
    return np.array([FRAMES[row + 1] if row + 1 < len(FRAMES) else np.nan for row in last_bad], dtype=float)


def worst_axis_rms_percent(found: list[Array]) -> Array:
    """(len(FRAMES),) over sweeps: RMS of the worse axis's error; NaN where any sweep gave no answer."""
    error = np.abs(np.stack(found) / SCALE - 1).max(axis=2)
    return np.asarray(100 * np.sqrt(np.mean(error**2, axis=0)))
