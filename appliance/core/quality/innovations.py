"""Computes the innovations of what picture and tracker report, newest first.

In that order the whitened values of the last seconds do not depend on what came before, so that one factorisation
serves every start of the sequential test.
"""

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtri

from probewatch.appliance.core.path.blocks import AXIAL, BREATHING, LATERAL
from probewatch.appliance.core.path.huber import HUBER
from probewatch.appliance.core.path.noise import Noise, covariances
from probewatch.appliance.core.path.residual import NOTHING, SCALE, TAU, VALUE, PathResidual
from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.quality.bounded_fit import ANYTHING, INFLATED, VALUE_ROW
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array


class Innovations:
    """Holds the innovations of the rows and of their derivatives, newest first.

    breathing_mm: standard deviation of the breathing that is allowed for, along the axis that has more.
    """

    def __init__(self, window: PathWindow, reference: Calibration, noise: Noise, lag_s: float) -> None:
        self._samples = window.samples(lag_s)
        self._residual = PathResidual.of(self._samples, reference)
        self.breathing_mm = float(np.sqrt(noise.variances[:, BREATHING].max()))
        known = covariances(self._residual.blocks, self._residual.parts, noise) + self._residual.given
        backwards = known[:, ::-1, ::-1]
        self._whitening = [_whitening(C) for C in backwards]
        t_s = self._residual.blocks.t_s
        self._drift = [(W @ (t_s - t_s[-1])[::-1])[None] for W in self._whitening]
        self._at_reference = self._white(np.zeros(VALUE_ROW), len(self))

    def __len__(self) -> int:
        """Returns the number of blocks."""
        return len(self._residual.blocks)

    def start_ns(self, n: int) -> int:
        """Returns the stamp of the first of the last n blocks."""
        return self._samples.stamp_ns(float(self._residual.blocks.t_s[-n]))

    @property
    def rigid(self) -> bool:
        """Returns whether the tissue does not give way."""
        return self._residual.rigid

    @property
    def is_informative(self) -> bool:
        """Returns `PathResidual.is_informative`."""
        return self._residual.is_informative

    def travel_mm(self, n: int) -> Array:
        """Returns `PathResidual.travel_mm` of the last n blocks, (2,)."""
        return self._residual.travel_mm(n)

    def score(self, n: int) -> float:
        """Returns the score of the last n blocks against the reference, nat, to first order."""
        white = self.at_reference(n)
        slope = white[:VALUE_ROW] @ np.clip(white[VALUE_ROW], -HUBER, HUBER)
        information = white[:VALUE_ROW] @ white[:VALUE_ROW].T + ANYTHING
        return 0.5 * float(slope @ np.linalg.solve(information, slope)) / INFLATED

    def at_reference(self, n: int) -> Array:
        """Returns the innovations of the last n blocks at the reference, (13, 3 n)."""
        return self._at_reference[:, :, :n].reshape(VALUE_ROW + 1, -1)

    def at(self, theta: Array, n: int) -> Array:
        """Returns the same, (13, 3 n), linear about theta, (12,)."""
        return self._white(theta, n).reshape(VALUE_ROW + 1, -1)

    def slopes(self) -> Array:
        """Returns the derivatives of all blocks, (7, 3 m), by what each row gains with the predicted way, lateral,
        axial and out of the plane; 1 and rad/mm. The growth of the lateral way with itself, and of the axial way with
        itself, is a scale and is left out.
        """
        ways = np.vstack([self._residual.way_mm, self._residual.elevation_mm])[:, ::-1]
        rows = len(self._whitening)
        white = np.zeros((rows, len(ways), rows, len(self)))
        for k, W in enumerate(self._whitening):
            white[k, :, k] = ways @ W.T
        every = white.reshape(rows * len(ways), -1)
        return np.delete(every, [LATERAL * len(ways) + LATERAL, AXIAL * len(ways) + AXIAL], axis=0)

    def latency_ramp(self, theta: Array) -> Array:
        """Returns the derivative of all blocks, (1, 3 m), by a latency that grows with time, 0 at the newest; 1/s."""
        t_s = self._residual.blocks.t_s
        grown = (self._linear(theta)[:, TAU] * (t_s - t_s[-1]))[:, ::-1]
        return np.concatenate([W @ row for row, W in zip(grown, self._whitening, strict=True)])[None]

    def displaced(self, k: int) -> Array:
        """Returns the derivatives of all blocks, (3, 3 m), by a displacement of the k-th block, one for each row; 1/mm
        and 1/rad.
        """
        rows = len(self._whitening)
        white = np.zeros((rows, rows, len(self)))
        for row, W in enumerate(self._whitening):
            white[row, row] = W[:, k]
        return white.reshape(rows, -1)

    def _white(self, theta: Array, n: int) -> Array:
        """Returns the whitened innovations of the last n blocks, (13, 3, n), linear about theta."""
        newest = self._linear(theta)[:, :, ::-1][:, :, :n]
        white = np.zeros((VALUE_ROW + 1, len(newest), n))
        for k, (row, W) in enumerate(zip(newest, self._whitening, strict=True)):
            rows = row @ W[:n, :n].T
            white[: TAU + 1, k], white[VALUE_ROW, k] = rows[: TAU + 1], rows[VALUE]
            white[TAU + 1 + k, k] = self._drift[k][0, :n]
            white[VALUE_ROW, k] += theta[TAU + 1 + k] * white[TAU + 1 + k, k]
        return white

    def _linear(self, theta: Array) -> Array:
        """Returns the rows of the residual, (3, 13, m), linear about theta. The lateral scale is regressed on the
        predicted path, because tissue moves the measured one.
        """
        theta = np.append(theta[: TAU + 1], np.zeros(NOTHING.size - TAU - 1))
        linear = self._residual.linear(theta).copy()
        rows = [LATERAL, AXIAL] if self._residual.rigid else [LATERAL]
        predicted = self._residual.seen(theta)[rows] - linear[rows, VALUE]
        linear[rows, [SCALE.start + k for k in rows]] = predicted
        return linear


def _whitening(covariance: Array) -> Array:
    factor, refused = dpotrf(covariance, lower=True, clean=True)
    if refused:
        raise ValueError("the noise of the path leaves its covariance not positive definite")
    return np.asarray(dtrtri(factor, lower=True)[0])
