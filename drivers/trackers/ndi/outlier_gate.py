"""Takes a second look at a pose that leaps: a checksum of 16 bits lets one damaged reply in 65536 through, and a hand
cannot leap.

A tool that continues its motion, within what a hand can change of it, is trusted at once. Any other pose, and the first
one after a gap, is trusted when the next reading agrees with it.
"""

import math
from dataclasses import dataclass

from probewatch.drivers.trackers.ndi.replies import Transform

_GAP_NS = 250_000_000
"""Gap, ns, after which the pose before says nothing about the next: at 2 m/s half a metre lies between. More lets
damage after a gap pass as motion; less asks for a second look after every short occlusion.
"""

_NOISE_MM, _NOISE_RAD = 1.0, math.radians(1.0)
"""Difference, mm and rad, that two poses of a tool at rest may have; a recorded Polaris scatters by 0.17 mm (1 σ) along
its worst axis, at 2 m. More lets greater damage pass; less doubts a stationary tool.
"""

_ACCELERATION_MM_S2, _ACCELERATION_RAD_S2 = 10_000.0, 100.0
"""One g, and as much for rotations at the length of a probe (10 cm). At 60 Hz this and the noise leave 2.4 mm and 1.8°,
within which damage may go unseen (tests/drivers/trackers/ndi/test_damage.py); less takes a second look at quick hands.
No hand was measured.
"""

_SPEED_MM_S, _SPEED_RAD_S = 2_000.0, 15.0
"""Fastest hand, between a doubted pose and the one that is to confirm it. More lets two damaged poses confirm each
other; less leaves a quick hand without poses. No hand was measured.
"""


@dataclass(frozen=True, slots=True)
class _Placed:
    """Holds a pose with its motion. velocity_mm_s: mean velocity since the pose before. turn_rad_s: rate of rotation
    since then.
    """

    t_ns: int
    transform: Transform
    velocity_mm_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_rad_s: float = 0.0


class OutlierGate:
    """Watches one tool; it must be given every pose in the order of time."""

    def __init__(self) -> None:
        self._last: _Placed | None = None
        self._doubted: _Placed | None = None

    def believes(self, t_ns: int, transform: Transform) -> bool:
        """Returns whether to pass the pose on. t_ns: device time of the measurement, ns."""
        if self._goes_on(t_ns, transform) or self._confirms(t_ns, transform):
            return True
        self._doubted = _Placed(t_ns, transform)
        return False

    def _goes_on(self, t_ns: int, transform: Transform) -> bool:
        """Returns whether the pose is near where the motion so far leads."""
        last = self._last
        if last is None or not 0 < t_ns - last.t_ns <= _GAP_NS:
            return False
        dt_s = (t_ns - last.t_ns) / 1e9
        placed = _moved(last, t_ns, transform)
        off_mm = math.dist(placed.velocity_mm_s, last.velocity_mm_s) * dt_s
        off_rad = abs(placed.turn_rad_s - last.turn_rad_s) * dt_s
        near = off_mm <= _NOISE_MM + _ACCELERATION_MM_S2 * dt_s**2 / 2
        if not near or off_rad > _NOISE_RAD + _ACCELERATION_RAD_S2 * dt_s**2 / 2:
            return False
        self._last, self._doubted = placed, None
        return True

    def _confirms(self, t_ns: int, transform: Transform) -> bool:
        """Returns whether the pose confirms the one that was doubted: it is the same measurement once more, or as near
        as a hand moves in that time.
        """
        doubted, self._doubted = self._doubted, None
        if doubted is None or not 0 <= t_ns - doubted.t_ns <= _GAP_NS:
            return False
        if t_ns == doubted.t_ns:
            agrees = transform == doubted.transform
        else:
            dt_s = (t_ns - doubted.t_ns) / 1e9
            near = math.hypot(*_difference(doubted.transform, transform)) <= _NOISE_MM + _SPEED_MM_S * dt_s
            agrees = near and turn_rad(doubted.transform, transform) <= _NOISE_RAD + _SPEED_RAD_S * dt_s
        if agrees:
            self._last = _moved(doubted, t_ns, transform) if t_ns > doubted.t_ns else _Placed(t_ns, transform)
        return agrees


def _moved(before: _Placed, t_ns: int, transform: Transform) -> _Placed:
    """Returns the tool at t_ns, with its motion since the pose before."""
    dt_s = (t_ns - before.t_ns) / 1e9
    x, y, z = _difference(before.transform, transform)
    turn_rad_s = turn_rad(before.transform, transform) / dt_s
    return _Placed(t_ns, transform, (x / dt_s, y / dt_s, z / dt_s), turn_rad_s)


def turn_rad(first: Transform, second: Transform) -> float:
    """Returns the angle between two orientations; the signs of the quaternions do not matter."""
    dot = sum(a * b for a, b in zip(first.quaternion, second.quaternion, strict=True))
    return 2 * math.acos(min(abs(dot) / (math.hypot(*first.quaternion) * math.hypot(*second.quaternion)), 1.0))


def _difference(first: Transform, second: Transform) -> tuple[float, float, float]:
    (ax, ay, az), (bx, by, bz) = first.translation_mm, second.translation_mm
    return bx - ax, by - ay, bz - az
