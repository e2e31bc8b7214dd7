"""Decides whether tissue follows a press of the probe, its skin a slide, or neither (docs/method.md, section 7)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from probewatch.appliance.core.path.residual import LEAST_TURN_RAD
from probewatch.appliance.core.path.steps import SensorSteps, picture_steps
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import DRAGS, PRESSES, Calibration, Motion
from probewatch.drivers.rigid import Array

_TILT = 0.08
"""Largest deviation from 1, two sigmas included, of the share of a turn that ∂u_y/∂x shows, for tissue that follows no
press. More takes tissue that follows by as much for rigid, with as large an error of the axial scale; less asks for
more motion. In rigid tissue 1.004 ± .003 was seen, in soft .33 to .42 (gesture, seed 1).
"""
_DRAG = 0.15
"""Largest share of the face's lateral displacement by which skin moves along, two sigmas included, that counts as no
drag. In rigid tissue −.01 ± .01 was seen, where the skin sticks for 3 mm −.5 ± .06 (gesture, in-plane, seed 1); in
tissue that follows a press .03 to .10 ± .03, and .34 to .58 ± .1 where its skin sticks for 2 mm (gesture, twelve runs).
"""
_MOST_HIDDEN = 0.05
"""Largest share by which tissue that counts as rigid may follow a press; the limit of a scale applies where it is
tighter. The share is 1 less the product of both shares of a turn, by ∂u_y/∂x and by ∂u_x/∂y: a wrong ratio of the
scales divides one by the factor with which it multiplies the other. Where tissue followed by .1 and the axial scale was
10 % too small, the first was 1.00, and the cart was OK (gesture, five runs); the product was .90 to .92 ± .01, over
foam that follows by .05 .92 to .96, and in rigid gestures .985 to 1.021 ± .007 after 4 s. For a turn narrower than
LEAST_TURN_RAD it is evaluated only where the first alone hides twice the limit of a scale: otherwise ordinary motion in
rigid tissue was verified after 8 s instead of 4.
"""
_UNIFORM = 3**0.5
"""Divisor of the largest share that gives the standard deviation of one that motion has not shown: any up to it is as
likely. With 1, ordinary motion was verified after 12 s instead of 4 where no offsets are required (in-plane, seed 1).
"""
_DEEP_MM = 40.0
"""Depth of a picture, mm, from which skin that does not drag is recognised over tissue that follows a press. What is
pressed out sideways biases the shear there by 2 %, in pictures of 21 mm by 5 to 11 %, and a scale was named falsely
(half space of 20 mm); the term of the drag takes it up. 45 mm were tried, and nothing between. More is verified later.
"""
_APART_S = 0.3
"""Time, s, between the middles of the blocks of pictures that show it: as long as a hand's tremor turns one way."""
_MISALIGNED = 0.35
"""Standard deviation of the picture's turn per unit turn of the probe about its lateral or axial axis, as
`Prior.tilt_rad`. More lets noise pass for a share; less takes a wrong rotation, which tilts the axis, for soft tissue:
with .1, another probe was not recognised (gesture, two seeds).
"""
_LEAST_TURN = 0.1
"""Least turn about another axis that is independent of the turn about the elevational one, as a share of that, for the
axis to be considered: with less, the share is known ten times worse. Not varied.
"""
_UNSHOWN_RAD = float(np.deg2rad(Limits().rotation_deg))
"""Standard deviation of the axis, rad, where it is not considered: a rotation beyond its limit is found by its own
check.
"""
_ANY = 10.0
"""Standard deviation of a share about which nothing is supposed."""
_ROUNDS = 3
"""Number of alternations of share and noise: the noise only weights the supposed deviations. Not varied."""
_TINY = 1e-9
"""Used as a divisor instead of zero."""
_LEAST_STEPS = 6
"""Least number of steps between blocks: the sigma of fewer is no measure. Not varied."""


Share = tuple[float, float]
"""Share of one path that another shows, and its sigma."""


