"""Tracks the error of a point from picture to picture, by what motion last showed and by how the hand moves now."""

from collections import deque
from dataclasses import dataclass, replace
from math import hypot

import numpy as np

from probewatch.appliance.core.parameters import LEFT_OUT, MEASURED
from probewatch.appliance.core.quality.examination import Finding
from probewatch.appliance.core.quality.point_error import Bounds, Change, Places, bounds_at, change_of, slope_of_places
from probewatch.appliance.core.quality.verification import VerificationStatus
from probewatch.appliance.core.times import MOST_APART_NS
from probewatch.appliance.limits import GESTURE_AGE_S, Limits
from probewatch.appliance.types import PARAMETERS, Calibration, Check, Fault, PointError
from probewatch.drivers.rigid import Array, inverse, rigid
from probewatch.drivers.samples import Matrix4

_OVER_NS = 100_000_000
"""Time, ns, over which the speed is measured: with .1 mm of noise it is known to 1.4 mm/s. A longer time shows a jerk
late and only in part; a shorter one takes the tracker's noise for speed."""
_KNOWN_NS = MOST_APART_NS
"""Time, ns, for which a speed stands without a pose: as long as pictures get a pose between two. Longer shows an
outdated speed."""
_ELSE, _ELSE_SHOWN = 3.0, 2.0
"""Standard deviations of the difference by which newer motion may differ from what is kept: in general, and where the
newer motion shows everything itself, so that it can take the place of what is kept. More keeps what has changed since;
fewer drop by chance, until the next gesture, what only a gesture shows. Not varied further."""
_WITHIN_S = 30.0
"""Time, s, in which the variance of what may have changed unseen reaches that of what the model leaves out. Where up to
nine parameters crept by up to half of their limits after a gesture in the plane (three runs), the bounds of 99.7 % then
covered all of the true errors, and those of 95 % covered 65 to 100 %; with half of it 98 to 100 and 64 to 93 %, with
none 99 and 82 % in the run that was tried. Less withholds what still holds."""
_ALL = frozenset({Fault.POLARITY.value, *MEASURED})


class Pace:
    """Tracks how the hand moves the picture, as a map, (3, 4), from a place in the picture (x, y, z, 1), mm, to its
    speed in the axes of the picture, mm/s.
    """

    def __init__(self, reference: Calibration) -> None:
        self._sensor_to_picture = rigid(reference.rotation, reference.offset_mm)
        self._poses: deque[tuple[int, Matrix4]] = deque()
        self._now: Array | None = None

    def step(self, t_ns: int, pose: Matrix4) -> None:
        """Takes the pose of the picture at t_ns, sensor → tracker."""
        self._poses.append((t_ns, pose))
        while len(self._poses) > 2 and t_ns - self._poses[1][0] >= _OVER_NS:
            self._poses.popleft()
        before_ns, before = self._poses[0]
        X = self._sensor_to_picture
        self._now = None
        if 0 < t_ns - before_ns <= _KNOWN_NS:
            way = np.eye(4) - X @ inverse(pose) @ before @ inverse(X)
            self._now = way[:3] / ((t_ns - before_ns) / 1e9)

    def at(self, t_ns: int) -> Array | None:
        """Returns the map for a picture at t_ns; None where it is not known."""
        known = self._poses and 0 <= t_ns - self._poses[-1][0] <= _KNOWN_NS
        return self._now if known else None

    def restart(self) -> None:
        """Drops the poses before now, which were stamped wrongly or lie behind a gap."""
        self._poses.clear()
        self._now = None


@dataclass(frozen=True, slots=True, eq=False)
class _Shown:
    """Holds what a window showed in which all ten checks were OK."""

    change: Change
    checks: tuple[Check, ...]


class PointWatch:
    """Bounds the error of a point by what windows have shown, which says less and less about the present. The result of
    a whole gesture is kept while it still says more than later ones, and while these do not show everything, for as
    long as the offsets count. A contradiction of the calibration, or later motion that shows something else, ends it.
    """

    def __init__(self, reference: Calibration, limits: Limits) -> None:
        self._reference = reference
        self._places = Places(reference, limits)
        self.pace = Pace(reference)
        self._kept: _Shown | None = None
        self._latest: Change | None = None

    def restart(self) -> None:
        """Forgets what motion has shown."""
        self._kept = self._latest = None

    def note(self, finding: Finding, now_ns: int, status: VerificationStatus, stamps_err_s: float) -> None:
        """Takes what the solution of now_ns shows."""
        self._latest = change_of(finding, stamps_err_s)
        kept, everything = self._kept, self._latest is not None and finding.shows(_ALL)
        sigmas = _ELSE_SHOWN if everything else _ELSE
        if kept is not None and (status.contradictions or _differs(finding.checks, kept.checks, sigmas)):
            kept = None
        if self._latest is not None and everything and self._says_more(self._latest, kept, now_ns):
            kept = _Shown(self._latest, finding.checks)
        self._kept = kept

    def _says_more(self, change: Change, kept: _Shown | None, now_ns: int) -> bool:
        return kept is None or self._spread_mm(change, now_ns) <= self._spread_mm(kept.change, now_ns)

    def _spread_mm(self, change: Change, now_ns: int) -> float:
        """Returns the bound of 99.7 % at the worst place with a still hand, as if the reference were the likeliest
        calibration. It measures how much the change says about the present, whatever it says.
        """
        centred = replace(_by(change, now_ns), mean=np.zeros_like(change.mean))
        return self._places.error(centred, np.zeros((3, 4))).worst_mm[-1]

    def now(self, t_ns: int, status: VerificationStatus) -> PointError | None:
        """Returns the error at a picture. Returns None while it is not known: something was not observed, something
        contradicts the calibration, or it is not known how the hand moves.
        """
        known = self._known(t_ns, status)
        return None if known is None else self._places.error(*known)

    def at(self, t_ns: int, status: VerificationStatus, at_mm: Array) -> Bounds | None:
        """Returns the same at these places, as `bounds_at` does."""
        known = self._known(t_ns, status)
        return None if known is None else bounds_at(at_mm, slope_of_places(at_mm, self._reference), *known)

    def _known(self, t_ns: int, status: VerificationStatus) -> tuple[Change, Array] | None:
        change, pace = self._change(t_ns, status), self.pace.at(t_ns)
        if change is None or pace is None or status.contradictions:
            return None
        return _by(change, t_ns), pace

    def _change(self, t_ns: int, status: VerificationStatus) -> Change | None:
        if self._kept is None or status.verified_ns is None:
            return self._latest
        return self._kept.change if t_ns - self._kept.change.shown_ns <= GESTURE_AGE_S * 1e9 else self._latest


def _by(change: Change, now_ns: int) -> Change:
    """Returns the change as known at now_ns, with the variance of what may have changed unseen since it was shown."""
    age_s = max(now_ns - change.shown_ns, 0) / 1e9
    unseen = np.diag(np.square(LEFT_OUT)) * (age_s / _WITHIN_S)
    return replace(change, covariance=change.covariance + unseen)


def _differs(checks: tuple[Check, ...], kept: tuple[Check, ...], sigmas: float) -> bool:
    """Returns whether any parameter of X has changed since; one that is not observed does not differ."""
    before = {check.name: check for check in kept}
    return any(
        abs(check.value - before[check.name].value) > sigmas * hypot(check.sigma, before[check.name].sigma)
        for check in checks
        if check.name in PARAMETERS
    )
