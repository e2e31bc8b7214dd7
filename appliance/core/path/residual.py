"""Residual of the two paths: measured minus predicted, step by step, in the axes of each chain's first picture.

The steps are linear in columns that the samples alone tell, with coefficients that the parameters alone set. So what
costs time in proportion to the pictures, whitening above all, is done once for all iterations.
"""

import numpy as np

from appliance.core.path.noise import Noise, Whitener
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
_AGREEMENT_LAG_S = 0.5
"""Over which the two paths are compared. Shorter, tracker noise spoils the correlation of good calibrations; longer,
few steps are independent in a window of 3.5 s. Not measured.
"""
_LEAST_MOVED_MM = 0.2
"""Standard deviation of those steps along an axis, below which it has not moved and its correlation would be noise."""

Rows = list[Array | ComplexArray]
"""One array for each row of the residual: position in the picture plane, mm, complex, and turn in that plane, rad.
Where the motion is known to be planar, elevational position follows the one, and the two tilts follow the other.
"""


class PathResidual:
    """Of the kept pictures of the samples, n; the first step of each chain means nothing."""

    def __init__(self, samples: PathSamples, reference: Calibration, planar: bool) -> None:
        self._samples, self._reference, self._planar = samples, reference, planar
        lateral, axial = reference.polarity
        alpha = samples.alpha_rad[samples.kept] * (lateral * axial)
        x_mm, y_mm = (samples.u_px[samples.kept] * reference.scale_mm_per_px * reference.polarity).T
        self._unturn = np.exp(-1j * alpha)
        self._seen = self._unturn * np.stack([x_mm, 1j * y_mm])
        """(2, n) mm: times the scales it is the path of the picture's centre, but for its sign."""
        moved, turn, rate = samples.steps.moved, samples.steps.turn, np.zeros((1, alpha.size))
        self._positions: Rows = [np.concatenate([self._unturn * moved, _steps(self._seen), rate])]
        self._angles: Rows = [np.concatenate([turn, rate, _steps(alpha[None])])]
        if planar:
            self._positions += [np.concatenate([moved, rate])]
            self._angles += [np.concatenate([turn, rate]) for _ in range(2)]

    def __len__(self) -> int:
        return int(self._unturn.size)

    def linearise_latency(self, theta: Array) -> None:
        """Take the derivative of the steps by latency at theta; it changes little with X."""
        moved, turned = picture_steps(*self._moved_to(theta), self._samples.rates)
        for row, rate in zip(self._positions, [self._unturn * (moved[0] + 1j * moved[1]), moved[2]], strict=False):
            row[-1] = rate
        for row, rate in zip(self._angles, turned[[2, 0, 1]], strict=False):
            row[3] = rate

    def steps(self, theta: Array) -> Rows:
        """(n,) of each row."""
        rows = zip(self._coefficients(theta), self._positions + self._angles, strict=True)
        return [coefficients[VALUE] @ columns for coefficients, columns in rows]

    def innovations(self, rows: Rows, whiten: Whitener) -> Rows:
        """Rows of steps or columns (…, n) → (…, m) of unit variance."""
        positions = len(self._positions)
        return [whiten.positions(row) for row in rows[:positions]] + [whiten.angles(row) for row in rows[positions:]]

    def whitened(self, whiten: Whitener) -> Rows:
        """For `linear`."""
        return self.innovations(self._positions + self._angles, whiten)

    def linear(self, theta: Array, whitened: Rows) -> Array:
        """(10, m): derivatives by θ of the innovations of all rows, and the innovations themselves."""
        rows = zip(self._coefficients(theta), whitened, strict=True)
        return side_by_side([coefficients @ columns for coefficients, columns in rows])

    def log_volume(self, whiten: Whitener) -> float:
        """log det of the covariance of the steps."""
        real_positions = len(self._positions) + 1
        return real_positions * whiten.position_log_volume + len(self._angles) * whiten.angle_log_volume

    def noise(self, steps: Rows) -> Noise:
        """Of the residual path."""
        in_plane, turn = steps[0], steps[len(self._positions)]
        return self._samples.times.estimated_noise(np.cumsum(in_plane), np.cumsum(turn))

    def agreement(self, theta: Array) -> float:
        """Correlation of the measured with the predicted in-plane path over about half a second, worse moving axis."""
        times = self._samples.times
        missed_path = np.cumsum(self.steps(theta)[0])
        measured = (1 + theta[SCALE]) @ self._seen
        lag = max(1, min(round(_AGREEMENT_LAG_S / times.period_s), len(self) // 3))
        same = times.quiet(lag)
        moved = (measured[lag:] - measured[:-lag])[same]
        missed = (missed_path[lag:] - missed_path[:-lag])[same]
        axes = [(moved.real, missed.real), (moved.imag, missed.imag)]
        agreed = [_correlation(way, way - left) for way, left in axes if len(way) > 2 and way.std() > _LEAST_MOVED_MM]
        return min(agreed, default=float("nan"))

    def _moved_to(self, theta: Array) -> tuple[Array, Array]:
        turn = rotation_from_vector(theta[ROTATION])
        return turn @ self._reference.rotation, self._reference.offset_mm + theta[OFFSET]

    def _coefficients(self, theta: Array) -> Rows:
        """(10, k) for the k columns of each row. Measured counts positive, predicted negative."""
        lever, turned = products_and_slopes(*self._moved_to(theta))
        rest = _OF_REST.copy()
        rest[VALUE] = 1 + theta[3], 1 + theta[4], -theta[TAU], 1.0
        in_plane = _coefficients(lever[:, 0] + 1j * lever[:, 1], rest[:, :3])
        turn = _coefficients(turned[:, 2], rest[:, 2:])
        if not self._planar:
            return [in_plane, turn]
        rate = rest[:, 2:3]
        tilts = [_coefficients(turned[:, axis], rate) for axis in (0, 1)]
        return [in_plane, _coefficients(lever[:, 2], rate), turn, *tilts]


def _coefficients(of_X: Array | ComplexArray, rest: Array) -> Array | ComplexArray:
    """(7, k), (10, l) → (10, k + l)."""
    k = of_X.shape[1]
    coefficients = np.zeros((10, k + rest.shape[1]), of_X.dtype)
    coefficients[_OF_X, :k] = -of_X
    coefficients[:, k:] = rest
    return coefficients


def _steps(path: Array | ComplexArray) -> Array | ComplexArray:
    """(k, n) → (k, n), the first zero."""
    steps = np.zeros_like(path)
    np.subtract(path[:, 1:], path[:, :-1], out=steps[:, 1:])
    return steps


def side_by_side(rows: Rows) -> Array:
    """(…, m) of all rows, the picture plane as lateral and axial."""
    return np.concatenate([rows[0].real, rows[0].imag, *rows[1:]], axis=-1)


def _correlation(a: Array, b: Array) -> float:
    a, b = a - a.mean(), b - b.mean()
    scale = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / scale if scale > 0 else float("nan")
