"""Measures the fan of a convex picture: apex, opening, radii and aspect, with their uncertainty. Pure geometry."""

from collections.abc import Generator
from dataclasses import dataclass
from typing import cast

import numpy as np

from probewatch.appliance.core.detectors.fan_borders import (
    APEX_X,
    APEX_Y,
    ASPECT,
    BOTTOM,
    BOTTOM_RADIUS,
    FACE,
    FACE_RADIUS,
    LEFT,
    LEFT_SLOPE,
    RIGHT,
    Blacks,
    Border,
    off,
    predicted,
    window,
)
from probewatch.appliance.core.detectors.fan_search import fan_about, thresholds
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import GreyImage

_WINDOWS_PX = (16, 8)
"""px on either side of a border's last place in which it is looked for, one window after the other. The first covers
the error of a search that takes every third pixel of the picture."""
_ROUNDS = 3
"""Rounds of reweighted least squares at each window."""
_LEAST_SD_PX, _MOST_SD_PX = 0.29, 1.5
"""Least and largest standard deviation, px, of a border's points: that of whole pixels, and that of a border that is
still worth following."""
_LEAST_REACH_PX = 2.0
"""px from the border beyond which a point has no weight in the end. With more the fit is drawn to what lies beside the
border, with less to single pixels."""
_TUKEY = 4.0
"""Standard deviations beyond which a point does not belong to the border."""
_ON_PX, _LEAST_SHARE, _LEAST_FADING_SHARE, _LEAST_POINTS = 1.5, 0.5, 0.3, 12
"""px within which a point lies on its border; the share of points that must do so for the border to be seen, the same
for sides that fade with depth, and their least number. Fewer take the edge of a shadow for a border; more miss borders
that tissue hides in parts."""
_ALIKE = 1.4
"""Factor of sigma that accounts for the common errors of neighbouring points of a border."""
_BORDER_PX, _BLUR_PX = 0.3, 0.6
"""px by which a whole border may lie beside where it is seen, which the noise of its points does not include: alone
(the width of a drawn line, whole pixels), and outwards together with all others (a blurring grabber, a codec). The
second reached 1 px in 80 drawn fans behind the worst of four grabbers."""
_OUTWARDS = {LEFT: -1, RIGHT: 1, FACE: -1, BOTTOM: 1}
"""Sign of the step in column or row that moves a border outwards."""
_CLEAR_SHARE, _INSIDE_PX, _USUAL = 0.4, (3, 8), 60
"""Grey up to which it is dark beside a border, as a share of the grey inside it; the px inside the border, from and to,
at which that is read; and its percentile over the places. An edge that a scaler has blurred lies where it is half as
bright. A higher share loses borders whose tissue is dark in parts."""
_ACROSS, _MARGIN_RAD, _BESIDE_RAD, _MOST_LIT = 40, 0.03, np.linspace(0, 0.2, 12), 0.15
"""Places along a border that are examined beside a fan; where they begin beside it, and how far on they lie, rad or
share of the depth; and the largest share of them that may show something, as text does. Tissue that goes on above the
shadow of a rib shows .3 and more."""
_MOST_ASPECT_SIGMA = 0.1
"""Largest relative sigma of a fan's aspect: with a larger one it is not known whether the upper border is an arc about
the apex."""


@dataclass(frozen=True, slots=True, eq=False)
class Fan:
    """Holds the fan that was measured in a picture.

    numbers: (7,) in the order of `fan_borders`; the last is NaN where the lower arc is not seen. noise: (7, 7)
    covariance of the numbers by errors that differ from picture to picture. covariance: the same with the errors that
    all pictures of a scanner share. black: greys up to which it is dark beside the fan. borders: those that were seen.
    """

    numbers: Array
    noise: Array
    covariance: Array
    black: Blacks
    borders: tuple[int, ...]


def fan_in(image: GreyImage) -> Fan | None:
    """Returns the fan in a picture, (h, w) uint8 with the face above, or None.

    Both sides and the arc of the face must be seen.
    """
    search = searching(image)
    while True:
        try:
            next(search)
        except StopIteration as end:
            return cast("Fan | None", end.value)


