"""Sees the marker body jump on the probe: the tracker leaps, the picture does not.

A probe in a hand cannot leap. Where the tracker moves far within one frame while the picture shows an ordinary step, it
was the marker body that moved: bent (it turned) or slid (it only shifted). Leaps add up, so one that is undone is
forgiven; an outlier, which leaps out and back, sums to nothing.
"""

from collections import deque
from math import hypot

import numpy as np

from appliance.core.geometry import angle_from_rotation, inverse
from appliance.core.path.window import sensor_jump
from appliance.limits import Limits
from appliance.types import Check, VerdictKind
from drivers.samples import Matrix4

_LEAST_MM, _LEAST_RAD = 2.5, np.deg2rad(2.0)
_FAST_MM_PER_S, _FAST_RAD_PER_S = 60.0, np.deg2rad(45.0)
_HISTORY = 6
_SETTLE = 3
_SHARED = 1.5
_LIVELY = 2.0


class MarkerSlip:
    """Sums the leaps of the marker body in its own axes: B' = B · D."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._recent: deque[tuple[int, Matrix4]] = deque(maxlen=_HISTORY)
        self._steps: deque[tuple[float, float]] = deque(maxlen=_HISTORY - 1)
        self._slip = np.eye(4)
        self._pending: tuple[Matrix4, int] | None = None

    def pause(self) -> None:
        """The picture was not followed, so it cannot testify: forget the poses so far."""
        self._forget_path()
        self._pending = None

    def step(self, t_ns: int, matrix: Matrix4, seen_mm: float) -> bool:
        """Take the pose of a picture that could be followed; True when a leap was confirmed.

        seen_mm: how far the picture moved since the one before. What it shares with the tracker is no leap.
        """
        if self._recent:
            self._steps.append(_extent(sensor_jump(self._recent[-1][1], matrix)))
        self._recent.append((t_ns, matrix))
        if self._pending is not None:
            return self._confirm(matrix)
        if len(self._recent) == _HISTORY:
            self._look_for_leap(seen_mm)
        return False

    def forget_turn(self) -> None:
        """Motion has shown the rotation to be right."""
        self._slip[:3, :3] = np.eye(3)

    def forget(self) -> None:
        """A new reference is in force."""
        self._slip = np.eye(4)

    def checks(self) -> tuple[Check, ...]:
        """Turn and shift of the marker body since the reference, deg and mm."""
        shift, turn_rad = _extent(self._slip)
        turn = float(np.rad2deg(turn_rad))
        bent, slid = turn > self._limits.rotation_deg, shift > self._limits.offset_mm
        return (
            _check("marker-turn", "rotation", turn, "deg", self._limits.rotation_deg, bent),
            _check("marker-shift", "offset", shift, "mm", self._limits.offset_mm, slid and not bent),
        )

    def _look_for_leap(self, seen_mm: float) -> None:
        """The newest step against the usual ones before it."""
        (t_before, before), (t_now, now) = self._recent[-2], self._recent[-1]
        expected = before @ self._usual_step()
        moved_mm, turned_rad = _extent(sensor_jump(expected, now))
        usual_mm, usual_rad = self._liveliest_step()
        dt_s = (t_now - t_before) / 1e9
        far = moved_mm > max(_LEAST_MM, _FAST_MM_PER_S * dt_s) + _SHARED * seen_mm + _LIVELY * usual_mm
        turned = turned_rad > max(_LEAST_RAD, _FAST_RAD_PER_S * dt_s) + _LIVELY * usual_rad
        if far or turned:
            self._pending = (expected, _SETTLE)

    def _liveliest_step(self) -> tuple[float, float]:
        """Largest step before the newest, mm and rad: a probe in full swing may well turn round."""
        steps = tuple(self._steps)[:-1]
        return max(step[0] for step in steps), max(step[1] for step in steps)

    def _forget_path(self) -> None:
        self._recent.clear()
        self._steps.clear()

    def _usual_step(self) -> Matrix4:
        """Mean step of the sensor over the frames before the newest, in sensor axes."""
        oldest, latest = self._recent[0][1], self._recent[-2][1]
        whole = inverse(oldest) @ latest
        step = np.eye(4)
        step[:3, 3] = whole[:3, 3] / (_HISTORY - 2)
        return step

    def _confirm(self, matrix: Matrix4) -> bool:
        """A leap counts once the marker has stayed where it leapt to for a few frames."""
        assert self._pending is not None
        expected, left = self._pending
        leap = sensor_jump(expected, matrix)
        moved_mm, turned_rad = _extent(leap)
        gone_back = moved_mm < _LEAST_MM / 2 and turned_rad < _LEAST_RAD / 2
        if gone_back:
            self._pending = None
            return False
        if left > 1:
            self._pending = (expected, left - 1)
            return False
        self._slip = self._slip @ leap
        self._pending = None
        self._forget_path()
        return True


def _extent(step: Matrix4) -> tuple[float, float]:
    """Length mm and angle rad of a rigid step."""
    return hypot(*step[:3, 3].tolist()), angle_from_rotation(step[:3, :3])


def _check(name: str, fault: str, value: float, unit: str, limit: float, failed: bool) -> Check:
    return Check(name, fault, value, 0.0, unit, limit, VerdictKind.FAULT if failed else VerdictKind.OK)
