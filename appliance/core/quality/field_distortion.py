"""Poses that are bent with the place: metal in the field of a tracker, or a camera that is out of adjustment.

Over a few centimetres such an error grows in proportion to the way, and so do what the picture shows to be displaced
and turned: slopes of the lateral and axial path and of the turn along each axis, but for the two that are a scale. A
calibration that is wrong bends nothing; so what is weighed is whether slopes explain motion that no calibration does
(docs/method.md, section 10).
"""

import numpy as np

from appliance.core.quality.bounded_fit import ANYTHING, VALUE_ROW, Fit, anywhere, exact, fitted
from appliance.core.quality.innovations import INFLATED, Innovations
from appliance.limits import WITHDRAWN_NATS
from appliance.types import Check, Fault, VerdictKind
from drivers.rigid import Array

FINDS = (Fault.FIELD_DISTORTION,)

NAME = "field-distortion"
_LEAST_BLOCKS = 40
"""Of a tenth of a second. Less is asked of in vain: 3 mm of metal's error are at 6 nats after 7 s of the gesture."""
_LEAST_TRAVEL_MM = 4.0
"""Along an axis of the picture, but for the widest 5 %. Over less, a breath passes for slopes: a breathing hold reached
28 nats over 1 mm (`probewatch study`, seed 2)."""
DOUBTED_NATS = WITHDRAWN_NATS + 3.5
"""From which the OK is withdrawn: half a nat for each of seven slopes, which they gain by chance. Metal's error of
3 mm from the start of a gesture reached 18 to 20; healthy scanning: docs/known-anomalies.md."""
_SLOPES = np.diag(np.repeat([0.05, np.deg2rad(0.05)], [4, 3]) ** -2.0)
"""(7, 7): information before any motion is seen, of slopes of .05 and .05°/mm: what metal makes that displaces a
probe by 6 mm from 80 mm away (tools/study/metal.py). With .15 and .5°/mm healthy carts were accused, of slopes of .25
and .48/mm."""
_LEFT_OUT, _OUTLYING = 3, 8.0
"""Blocks at most, and standard deviations from which one is left out of both fits: a field bends every block, and a
single pose 50 mm away, which without it makes 12 nats, is no evidence. More tells metal later that comes suddenly."""
_HELD_NS = 1_000_000_000
"""For which it must last: four solutions. Less lets one bad window name it, more names it later; the OK is withdrawn
before either."""
_EVERY_NS, _WORTH_NATS = 1_000_000_000, 6.0
"""So often it is asked for, and from so many nats with every solution: the question takes 3 ms of processor time, a
third of what the sequential test takes without it. More seldom withdraws the OK later."""


def distortion_nats(rows: Innovations) -> float | None:
    """By how much slopes and the best calibration, wherever it is, explain the window better than that calibration
    alone; None of a window that is too short to tell, or in which the probe covers too little.
    """
    n = len(rows)
    if n < _LEAST_BLOCKS or rows.travel_mm(n).max() < _LEAST_TRAVEL_MM:
        return None
    # Both fits are of one linear model, about the best calibration: with another scale the measured path is as much
    # longer, breathing and all, and slopes would gain by taking the place of that scale.
    theta = exact(lambda theta: rows.at(theta, n), *anywhere(), ANYTHING).theta
    linear, about, rigid = _without_outliers(rows, theta)
    slopes = rows.slopes()
    known, count = len(about), len(about) + len(slopes)
    prior = np.zeros((count, count))
    prior[:known, :known], prior[known:, known:] = _prior(known), _SLOPES
    about = np.append(about, np.zeros(len(slopes)))
    bent = fitted(np.vstack([linear[:-1], slopes, linear[-1:]]), about, *anywhere(count), prior)
    return max(0.0, 0.5 * (rigid.cost - bent.cost) / _spread(bent, n))


def _without_outliers(rows: Innovations, theta: Array) -> tuple[Array, Array, Fit]:
    """Rows linear about theta (12,), and theta, both with a displacement of its own for each block that the best
    calibration explains too badly; and that calibration.
    """
    linear, about = rows.at(theta, len(rows)), theta
    fit = fitted(linear, about, *anywhere(len(about)), _prior(len(about)))
    for _ in range(_LEFT_OUT):
        left = np.abs(linear[-1] + (fit.theta - about) @ linear[:-1]).reshape(-1, len(rows))
        if left.max() < _OUTLYING:
            break
        displaced = rows.displaced(int(left.max(axis=0).argmax()))
        linear = np.vstack([linear[:-1], displaced, linear[-1:]])
        about = np.append(about, np.zeros(len(displaced)))
        fit = fitted(linear, about, *anywhere(len(about)), _prior(len(about)))
    return linear, about, fit


def _prior(count: int) -> Array:
    """(count, count): as ANYTHING, and next to nothing of the displacements."""
    prior = np.eye(count) * 1e-6
    prior[:VALUE_ROW, :VALUE_ROW] = ANYTHING
    return prior


def _spread(fit: Fit, n: int) -> float:
    """Mean square of what is left, not less than what every variance is inflated by."""
    return max(INFLATED, fit.cost / max(3 * n - fit.theta.size, 1) / 0.954)


class FieldDistortion:
    """check: FAULT once named_nats have lasted; from DOUBTED_NATS on NOT_VERIFIED, which withholds the OK; else None.
    nats: of the latest solution that could tell.

    Only motion ends it: until some that is not bent fills the window, what was seen or named stands.
    """

    def __init__(self, named_nats: float) -> None:
        self.check: Check | None = None
        self.nats = 0.0
        self._named_nats = named_nats
        self._since_ns: int | None = None
        self._asked_ns: int | None = None

    def due(self, now_ns: int) -> bool:
        """Whether `distortion_nats` is to be asked for by the solution at now_ns."""
        lately = self._asked_ns is not None and 0 <= now_ns - self._asked_ns < _EVERY_NS
        return self.nats >= _WORTH_NATS or not lately

    def note(self, nats: float | None, now_ns: int, explained: bool) -> None:
        """Of the solution at now_ns. explained: a calibration that is wrong is named, which looks bent while it creeps;
        nothing is named beside it.
        """
        self._asked_ns = now_ns
        named = self.check is not None and self.check.verdict is VerdictKind.FAULT
        if nats is None or nats < self._named_nats or (explained and not named):
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = now_ns
        if nats is None:
            return
        self.nats = nats
        held = self._since_ns is not None and now_ns - self._since_ns >= _HELD_NS
        kind = VerdictKind.FAULT if held or named else VerdictKind.NOT_VERIFIED
        seen = Check(NAME, Fault.FIELD_DISTORTION, nats, 0.0, "nat", self._named_nats, kind)
        self.check = seen if nats >= DOUBTED_NATS else None