def searching(image: GreyImage, black: Blacks | None = None) -> Generator[None, None, Fan | None]:
    """Does the work of `fan_in` in steps of 4 ms or less, and yields between them.

    black: greys up to which it is dark beside the fan, where those are known.
    """
    best: Fan | None = None
    for greys in [(grey, grey) for grey in thresholds(image)] if black is None else [black]:
        yield
        about = fan_about(image, greys[1])
        yield
        fan = None if about is None else fan_near(image, about, greys)
        if fan is None or (black is None and _goes_on(image, fan)):
            continue
        if best is None or _merit(fan) > _merit(best):
            best = fan
    if best is None or black is not None:
        return best
    yield
    return _clearer(image, best)


def _clearer(image: GreyImage, fan: Fan) -> Fan:
    """Returns the same fan with its edges where they are half as bright as what lies inside."""
    clear = max(fan.black[0], _CLEAR_SHARE * _least_inside(image, fan))
    for greys in ((fan.black[0], clear), (clear, clear)):
        found = fan_near(image, fan.numbers, greys)
        if found is not None and found.borders == fan.borders:
            return found
    return fan


def _merit(fan: Fan) -> tuple[int, float]:
    """Returns a rank of the fan: how many of its borders are seen, then how certain its apex is."""
    return len(fan.borders), -float(np.trace(fan.covariance[:2, :2]))


def _goes_on(image: GreyImage, fan: Fan) -> bool:
    """Returns whether something is shown beside a side or below the lower arc: a shadow ends there, not the fan."""
    apex_y, left, right, aspect, face, bottom = fan.numbers[APEX_Y:]
    bottom = bottom if np.isfinite(bottom) else image.shape[0] - apex_y
    along = np.linspace(face, bottom, _ACROSS)[:, None]
    sides = [
        (along, sign * (np.arctan(aspect * slope) + _MARGIN_RAD + _BESIDE_RAD))
        for sign, slope in ((-1, left), (1, right))
    ]
    between = np.linspace(-np.arctan(aspect * left), np.arctan(aspect * right), _ACROSS)
    below = bottom + (_MARGIN_RAD + _BESIDE_RAD)[:, None] * (bottom - face)
    places = [*sides, *([(below, between)] if BOTTOM in fan.borders else [])]
    black = max(fan.black[0], _CLEAR_SHARE * _least_inside(image, fan))
    return any(_lit(image, fan, radius, angle, black) > _MOST_LIT for radius, angle in places)


def _lit(image: GreyImage, fan: Fan, radius: Array, angle: Array, black: float) -> float:
    """Returns the share of places that are not black, without those outside the picture.

    radius, angle: polar coordinates of the places about the apex.
    """
    rows = np.round(fan.numbers[APEX_Y] + radius * np.cos(angle)).astype(np.intp)
    columns = np.round(fan.numbers[APEX_X] + radius * np.sin(angle) / fan.numbers[ASPECT]).astype(np.intp)
    inside = (rows >= 0) & (rows < image.shape[0]) & (columns >= 0) & (columns < image.shape[1])
    return float(np.mean(image[rows[inside], columns[inside]] > black)) if np.any(inside) else 0.0


def _least_inside(image: GreyImage, fan: Fan) -> float:
    """Returns the grey just inside the darkest border, the percentile `_USUAL` of its places."""
    inside = []
    for border in fan.borders:
        one = window(fan.numbers, border, image.shape, _INSIDE_PX[1])
        greys = image[one.rows, one.columns][:, _INSIDE_PX[0] - _INSIDE_PX[1] :]
        inside.append(float(np.percentile(greys, _USUAL)))
    return min(inside)


def fan_near(image: GreyImage, about: Array, black: Blacks) -> Fan | None:
    """Returns the fan whose borders lie within 16 px of those of another, (7,) px; None where they do not."""
    numbers = about
    for window_px in _WINDOWS_PX:
        wanted = [LEFT, RIGHT, FACE, *([BOTTOM] if np.isfinite(numbers[BOTTOM_RADIUS]) else [])]
        seen = {border: window(numbers, border, image.shape, window_px).read(image, black) for border in wanted}
        points = {border: one.seen() for border, one in seen.items()}
        if BOTTOM in points and points[BOTTOM].at.size < _LEAST_POINTS:
            return fan_near(image, _without_bottom(about), black)
        fitted = _fitted(numbers, points, window_px)
        if fitted is None:
            return None
        numbers, noise, ways = fitted
        on = [border for border, one in seen.items() if _on(numbers, border, one, BOTTOM in wanted)]
        if on == wanted:
            continue
        return fan_near(image, _without_bottom(about), black) if on == wanted[:-1] and BOTTOM in wanted else None
    covariance = noise + ways @ ways.T
    if covariance[ASPECT, ASPECT] > (_MOST_ASPECT_SIGMA * numbers[ASPECT]) ** 2:
        return None
    return Fan(numbers, noise, covariance, black, tuple(wanted))


