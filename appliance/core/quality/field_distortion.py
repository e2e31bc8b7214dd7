"""Detects poses whose error depends on the place: metal in the field of a tracker, or a camera that is out of
adjustment.

Over a few centimetres such an error grows in proportion to the distance, and so do the displacement and the turn that
the picture shows: as slopes of the lateral and axial path and of the turn along each axis, except the two slopes that
are a scale. A wrong calibration causes no slopes. The test is therefore whether slopes explain motion that no
calibration explains (docs/method.md, section 10).
"""

import numpy as np
from scipy.linalg import block_diag

from probewatch.appliance.core.quality.bounded_fit import ANYTHING, Fit, anywhere, exact, fitted, spread
from probewatch.appliance.core.quality.innovations import Innovations
from probewatch.appliance.core.quality.verification import Contradiction
from probewatch.appliance.core.spread_work import TRIAL, Steps
from probewatch.appliance.core.times import HELD_NS, SELDOM_NS
from probewatch.appliance.limits import WITHDRAWN_NATS
from probewatch.appliance.types import Check, Fault, VerdictKind
from probewatch.drivers.rigid import Array

REPORTS_FAULTS = (Fault.FIELD_DISTORTION,)

NAME = "field-distortion"
_LEAST_BLOCKS = 40
"""The least number of blocks, each a tenth of a second. Fewer cannot show an error of 3 mm from metal, which reaches
6 nats after 7 s of a gesture."""
_LEAST_TRAVEL_MM = 4.0
"""Least travel of the probe, mm, along an axis of the picture, without the widest 5 %. Over less, a breath passes for
slopes: a breathing hold reached 28 nats over 1 mm (`probewatch study`, seed 2)."""
_BREATHS = 2.0
"""The number of standard deviations of breathing, as learned, that the probe must have covered as well: 4 mm in quiet
breathing. An organ that moved to and fro by 12 mm obliquely had 4.4 and 6.4 mm, and reached 33 nats over 10 mm
(study, in-plane, seed 2). More misses metal in the field of a patient who breathes deeply; less accuses that patient's
tracker."""
DOUBTED_NATS = WITHDRAWN_NATS + 3.5
"""Evidence, nat, from which the OK is withdrawn. It includes half a nat for each of seven slopes, which they gain by
chance. An error of 3 mm from metal, present from the start of a gesture, reached 18 to 20; docs/known-anomalies.md has
the figures of healthy scanning."""
_CREEP = np.array([[0.01**-2.0]])
"""(1, 1): the information, before any motion is seen, on a latency that grows by 10 ms/s. Such a latency explains bent
poses: without it, one that grew by 100 ms in 8 s was taken for a field in two of three."""
_SLOPES = np.diag(np.repeat([0.05, np.deg2rad(0.05)], [4, 3]) ** -2.0)
"""(7, 7): the same for slopes of .05 and .05°/mm, which metal causes that displaces a probe by 6 mm from 80 mm away
(tools/study/metal.py). With .15 and .5°/mm healthy carts were accused, of slopes of .25 and .48/mm."""
_LEFT_OUT, _OUTLYING = 3, 8.0
"""The maximum number of blocks that are left out of both fits, and the standard deviations from which one is. A field
bends every block; a single pose that is 50 mm away is no evidence, but makes 12 nats unless it is left out. More delays
the report of metal that appears suddenly."""
_WORTH_NATS = 6.0
"""Evidence, nat, from which the test runs with every solution, not only once in `SELDOM_NS`: it takes about as long as
all the rest of the sequential test. More withdraws the OK later."""


def distortion_nats(rows: Innovations) -> Steps[float | None]:
    """Returns by how much, nat, slopes explain the window better than the best calibration alone, whatever that
    calibration is and however its latency drifts. Returns None for a window that is not conclusive: it is too short,
    the probe covers too little, or the tissue gives way, which differs from place to place (21 nats in a healthy
    gesture over a half space).
    """
    n = len(rows)
    least_mm = max(_LEAST_TRAVEL_MM, _BREATHS * rows.breathing_mm)
    if not rows.rigid or n < _LEAST_BLOCKS or rows.travel_mm(n).max() < least_mm:
        return None
    yield TRIAL.of()
    # Both fits use one linear model, about the best calibration: with another scale the measured path, breathing
    # included, is longer by that scale, and slopes would gain by taking its place.
    theta = exact(lambda theta: rows.at(theta, n), *anywhere(), ANYTHING).theta
    linear = rows.at(theta, n)
    value, columns, priors = linear[-1:], [linear[:-1], rows.latency_ramp(theta)], [ANYTHING, _CREEP]
    yield TRIAL.of()
    rigid = _best(columns, value, theta, priors)
    for _ in range(_LEFT_OUT):
        left = np.abs(_left(rigid, columns, value, theta)).reshape(-1, n)
        if left.max() < _OUTLYING:
            break
        columns.append(rows.displaced(int(left.max(axis=0).argmax())))
        priors.append(np.eye(len(columns[-1])) * 1e-6)
        yield TRIAL.of()
        rigid = _best(columns, value, theta, priors)
    # Equation (28b): the same fit once more, with slopes.
    yield TRIAL.of()
    bent = _best([*columns, rows.slopes()], value, theta, [*priors, _SLOPES])
    gain = 0.5 * (rigid.cost - bent.cost) / spread(bent, n)
    return max(0.0, gain) if np.isfinite(gain) else None


