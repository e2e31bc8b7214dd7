"""Measures how the probe was held while the crossing was seen, and advises where to hold it next. Pure.

There are three turns, in the picture's own axes and counted from the mean of all views: about the lateral axis the
handle leans forwards and backwards, about the axial axis it twists, about the elevational axis it leans to the sides.
In addition, the place in the picture where the crossing appeared counts, on a grid of three by three.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.crosswire.scan import View
from probewatch.appliance.crosswire.whole import WholeSolution
from probewatch.appliance.types import Vector
from probewatch.drivers.rigid import nearest_rotation, rotation_from_vector, skew, vector_from_rotation

TURNS = ("lean forwards and backwards", "twist left and right", "lean to the sides")
"""Movements of the hand that turn the picture about the lateral, axial and elevational axis."""
_TOWARDS = (
    ("lean the handle towards you", "lean the handle away from you"),
    ("twist the probe clockwise, seen from above", "twist the probe anticlockwise, seen from above"),
    ("lean the handle to the right", "lean the handle to the left"),
)
"""The positive and negative turn of the picture, for a person who stands so that its marked side is on the left."""
_PLACES = (
    ("top left", "top", "top right"),
    ("left", "middle", "right"),
    ("bottom left", "bottom", "bottom right"),
)
BIN_EDGES_DEG = (-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0)
"""Edges, deg, of the bins of covered angles: steps that a hand can distinguish. The outermost bins hold all beyond."""
_ASKED_DEG = 20.0
"""Angle, deg, to which a turn is advised: further out the wires no longer echo, nearer it shows less. Not varied."""
_MORE_VIEWS = 3
"""The number of views by which a motion is judged before it is made: a few passages. Other numbers hardly change which
motion is best."""
_ENOUGH_VIEWS = 2
"""The number of views, in each half of a turn's range beyond 10° and in each place, from which it counts as covered."""


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """Holds how the views cover turns and places. angles_deg: (N, 3) turns of the kept views. spread_deg: (3,) their
    standard deviation.

    bins: (3, 6) views by angle, between BIN_EDGES_DEG. places: (3, 3) views by row and column of the picture.
    in_picture_axes: False while the calibration is not known; the three turns are then about the marker body's axes.
    next_motion: what to do next, in words; empty where everything is covered.
    """

    angles_deg: Vector
    spread_deg: Vector
    bins: NDArray[np.intp]
    places: NDArray[np.intp]
    in_picture_axes: bool
    next_motion: str


def coverage(
    views: Sequence[View],
    image_size_px: tuple[int, int],
    solution: WholeSolution | None = None,
    wanted: Vector | None = None,
) -> Coverage:
    """Measures how the views cover the tilts, and names the next motion. solution: that of these views, as far as there
    is one. wanted: (8,) standard deviations required of its parameters.
    """
    rotation = np.eye(3) if solution is None else solution.calibration.rotation
    angles = np.zeros((0, 3))
    turns = np.array([rotation @ view.matrix[:3, :3].T for view in views]).reshape(-1, 3, 3)
    mean = np.eye(3)
    if len(views):
        mean = nearest_rotation(turns.sum(axis=0))
        angles = np.degrees(vector_from_rotation(mean @ np.swapaxes(turns, 1, 2)))
        # G = exp(−φ) Ḡ: the vector of Ḡ Gᵀ is the picture's turn φ about its own axes.
    bins = np.stack([_binned(angles[:, axis]) for axis in range(3)])
    places = np.zeros((3, 3), np.intp)
    for view in views:
        column, row = np.clip(3 * view.centre_px // np.array(image_size_px), 0, 2).astype(int)
        places[row, column] += 1
    spread = np.std(angles, axis=0) if len(views) else np.zeros(3)
    advice = _first_uncovered(angles, places)
    if solution is not None and wanted is not None:
        advice = _best_next(solution, mean, angles, places, wanted)
    return Coverage(angles, spread, bins, places, solution is not None, advice)


def _binned(angles_deg: Vector) -> NDArray[np.intp]:
    inner = np.array(BIN_EDGES_DEG[1:-1])
    return np.bincount(np.searchsorted(inner, angles_deg), minlength=len(inner) + 1).astype(np.intp)


def _first_uncovered(angles_deg: Vector, places: NDArray[np.intp]) -> str:
    """Returns advice on any turn that is missing, then on any place, for as long as nothing is known of the probe."""
    reached = [
        [np.sum(side * angles_deg[:, axis] > _ASKED_DEG / 2) >= _ENOUGH_VIEWS for side in (1, -1)] for axis in range(3)
    ]
    if not all(all(pair) for pair in reached):
        return "tilt and twist the probe by 20° to every side, and pass through the crossing each time"
    empty = np.argwhere(places < _ENOUGH_VIEWS)
    return _place_words(*empty[0]) if len(empty) else ""


def _place_words(row: int, column: int) -> str:
    return f"bring the crossing to the {_PLACES[row][column]} of the picture"


def _best_next(
    solution: WholeSolution, mean: Vector, angles_deg: Vector, places: NDArray[np.intp], wanted: Vector
) -> str:
    """Returns the turn or place, among those not covered yet, after which the worst parameter is known best."""
    tried = {}
    for axis, side in [(axis, side) for axis in range(3) for side in (1, -1)]:
        if np.sum(side * angles_deg[:, axis] > _ASKED_DEG / 2) < _ENOUGH_VIEWS:
            turn = np.zeros(3)
            turn[axis] = side * np.radians(_ASKED_DEG)
            tried[_TOWARDS[axis][(1 - side) // 2]] = _after(solution, mean, turn, (1, 1), wanted)
    for row, column in np.argwhere(places < _ENOUGH_VIEWS):
        tried[_place_words(row, column)] = _after(solution, mean, np.zeros(3), (row, column), wanted)
    return min(tried, key=lambda motion: tried[motion]) if tried else ""


def _after(solution: WholeSolution, mean: Vector, turn: Vector, place: tuple[int, int], wanted: Vector) -> float:
    """Returns the worst ratio of standard deviation to the wanted one after some more views held in that way. turn:
    (3,) rad, about the picture's axes from the mean. place: row and column of the grid.
    """
    # Adds the information of _MORE_VIEWS views at that place and turn to that of the solution.
    calibration = solution.calibration
    third = np.array(calibration.image_size_px) / 3
    signed = np.array(calibration.polarity) * calibration.scale_mm_per_px
    shown = np.array([*((np.array(place[::-1]) - 1) * third * signed), 0.0])
    slope = np.zeros((3, len(solution.covariance)))
    slope[:, :3], slope[:, 5:8] = -skew(shown - calibration.offset_mm), np.eye(3)
    slope[0, 3], slope[1, 4] = -shown[0], -shown[1]
    slope[:, 8:11] = rotation_from_vector(-turn) @ mean
    gained = _MORE_VIEWS * slope.T @ slope / solution.localisation_mm**2
    covariance = np.linalg.inv(np.linalg.inv(solution.covariance) + gained)
    return float(np.max(np.sqrt(np.diag(covariance)[: len(wanted)]) / wanted))
