"""Residual of the two paths: measured minus predicted, in the axes of each chain's first picture.

The path is linear in columns that the samples alone tell, with coefficients that the parameters alone set. So what
costs time in proportion to the pictures is done once for all iterations, and blocks of pictures are averaged before.
"""

from functools import cached_property

import numpy as np

from appliance.core.path.samples import PathSamples
from appliance.core.path.steps import picture_steps, products_and_slopes
from appliance.types import Calibration
from drivers.rigid import Array, ComplexArray, rotation_from_vector

ROTATION, SCALE, OFFSET, TAU = slice(0, 3), slice(3, 5), slice(5, 8), 8
"""Of θ (9,): change of the reference in the order of PARAMETERS, and the latency, s."""
VALUE = 9
"""Of `PathResidual.linear`: the residual itself, behind its derivatives by θ."""
_OF_X = np.array([0, 1, 2, 5, 6, 7, VALUE])
"""Rotation, offset and value: what `products_and_slopes` is of."""
_OF_REST = np.zeros((10, 4))
"""Coefficients of the two measured axes, of the rate and of the measured turn, but for their values."""
_OF_REST[[3, 4, TAU], [0, 1, 2]] = 1.0, 1.0, -1.0
LEAST_TRAVEL_MM = 1.0
"""Of the probe along an axis, below which nothing is concluded of its scale: skin drags along with the probe, which no
simulation here shows. A hand that holds still covers .8 mm axially, a fan 1.2 mm (seed 1 of `probewatch study`).
"""

Columns = list[Array | ComplexArray]


class PathResidual:
    """Of the kept pictures of the samples, n, in m blocks."""

    def __init__(self, samples: PathSamples, reference: Calibration, planar: bool) -> None:
        self._samples, self._reference, self._planar = samples, reference, planar
        self._latest: tuple[bytes, Array] | None = None
        self.blocks = samples.blocks
        lateral, axial = reference.polarity
        alpha = samples.alpha_rad[samples.kept] * (lateral * axial)
        x_mm, y_mm = (samples.u_px[samples.kept] * reference.scale_mm_per_px * reference.polarity).T
        self._unturn = np.exp(-1j * alpha)
        seen = self._unturn * np.stack([x_mm, 1j * y_mm])
        moved, turn = samples.steps.moved, samples.steps.turn
        rate = np.zeros((1, len(self.blocks)))
        along = self._path(moved)
        self._positions: Columns = [
            np.concatenate([self._path(self._unturn * moved), self.blocks.means(seen), rate]),
            np.concatenate([along, rate]),
        ]
        """Of the picture plane, complex mm, and out of it."""
        turned = self._path(turn)
        self._angles: Columns = [np.concatenate([turned, rate, self.blocks.means(alpha[None])])]
        if planar:
            self._angles += [np.concatenate([turned, rate]) for _ in range(2)]
        lever, _ = products_and_slopes(*self._moved_to(np.zeros(9)))
        self.elevation_mm = np.asarray(self.blocks.means(np.cumsum(lever[-1, 2] @ moved)))
        """(m,) way of the picture's middle out of its plane, by the tracker and the reference."""

    @classmethod
    def of(cls, samples: PathSamples, reference: Calibration, planar: bool = False) -> "PathResidual":
        """The one of these samples, linear in the latency about the reference. Solution, polarity and sequential test
        ask for the same.
        """
        key = cls, id(reference), planar  # The residual keeps the reference, so its identity is not given to another.
        residual: PathResidual | None = samples.made.get(key)
        if residual is None:
            residual = samples.made[key] = cls(samples, reference, planar)
            residual.linearise_latency(np.zeros(9))
        return residual

    @cached_property
    def parts(self) -> Array:
        """(PARTS, m, m) as `Blocks.parts`; not to be written to."""
        parts = self.blocks.parts(self.elevation_mm)
        parts.flags.writeable = False
        return parts

    def __len__(self) -> int:
        """Pictures."""
        return int(self._unturn.size)

    def linearise_latency(self, theta: Array) -> None:
        """Take the derivative by latency at theta; it changes little with X."""
        self._latest = None
        moved, turned = picture_steps(*self._moved_to(theta), self._samples.rates)
        for row, rate in zip(self._positions, [self._unturn * (moved[0] + 1j * moved[1]), moved[2]], strict=True):
            row[-1] = self._path(rate)
        for row, rate in zip(self._angles, turned[[2, 0, 1]], strict=False):
            row[3] = self._path(rate)

    def linear(self, theta: Array) -> Array:
        """(rows, 10, m): derivatives by θ of every row, and the rows themselves. Measured counts positive.

        Not to be written to: the latest is kept, as each round of a solution begins where the one before ended.
        """
        asked = theta.tobytes()
        if self._latest is None or self._latest[0] != asked:
            rows = self._linear(theta)
            rows.flags.writeable = False
            self._latest = asked, rows
        return self._latest[1]

    def _linear(self, theta: Array) -> Array:
        lever, turned = products_and_slopes(*self._moved_to(theta))
        rest = _OF_REST.copy()
        rest[VALUE] = 1 + theta[3], 1 + theta[4], -theta[TAU], 1.0
        in_plane = _coefficients(lever[:, 0] + 1j * lever[:, 1], rest[:, :3]) @ self._positions[0]
        rows = [in_plane.real, in_plane.imag, _coefficients(turned[:, 2], rest[:, 2:]) @ self._angles[0]]
        if self._planar:
            rows.append(_coefficients(lever[:, 2], rest[:, 2:3]) @ self._positions[1])
            rows += [_coefficients(turned[:, axis], rest[:, 2:3]) @ self._angles[1 + axis] for axis in (0, 1)]
        return np.stack(rows)

    def seen(self, theta: Array) -> Array:
        """(2, m) mm: the measured path, lateral and axial."""
        path = (1 + theta[SCALE]) @ self._positions[0][12:14]
        return np.stack([path.real, path.imag])

    def travel_mm(self, n: int) -> Array:
        """(2,) way that the probe covered laterally and axially over the last n blocks, but for its widest 5 %."""
        at_reference = np.zeros(9)
        predicted = (self.seen(at_reference) - self.linear(at_reference)[:2, VALUE])[:, -n:]
        places = self.blocks.last(n).without_offsets(predicted)
        return np.asarray(np.diff(np.quantile(places, [0.025, 0.975], axis=1), axis=0)[0])

    def _path(self, steps: Array | ComplexArray) -> Array | ComplexArray:
        """(…, n) steps → (…, m) path within each chain, but for an offset of its own."""
        return self.blocks.means(np.cumsum(steps * self._samples.continues, axis=-1))

    def _moved_to(self, theta: Array) -> tuple[Array, Array]:
        turn = rotation_from_vector(theta[ROTATION])
        return turn @ self._reference.rotation, self._reference.offset_mm + theta[OFFSET]


def _coefficients(of_X: Array | ComplexArray, rest: Array) -> Array | ComplexArray:
    """(7, k), (10, l) → (10, k + l)."""
    k = of_X.shape[1]
    coefficients = np.zeros((10, k + rest.shape[1]), of_X.dtype)
    coefficients[_OF_X, :k] = -of_X
    coefficients[:, k:] = rest
    return coefficients