def _best(columns: list[Array], value: Array, theta: Array, priors: list[Array]) -> Fit:
    """Finds the best fit of one linear model about theta, (12,); all later values are relative to theta."""
    rows, prior = np.vstack([*columns, value]), block_diag(*priors)
    return fitted(rows, _about(theta, len(prior)), *anywhere(len(prior)), prior)


def _left(fit: Fit, columns: list[Array], value: Array, theta: Array) -> Array:
    """Returns the innovations, (3 n,), that a fit leaves unexplained."""
    return np.asarray(value[0] + (fit.theta - _about(theta, fit.theta.size)) @ np.vstack(columns))


def _about(theta: Array, count: int) -> Array:
    return np.append(theta, np.zeros(count - theta.size))


class FieldDistortion:
    """Keeps the state of the check. `check` is FAULT once the evidence has stayed at or above `named_nats`,
    NOT_VERIFIED from DOUBTED_NATS on, which withholds the OK, and None below. `nats` belongs to the latest solution; it
    is None where that was not conclusive. `until_ns` is the newest motion that looked distorted.

    Only motion ends the state: it stands until a window that lies wholly after that motion shows no distortion.
    """

    def __init__(self, named_nats: float) -> None:
        self.check: Check | None = None
        self.nats: float | None = None
        self.until_ns = 0
        self._named_nats = named_nats
        self._since_ns: int | None = None
        self._asked_ns: int | None = None

    @property
    def contradiction(self) -> Contradiction | None:
        """Returns the contradiction, in the form of that of a parameter, while it stands."""
        check = self.check
        return None if check is None else Contradiction(check, self.until_ns, check.verdict is VerdictKind.FAULT)

    def due(self, now_ns: int) -> bool:
        """Returns whether the solution at `now_ns` should compute `distortion_nats`."""
        lately = self._asked_ns is not None and 0 <= now_ns - self._asked_ns < SELDOM_NS
        return not lately or (self.nats or 0.0) >= _WORTH_NATS

    def lose_sight(self) -> None:
        """Discards the evidence under way but keeps the result, as the contradictions of parameters are kept."""
        self._since_ns = self._asked_ns = self.nats = None

    def predate(self, since_ns: int) -> None:
        """Dates results that rest on motion at or after `since_ns`, which had wrong timestamps, to just before it."""
        self.until_ns = min(self.until_ns, since_ns - 1)

    def note(self, nats: float | None, start_ns: int, now_ns: int, explained: bool) -> bool:
        """Takes the solution at `now_ns`, of motion from `start_ns` on; returns whether it ends an earlier result.

        `explained` is True where a wrong calibration is named, which may look like a distortion; then no distortion is
        named.
        """
        self._asked_ns, self.nats = now_ns, nats
        if nats is None or nats < self._named_nats or explained:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = now_ns
        if nats is not None and nats >= DOUBTED_NATS:
            self.until_ns = now_ns
            self._see(nats, now_ns, explained)
        elif self.check is not None:
            if nats is not None and start_ns > self.until_ns:
                self.check = None
                return True
            self._see(self.check.value, now_ns, explained)
        return False

    def _see(self, nats: float, now_ns: int, explained: bool) -> None:
        """Records the evidence, nat, of the latest motion that looked distorted."""
        held = self._since_ns is not None and now_ns - self._since_ns >= HELD_NS
        named = held or (self.check is not None and self.check.verdict is VerdictKind.FAULT)
        kind = VerdictKind.FAULT if named and not explained else VerdictKind.NOT_VERIFIED
        self.check = Check(NAME, Fault.FIELD_DISTORTION, nats, 0.0, "nat", self._named_nats, kind)