def _without_bottom(numbers: Array) -> Array:
    """Returns the numbers of a fan, (7,), without the lower arc, so that it is not looked for."""
    return np.where(np.arange(7) == BOTTOM_RADIUS, np.nan, numbers)


def _on(numbers: Array, border: int, seen: Border, whole: bool) -> bool:
    """Returns whether a border lies where the fit puts it.

    whole: whether the lower arc is seen too, so that the sides do not fade.
    """
    beside = off(numbers, border, seen)
    near = int(np.count_nonzero(np.abs(beside) <= _ON_PX))
    share = _LEAST_SHARE if whole or border not in (LEFT, RIGHT) else _LEAST_FADING_SHARE
    return near >= max(_LEAST_POINTS, share * beside.size)


def _fitted(numbers: Array, points: dict[int, Border], window_px: int) -> tuple[Array, Array, Array] | None:
    """Fits a fan to these borders by reweighted least squares, or returns None.

    Returns its numbers, their covariance by the noise of the points, and (7, n) their changes by a shift of each border
    and of all of them. Returns None where the fit is not a fan, or one of the borders is not seen.
    """
    if min(one.at.size for one in points.values()) < _LEAST_POINTS:
        return None
    free = slice(7 if BOTTOM in points else BOTTOM_RADIUS)
    reach = float(window_px)
    # Each round solves the normal equations of all borders and halves the distance at which a point has no weight.
    for _ in range(_ROUNDS):
        weighed = [_weighed(numbers, border, one, reach) for border, one in points.items()]
        inverse = np.zeros((7, 7))
        try:
            inverse[free, free] = np.linalg.inv(np.sum([normal for normal, _, _ in weighed], axis=0)[free, free])
        except np.linalg.LinAlgError:
            return None
        numbers = numbers + inverse @ np.sum([side for _, side, _ in weighed], axis=0)
        reach = max(reach / 2, _LEAST_REACH_PX)
        if not (np.all(np.isfinite(numbers[free])) and min(numbers[LEFT_SLOPE:BOTTOM_RADIUS]) > 0):
            return None
    alone = inverse @ np.stack([together for _, _, together in weighed], axis=1)
    outwards = alone @ np.array([[_OUTWARDS[border]] for border in points])
    ways = np.hstack([alone * _BORDER_PX, outwards * _BLUR_PX])
    return numbers, inverse * _ALIKE**2, ways


def _weighed(numbers: Array, border: int, seen: Border, reach: float) -> tuple[Array, Array, Array]:
    """Returns the normal equations of one border, (7, 7) and (7,), and what a shift of all of it adds to them, (7,)."""
    place, slopes = predicted(numbers, border, seen.at)
    beside, slopes = (seen.found - place) * seen.cosine, slopes * seen.cosine[:, None]
    middle, sd = _about(np.sort(beside))
    weight = np.maximum(1 - ((beside - middle) / min(_TUKEY * sd, reach)) ** 2, 0) ** 2 / sd**2
    weighted = slopes.T * weight
    return weighted @ slopes, weighted @ beside, weighted.sum(axis=1)


def _about(beside: Array) -> tuple[float, float]:
    """Returns where most of the points lie, and their standard deviation, px. beside: ascending."""
    median = beside[beside.size // 2]
    sd = 1.48 * float(np.sort(np.abs(beside - median))[beside.size // 2])
    sd = min(max(sd, _LEAST_SD_PX), _MOST_SD_PX)
    until = np.searchsorted(beside, beside + 2 * sd)
    first = int((until - np.arange(beside.size)).argmax())
    return float(beside[first : until[first]].mean()), sd


def scale_sigmas(fan: Fan) -> Array:
    """Returns the relative sigmas, (2,), of the lateral and axial scale that the radius of the face shows."""
    inner = np.zeros((2, 7))
    inner[:, FACE_RADIUS] = -1 / fan.numbers[FACE_RADIUS]
    inner[0, ASPECT] = 1 / fan.numbers[ASPECT]
    return np.asarray(np.sqrt(np.diag(inner @ fan.covariance @ inner.T)))
