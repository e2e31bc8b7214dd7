"""Estimates the calibration from closed forms, independently of the service's own estimate: without reference, prior or
whitening.

The service fits near its reference. Where X is far from it (a sensor mounted at a right angle, the file of another
probe), that fit may not converge; the closed forms find X nevertheless. Only the lever arm is taken from the reference.
Steps of `_STEP_S` are long compared with tracker noise. The spread is a jackknife estimate: each block of `_BLOCK_S` is
left out in turn.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.handeye.freehand import freehand
from probewatch.appliance.core.handeye.motions import HandEye, Motions, nearest_polarity
from probewatch.appliance.core.handeye.scaled_rotation import scaled_rotation
from probewatch.appliance.core.handeye.sums import Sums
from probewatch.appliance.core.path.samples import PathSamples
from probewatch.appliance.core.registration.keyframe import warp_matrix
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array, vector_from_rotation

_STEP_S = 0.7
"""Length of the steps, s. Long steps suffer least from tracker noise, which these forms do not model; longer ones are
fewer, and leave the chain of keyframes more often. Not varied by itself.
"""
_BLOCK_S = 1.4
"""Length of the block that is left out at once, s: two steps, so that blocks hardly share motion. A longer one leaves
fewer blocks from which to estimate the spread.
"""
_LEAST_BLOCKS, _LEAST_PAIRS = 4, 40
"""Least number of blocks, and of pairs. Fewer blocks give no spread. The pairs overlap: 40 at 30 Hz are only two steps
of motion.
"""


@dataclass(frozen=True, slots=True, eq=False)
class SecondOpinion:
    """Holds the closed-form estimate.

    `form` names the method that fitted the motion, "freehand" or "planar". `sigma` is (5,): rotation in rad, relative
    scale.
    """

    form: str
    rotation: Array
    polarity: tuple[int, int]
    scale_mm_per_px: Array
    sigma: Array
    pairs: int


def second_opinion(samples: PathSamples, reference: Calibration) -> SecondOpinion | None:
    """Estimates the calibration from the path of one session; None where the path does not determine X."""
    try:
        lag = max(1, round(_STEP_S / samples.period_s))
    except ValueError:
        return None
    chain = samples.chain[samples.kept]
    starts = np.flatnonzero(chain[lag:] == chain[:-lag])
    if len(starts) < _LEAST_PAIRS:
        return None
    u, v, t_s = _pairs(samples, reference, starts, lag)
    block = np.floor((t_s - t_s[0]) / _BLOCK_S)
    parts = [Sums.of(u[block == name], v[block == name]) for name in np.unique(block)]
    if len(parts) < _LEAST_BLOCKS:
        return None
    for form, solve in (("freehand", freehand), ("planar", scaled_rotation)):
        try:
            whole = solve(_added(parts))
            without = [solve(_added([part for part in parts if part is not left_out])) for left_out in parts]
        except ValueError:
            continue
        found, polarity = nearest_polarity(whole, reference.rotation)
        return SecondOpinion(form, found.rotation, polarity, found.scale, _jackknife(whole, without), len(starts))
    return None


def _pairs(
    samples: PathSamples, reference: Calibration, first: NDArray[np.intp], lag: int
) -> tuple[Array, Array, Array]:
    """Returns u (n, 2) px, v (n, 3) mm and time (n,) s of each pair of pictures that are `lag` apart."""
    kept = np.flatnonzero(samples.kept)
    i, j = kept[first], kept[first + lag]
    aspect = float(reference.scale_mm_per_px[1] / reference.scale_mm_per_px[0])
    alpha = samples.alpha_rad[j] - samples.alpha_rad[i]
    turned = np.stack([warp_matrix(a, aspect) @ u for a, u in zip(alpha, samples.u_px[i], strict=True)])
    motions = Motions.of_pictures(samples.u_px[j] - turned, alpha, samples.poses[i], samples.poses[j])
    return motions.u, motions.displacements(reference.rotation.T @ reference.offset_mm), samples.t_s[i]


def _added(parts: list[Sums]) -> Sums:
    return Sums(
        sum(p.weight for p in parts),
        np.sum([p.uu for p in parts], axis=0),
        np.sum([p.uv for p in parts], axis=0),
        np.sum([p.vv for p in parts], axis=0),
    )


def _jackknife(whole: HandEye, without: list[HandEye]) -> Array:
    """Returns the standard deviations, (5,), of rotation, rad, and relative scale."""
    away = np.array(
        [
            np.concatenate([vector_from_rotation(w.rotation @ whole.rotation.T), w.scale / whole.scale - 1])
            for w in without
        ]
    )
    n = len(without)
    return np.asarray(np.sqrt((n - 1) / n * np.sum((away - away.mean(axis=0)) ** 2, axis=0)))