class TissueMotion(NamedTuple):
    """Represents what tissue may do.

    may: the bits DRAGS and PRESSES that motion has not excluded; 0 is rigid tissue. follows: the share by which it
    follows a press, and its sigma; tissue that passes for rigid hides as large an error of the axial scale.
    """

    may: int
    follows: Share = (0.0, _MOST_HIDDEN)

    @property
    def surely(self) -> float:
        """Returns the share, less its sigma. A larger value verifies less over rigid tissue, whose share errs by 1.2 %;
        with two sigmas taken off, the contact closed on an axial scale wrong by 8 % over foam that follows by 5 %.
        """
        return max(self.follows[0] - self.follows[1], 0.0)

    @property
    def hides(self) -> float:
        """Returns the relative error of the axial scale that tissue which passes for rigid may hide: the share by which
        it surely follows, and the sigma of that share, .03 after a narrow turn. Without the sigma the contact closed
        for 5 s in 30 on the same scale (in-plane, seeds 1 and 2).
        """
        return 0.0 if self.may & PRESSES else float(np.hypot(self.surely, self.follows[1]))

    def after(self, before: "TissueMotion") -> "TissueMotion":
        """Returns the same, but with the earlier share where tissue counted as rigid before and its share was known
        better.
        """
        kept = not before.may & PRESSES and before.follows[1] < self.follows[1]
        return self._replace(follows=before.follows) if kept else self


