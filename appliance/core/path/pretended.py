"""Computes spurious information: from the poses, whose noise is in the derivatives as in the path, and from the
tissue's own motion. Unless it is discounted, motion that shows nothing of a parameter would seem to show it
(docs/method.md, section 7).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.path.blocks import AXIAL, LATERAL, TRACKER, TURN
from probewatch.appliance.core.path.noise import LearnedNoise
from probewatch.appliance.core.path.residual import FOLLOW, ROTATION, SCALE
from probewatch.drivers.rigid import Array

_RISES = 2.0
"""Factor by which the information on an offset or a scale must exceed the spurious part before that is taken off:
nearer to it, the difference of the two is noise itself. Not measured.
"""
_FOLLOWED = 30.0
"""Ratio of the information on a scale to the spurious part from the tissue's own motion, below which the scale is not
observed. With breathing it is 2 to 7, without it 40 and more (seed 1 of every session of `probewatch study`).
"""
_CLEAN = 5.0
"""The same ratio where breaths are followed and the tissue's most likely motion is out of the measured path: what is
left of it there biases the scale no more, and only counts as information. Less trusts a scale that a few breaths show,
more asks for longer windows. Not measured.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Pretended:
    """Computes the spurious information on each of θ, by `noise` and `tissue_out` as they are at the call.

    rigid: whether the tissue does not follow the face. tissue_out: (2,) whether the tissue's most likely motion,
    lateral and axial, is out of the measured path. known: (12, 12) information of the prior.
    """

    noise: LearnedNoise
    rigid: bool
    tissue_out: NDArray[np.bool_]
    known: Array

    def information(self) -> Array:
        """Returns the spurious information, (12,), on each of θ: from the noise of the poses, and from the tissue's own
        motion.
        """
        rows, variances = self.noise.rows, self.noise.noise.variances[:, TRACKER]
        position = np.mean(variances[[LATERAL, AXIAL]], axis=0)
        lateral, axial = (rows[k].counted for k in (LATERAL, AXIAL))
        turn = float(rows[TURN].counted @ variances[TURN])
        each = np.stack([axial, lateral, lateral + axial])
        rotations = each @ position + turn * np.array([1.0, 1.0, 0.0])
        offsets = each @ variances[TURN]
        follow = float(axial @ variances[LATERAL])
        axial_scale = self._of_tissue(AXIAL) if self.rigid else turn
        return np.concatenate([rotations, [self._of_tissue(LATERAL), axial_scale], offsets, [0.0, follow, 0.0, 0.0]])

    def excess(self, J: Array) -> Array:
        """Returns the spurious information, (12,), that is taken off; zero where the motion does not rise well above
        it.

        A turn error δ of one pose moves the residual by δ × t_x and its derivative by t_x with it: the offset would
        shrink by the ratio of excess to information (errors in variables), and a scale by what the tissue moves. Where
        the tissue's most likely motion is out of the derivative, what is left of it there is independent of the path.
        """
        pretended = self.information()
        excess = np.where(self._alone(J) > _RISES * pretended, pretended, 0.0)
        excess[ROTATION] = 0.0
        excess[self._axes[self.tissue_out]] = 0.0
        return excess

    def followed(self, J: Array) -> NDArray[np.bool_]:
        """Returns whether the motion shows the lateral scale, and what follows the face, well above the spurious part
        from the tissue's own motion, (2,).
        """
        ratio = np.where(self.tissue_out, _CLEAN, _FOLLOWED)
        pretended = np.array([self._of_tissue(LATERAL), self._of_tissue(AXIAL)])
        return np.asarray(self._alone(J)[self._axes] >= ratio * pretended)

    def _of_tissue(self, k: int) -> float:
        """Returns the spurious information from the tissue's own motion on how much of the probe's displacement row k
        shows.
        """
        row = self.noise.rows[k]
        return row.left_in if self.tissue_out[k] else row.pretended

    def _alone(self, J: Array) -> Array:
        """Returns the information, (12,), on each of θ with all others unknown, less the prior."""
        return np.asarray(1 / np.diag(np.linalg.inv(J @ J.T + self.known)) - np.diag(self.known))

    @property
    def _axes(self) -> NDArray[np.int64]:
        """Returns the indices, (2,), of the parameters that say how much of the probe's displacement the lateral and
        the axial row show.
        """
        return np.array([SCALE.start, SCALE.start + 1 if self.rigid else FOLLOW])
