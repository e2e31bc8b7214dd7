"""Watches where the reference tool rests in the tracker's own frame: a change of place shows a blow that relative poses
hide.

A tracker that was moved, as by a blow against its stand, moves every tool in its frame alike, so poses relative to a
reference tool remain as they were. If the reference tool itself was moved, they change, and the line names rotation or
offset. Only the place of the reference shows a person that either has happened; together with the named fault, or
without one, it shows which of the two.
"""

import math
from dataclasses import dataclass

import numpy as np

from probewatch.drivers.rigid import angle_from_rotation
from probewatch.drivers.samples import Matrix4

_RESTS_NS = 3_000_000_000
"""How long the reference must stay in one place to count as resting there, ns. Less takes the pause between two breaths
for rest; more reports later that it was moved. Tried on readings that sway by 2 and 15 mm in four seconds: with one
second, those of 2 mm counted as rest.
"""

_STILL_MM, _STILL_RAD = 1.0, math.radians(1.0)
"""Differences, mm and rad, within which the reference stays in its place: those between two readings of a tool at rest,
as in the gate for NDI's outliers. More takes a slow motion for rest; less takes noise for motion.
"""

_MOVED_MM, _MOVED_RAD = 3.0, math.radians(2.0)
"""Differences, mm and rad, between two places of rest above which the reference was moved: three times the noise in
translation, and less than a bend or slide that must be named. A tracker that turns by a tenth of a degree at 1.7 m
moves the reference by 3 mm. More leaves smaller blows unreported.
"""

_REPORTED_NS = 600_000_000_000
"""How long the move is reported, ns: until the person who was called has looked. More reports what is long over."""


@dataclass(frozen=True, slots=True)
class _Place:
    """Holds a place of the reference tool. since_ns: the time from which on it has been there."""

    pose: Matrix4
    since_ns: int


class ReferencePlace:
    """Watches the place of the reference tool. It must be given every pose, (4, 4) tool → tracker, in the order of
    time, with host times in ns.
    """

    def __init__(self) -> None:
        self._place: _Place | None = None
        self._rest: Matrix4 | None = None
        self._moved: tuple[int, float, float] | None = None

    def take(self, t_ns: int, reference: Matrix4) -> None:
        """Takes the next reading of the reference tool."""
        place = self._place
        if place is None or _apart(place.pose, reference, _STILL_MM, _STILL_RAD):
            self._place = _Place(reference, t_ns)
        elif t_ns - place.since_ns >= _RESTS_NS:
            self._note_rest(t_ns, place.pose)

    def remarks(self, now_ns: int) -> tuple[str, ...]:
        """Returns a remark that the reference was recently moved; empty where it was not."""
        if self._moved is None or now_ns - self._moved[0] > _REPORTED_NS:
            return ()
        _, by_mm, by_rad = self._moved
        moved = f"the tracker or the reference tool was moved, by {by_mm:.1f} mm and {math.degrees(by_rad):.1f}°"
        return (f"{moved}: the tracker, which does no harm, unless rotation or offset is named",)

    def _note_rest(self, t_ns: int, pose: Matrix4) -> None:
        before = self._rest
        if before is None:
            self._rest = pose
        elif _apart(before, pose, _MOVED_MM, _MOVED_RAD):
            self._rest, self._moved = pose, (t_ns, *_difference(before, pose))


def _difference(one: Matrix4, other: Matrix4) -> tuple[float, float]:
    """Returns the distance and the angle between two poses, mm and rad."""
    turn = one[:3, :3].T @ other[:3, :3]
    return float(np.linalg.norm(other[:3, 3] - one[:3, 3])), angle_from_rotation(turn)


def _apart(one: Matrix4, other: Matrix4, by_mm: float, by_rad: float) -> bool:
    along_mm, turn_rad = _difference(one, other)
    return along_mm > by_mm or turn_rad > by_rad