def possible_tissue_motion(
    before: int, seen: Sequence[Motion], poses: Array, reference: Calibration, scale_limit: float
) -> TissueMotion:
    """Returns what motion has not excluded; its bits are as before until motion shows otherwise. Tissue follows no
    press where the picture tilts as the tracker turned; skin does not drag where it does not move along with the probe.

    seen: motions, each with the path of tissue. poses: (n, 4, 4) sensor → tracker at their times. scale_limit:
    relative.
    """
    if len(seen) < _LEAST_STEPS:
        return TissueMotion(before)
    # Only steps between blocks that lie within one chain, both whole, count.
    t_s = np.array([motion.stamp.t_ns for motion in seen]) / 1e9
    block = np.cumsum(np.diff(t_s // _APART_S, prepend=0) != 0) - 1
    chain = np.array([motion.chain for motion in seen])
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    whole = np.maximum.reduceat(chain, starts) == np.minimum.reduceat(chain, starts)
    same = (np.diff(chain[starts]) == 0) & whole[1:] & whole[:-1]
    if same.sum() < _LEAST_STEPS:
        return TissueMotion(before)
    tissue = [motion.tissue for motion in seen if motion.tissue is not None]
    pictures = np.diff(starts, append=len(seen))

    def steps(path: Array) -> Array:
        """Returns the steps between the means of blocks: the errors of single pictures average out."""
        return np.asarray(np.diff(np.add.reduceat(path, starts, axis=-1) / pictures)[..., same])

    moved, turned = picture_steps(
        reference.rotation, reference.offset_mm - reference.face_mm, SensorSteps.between(poses)
    )
    lateral, axial = reference.polarity
    tilt_rad = steps(np.array([path.tilt_rad for path in tissue])) * lateral * axial
    turns_rad = steps(np.cumsum(turned, axis=1))
    pressed = bool(before & PRESSES)
    tilt = _share_of_turn(turns_rad, tilt_rad, True)
    tilted = tilt if pressed else _share_of_turn(turns_rad, tilt_rad, False)

    def drags(read_as: int) -> bool:
        drag_px = steps(np.array([path.drag_px[read_as] for path in tissue]))
        drag_mm = drag_px * lateral * reference.scale_mm_per_px[0]
        share, sigma = _share(steps(np.cumsum(moved[0]))[None], drag_mm, np.array([_ANY]))
        return _may_be_other(bool(before & DRAGS), 0.0, _DRAG, share, sigma)

    reading = PRESSES | DRAGS * drags(DRAGS)

    def follows(read_as: int) -> Share:
        """Returns the share by which tissue follows a press, by one reading. Read as drag of the skin as well, tissue
        that follows passes for rigid: a hand that rocks about an oblique axis and hardly slides excludes no drag, and
        the share of the shear is 1.02 ± .04 instead of .94 ± .03.
        """
        shear_rad = steps(np.array([path.path_rad[read_as] for path in tissue])) * lateral * axial
        shear = _share_of_turn(turns_rad, shear_rad, pressed)
        return 1 - tilted[0] * shear[0], float(np.hypot(tilted[0] * shear[1], shear[0] * tilted[1]))

    wide = np.ptp(np.cumsum(turns_rad[2])) >= LEAST_TURN_RAD or 2 * scale_limit <= _TILT
    shares = [follows(read_as) for read_as in ((reading, PRESSES) if pressed else (reading,))]
    most = min(_MOST_HIDDEN, scale_limit)
    presses = _may_be_other(pressed, 1.0, _TILT, *tilt) or bool(
        wide and any(_may_follow(pressed, tilted, share, most) for share in shares)
    )
    if presses and 2 * abs(reference.face_mm[1]) < _DEEP_MM:
        return TissueMotion(DRAGS | PRESSES)
    may = PRESSES * presses | DRAGS * drags(DRAGS | PRESSES * presses)
    late = abs(tilt[0] - 1) > _TILT  # A tracker that lags reduces both shares of a turn.
    return TissueMotion(may) if late else TissueMotion(may, _shrunk(*shares[0], most / _UNIFORM))


def _share_of_turn(turns_rad: Array, seen_rad: Array, doubted: bool) -> Share:
    """Returns the share of the turn about the elevational axis, or about one near it that the motion shows, that
    `seen_rad` (n,) shows. turns_rad: (3, n). doubted: whether the uncertainty of the axis counts. It does not excuse
    tissue that was taken for rigid and whose turn by ∂u_x/∂y shows that it follows.

    A turn about a neighbouring axis is that of a probe held otherwise than the reference states, and no sign of softer
    tissue. Such an axis is looked for only where the probe turns about it independently: of two turns that are
    proportional but for the tracker's noise, the fit takes a mean, which has less noise and is a smaller share. A probe
    whose turns were all proportional was taken for one over soft tissue for as long as that lasted (share .96 ± .002 of
    1; seed 137 of the invariant's cart).
    """
    elevational = turns_rad[2]
    along = turns_rad[:2] @ elevational / max(float(elevational @ elevational), _TINY)
    beside = turns_rad[:2] - np.outer(along, elevational)
    squares, axes = np.linalg.eigh(beside @ beside.T)
    shown = squares >= _LEAST_TURN**2 * float(elevational @ elevational)
    predicted = np.vstack([axes[:, shown].T @ turns_rad[:2], elevational])
    share, sigma = _share(predicted, seen_rad, np.append(np.full(len(predicted) - 1, _MISALIGNED), _ANY))
    unknown = _UNSHOWN_RAD * float(np.linalg.norm(along @ axes[:, ~shown])) if doubted else 0.0
    return share, float(np.hypot(sigma, unknown))


def _share(predicted: Array, seen: Array, supposed: Array) -> Share:
    """Returns the share of `predicted` (k, n), or of a combination of its rows, that `seen` (n,) shows. supposed: (k,)
    standard deviation of each coefficient.
    """
    left = float(np.mean(np.square(seen)))
    for _ in range(_ROUNDS):
        covariance = np.linalg.inv(predicted @ predicted.T / max(left, _TINY) + np.diag(supposed**-2))
        shares = covariance @ predicted @ seen / max(left, _TINY)
        left = float(np.mean(np.square(seen - shares @ predicted)))
    length = float(shares @ shares)
    longer = float(np.trace(covariance))  # Noise lengthens the square by this much on average.
    sigma = np.sqrt(float(shares @ covariance @ shares) / max(length, _TINY))
    return float(np.sqrt(max(length - longer, 0.0))), float(sigma)


def _shrunk(share: float, sigma: float, supposed: float) -> Share:
    """Returns the share and its sigma, shrunk towards zero: before motion shows it, the share is supposed to be zero
    with the standard deviation `supposed`.
    """
    kept = supposed**2 / (supposed**2 + sigma**2)
    return share * kept, sigma * float(np.sqrt(kept))


def _may_be_other(before: bool, due: float, most: float, share: float, sigma: float) -> bool:
    """Returns whether a share may differ from the due one by more than `most`; as before where the motion does not show
    it.
    """
    beyond = abs(share - due) - most
    return beyond > -2 * sigma if before else beyond > 2 * sigma


def _may_follow(before: bool, tilt: Share, share: Share, most: float) -> bool:
    """Returns whether tissue follows by more than `most`; as before where the motion does not show it.

    A tracker that begins to lag reduces both shares of a turn, and then the first is not near 1.
    """
    beyond, sigma = share[0] - most, share[1]
    return beyond > -sigma if before else beyond > 2 * sigma and abs(tilt[0] - 1) <= _TILT
