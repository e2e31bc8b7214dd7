"""Lists what a tracker's poses might mean instead of sensor → tracker: the few mistakes that drivers and
exports make.
"""

from collections.abc import Callable, Iterator, Mapping
from enum import StrEnum
from itertools import permutations, product

import numpy as np

from probewatch.drivers.rigid import (
    Array,
    angle_from_rotation,
    inverse,
    quaternion_from_rotation,
    rigid,
    rotation_from_quaternion,
)


class Convention(StrEnum):
    """Names how the poses are to be read; the names of all but the first two are shown to users."""

    AGREED = "as agreed"
    FLIPPED = "picture flipped"
    INVERTED = "poses-inverted"
    SWAPPED = "axes-swapped"
    MIRRORED = "axis-mirrored"
    TURNED_BACK = "turns-inverted"
    REORDERED = "quaternion-order"


_SAME_TURN_RAD = np.deg2rad(30.0)
"""Angle, rad, between a swapped sensor and a flipped picture, up to which they count as the same: motion shows it to at
most a few degrees, and the nearest other swaps are 90° apart. Not measured.
"""


def _reordered(places: int) -> Callable[[Array], Array]:
    def read(poses: Array) -> Array:
        quaternions = np.roll(quaternion_from_rotation(poses[:, :3, :3]), places, axis=1)
        return rigid(rotation_from_quaternion(quaternions), poses[:, :3, 3])

    return read


def _turned_back(poses: Array) -> Array:
    return rigid(np.swapaxes(poses[:, :3, :3], 1, 2), poses[:, :3, 3])


def _mirrored(axis: int) -> Callable[[Array], Array]:
    """Returns a reading in which this axis of the tracker's and the sensor's frames points the other way, as in
    left-handed programs.
    """
    mirror = np.eye(4)
    mirror[axis, axis] = -1.0
    return lambda poses: np.asarray(mirror @ poses @ mirror)


READINGS: Mapping[Convention, tuple[Callable[[Array], Array], ...]] = {
    Convention.INVERTED: (inverse,),
    Convention.MIRRORED: tuple(_mirrored(axis) for axis in range(3)),
    Convention.TURNED_BACK: (_turned_back,),
    Convention.REORDERED: (_reordered(1), _reordered(-1)),
}
"""Readings of the poses by convention: (n, 4, 4) as reported → (n, 4, 4) sensor → tracker, if that is the mistake."""


def _right_angles() -> Iterator[Array]:
    """Yields the 23 proper rotations, (3, 3), that map axes onto axes; the identity is left out."""
    for places, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        turn = np.zeros((3, 3))
        turn[range(3), places] = signs
        if np.linalg.det(turn) > 0 and not np.array_equal(turn, np.eye(3)):
            yield turn


_SWAPS = tuple(_right_angles())
_FLIPS = tuple(np.diag([float(x), float(y), float(x * y)]) for x, y in ((-1, 1), (1, -1), (-1, -1)))
"""Matrices by which a flipped picture multiplies R_x (docs/method.md, equation 7)."""


def turned_sensors(R: Array) -> Iterator[tuple[Convention, Array]]:
    """Yields the rotations sensor → picture, (3, 3), as they would have to be: with the picture flipped, or with axes
    of the sensor swapped, except for swaps that are as good as a flip.
    """
    flipped = [flip @ R for flip in _FLIPS]
    for turned in flipped:
        yield Convention.FLIPPED, turned
    for swap in _SWAPS:
        turned = R @ swap
        if all(angle_from_rotation(turned @ other.T) > _SAME_TURN_RAD for other in flipped):
            yield Convention.SWAPPED, turned
