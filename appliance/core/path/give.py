"""Whether the tissue under the probe gives way, by what its motion shows (docs/method.md, section 7)."""

from collections.abc import Sequence

import numpy as np

from appliance.core.path.steps import SensorSteps, picture_steps
from appliance.types import DRAGS, PRESSES, Calibration, Motion
from drivers.rigid import Array

_TILT = 0.08
"""By how much the share of a turn that ∂u_y/∂x shows is from 1 at most, two sigmas included, for tissue that follows no
press. More counts a press in tissue that follows by so much, and as large an error of the axial scale; less asks for
more motion. Below twice the limit of a scale. In rigid tissue 1.004 ± .003 was seen, in soft .33 to .42 (gesture, seed
1)."""
_DRAG = 0.15
"""By what share of the probe's lateral way the skin goes along at most, likewise, for skin that does not drag. In rigid
tissue −.01 ± .01 was seen, where the skin sticks for 3 mm −.5 ± .06 (gesture, in-plane, seed 1)."""
_APART_S = 0.3
"""Between the middles of the blocks of pictures that tell it: as long as a hand's tremor turns one way."""
_LEAST_STEPS = 6
"""Of them; the sigma of fewer is no measure. Not varied."""


def may_do(before: int, seen: Sequence[Motion], poses: Array, reference: Calibration) -> int:
    """What the tissue may do, as bits: as before, until the motion shows otherwise. It follows no press where the
    picture tilts as the tracker turned, and its skin does not drag where it does not go along with the probe.

    seen: with the path of tissue each. poses: (n, 4, 4) sensor → tracker at their times.
    """
    if len(seen) < _LEAST_STEPS:
        return before
    t_s = np.array([motion.stamp.t_ns for motion in seen]) / 1e9
    block = np.cumsum(np.diff(t_s // _APART_S, prepend=0) != 0) - 1
    chain = np.array([motion.chain for motion in seen])
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    whole = np.maximum.reduceat(chain, starts) == np.minimum.reduceat(chain, starts)
    same = (np.diff(chain[starts]) == 0) & whole[1:] & whole[:-1]
    if same.sum() < _LEAST_STEPS:
        return before
    tissue = [motion.tissue for motion in seen if motion.tissue is not None]
    pictures = np.diff(starts, append=len(seen))

    def steps(path: Array) -> Array:
        """Of the means of blocks, as pictures err one by one."""
        return np.asarray(np.diff(np.add.reduceat(path, starts) / pictures)[same])

    moved, turned = picture_steps(reference.rotation, reference.offset_mm, SensorSteps.between(poses))
    lateral, axial = reference.polarity
    tilt_rad = steps(np.array([path.tilt_rad for path in tissue])) * lateral * axial
    if _may_be_other(bool(before & PRESSES), 1.0, _TILT, steps(np.cumsum(turned[2])), tilt_rad):
        return DRAGS | PRESSES
    drag_mm = steps(np.array([path.drag_px[DRAGS] for path in tissue])) * lateral * reference.scale_mm_per_px[0]
    return DRAGS * _may_be_other(bool(before & DRAGS), 0.0, _DRAG, steps(np.cumsum(moved[0])), drag_mm)


def _may_be_other(before: bool, due: float, most: float, told: Array, seen: Array) -> bool:
    """Whether `seen` may go along with `told` by a share that is further from the one that is due; as before where the
    motion does not say."""
    square = float(told @ told)
    if square == 0.0:
        return before
    share = float(told @ seen) / square
    sigma = float(np.sqrt(np.mean(np.square(seen - share * told)) / square))
    beyond = abs(share - due) - most
    return beyond > -2 * sigma if before else beyond > 2 * sigma
