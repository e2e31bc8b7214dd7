"""Table 1 of the paper: rotation and scales of five data sets of four motions, the fifth with its picture flipped."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from probewatch.appliance.core.handeye.motions import Motions, nearest_polarity, rodrigues_rad
from probewatch.appliance.core.handeye.scaled_rotation import solve_scaled_rotation
from probewatch.drivers.rigid import Array
from tests.paper.matching import Pairs
from tests.paper.solvers.norm_constraint import solve_norm_constraint
from tests.paper.sweeps import X, sweep

PAPER = (
    (3.163, 0.22, 0.26),
    (3.072, 0.23, 0.26),
    (2.992, 0.23, 0.27),
    (3.008, 0.23, 0.29),
    (0.086, 0.24, 0.27),
)
"""Magnitude of the Rodrigues vector, λ_x, λ_y in mm per px."""

STEP = 10
_FRAMES_PER_MOTION = 66
_HEADINGS_DEG = (0.0, 90.0, 45.0, 135.0)


@dataclass(frozen=True, eq=False)
class Row:
    """norm: (3,) by the norm constraint and Horn, as in the paper; linear: (3,) by the scaled rotation; |Rodrigues|,
    λ_x, λ_y. polarity: that the linear answer is nearest with.
    """

    norm: Array
    linear: Array
    polarity: tuple[int, int]


def rows() -> Iterator[Row]:
    """The five data sets, one after the other."""
    for number in range(5):
        headings = np.repeat(np.roll(_HEADINGS_DEG, number), _FRAMES_PER_MOTION)
        motions = _within(Pairs(sweep(number + 1, headings, flipped=number == 4)).apart(STEP))
        norm, linear = (_three(solve, motions) for solve in (solve_norm_constraint, solve_scaled_rotation))
        _, polarity = nearest_polarity(solve_scaled_rotation(motions.u, motions.t_b), X[:3, :3])
        yield Row(norm, linear, polarity)


def _within(motions: Motions) -> Motions:
    """Pairs that do not straddle a change of direction: each sweep of the paper was one motion."""
    kept = np.arange(len(motions)) % _FRAMES_PER_MOTION < _FRAMES_PER_MOTION - STEP
    return Motions(motions.u[kept], motions.R_a[kept], motions.R_b[kept], motions.t_b[kept])


def _three(solve: Callable[..., object], motions: Motions) -> Array:
    found = solve(motions.u, motions.t_b)
    return np.array([rodrigues_rad(found.rotation), *found.scale])  # type: ignore[attr-defined]
