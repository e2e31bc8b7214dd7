"""Finds and measures the depth ruler that a scanner draws beside its sector: a column of short marks, equally spaced.

It is found among what never moves and measured to a fraction of a pixel. This module is pure geometry; `depth_ruler`
decides what a change means.
"""

from dataclasses import dataclass
from math import sqrt

import cv2
import numpy as np

from probewatch.appliance.core.registration.pyramid import Array32, Bits
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import GreyImage

_THIN = np.ones((9, 1), np.uint8)
"""Height, px, from which a mark is not a tick. Ticks are 1 to 3 px high, 5 behind a blurring grabber; letters are
higher."""
_ABOUT = 3
"""px above and below a mark's peak over which its centre is computed. More reach into the next tick of a fine ruler."""
_APART_PX = 8.0
"""px, least spacing of ticks: within `_ABOUT`, closer ones are a single mark. Ticks of 1 mm, at 200 mm in 1080 rows,
are 5 px apart and are not found; nor are the 5 mm ticks among them, because all stand in the same columns."""
_LEAST_GREY = 20.0
"""Least grey of a mark above its surroundings, mean over the ruler's columns. A lower one counts the noise of a grabber
(a sigma of 6 greys reaches 15 at worst over 3 columns and 480 rows); a higher one misses dim rulers. Not measured on
real scanners."""
_OF_USUAL = 0.5
"""Share of the median height of the marks below which a mark is ignored, as the shadow of a letter or the ripple of a
codec."""
_FURTHEST = 3
"""Most spacings from one visible tick to the next: two in a row may be covered. More bridge lines of text."""
_LEAST_TICKS, _LEAST_SPAN = 5, 0.33
"""Fewest ticks, and the least share of the picture's rows that they span. Lower values take lines of text for a ruler;
higher ones miss coarse rulers: a depth of 40 mm has five ticks of 10 mm."""
_STRAY_PX, _STRAY_SHARE = 1.1, 0.06
"""How far a tick may be from its place, px or share of the spacing: two ticks in whole rows are rounded by .5 px each.
"""
_MISSING, _EXTRA = 0.25, 0.34
"""Share of the ticks that may be covered, and share of marks that are not ticks. Higher values find rulers in text;
lower ones lose a ruler under the corner of a menu or a focus mark."""
_MOST_MARKS = 150
"""Most marks in a column that may be a ruler: 1080 rows hold 135 ticks. This bounds the time that a hostile picture
takes."""
_ROUNDED_PX = 0.29
"""px, standard deviation of the place of a tick that the scanner rounded to whole rows: 1 ÷ √12. It is the least
uncertainty, also where the ticks agree better by chance."""
_BESIDE = 8
"""px on either side of the ruler's columns that belong to its cross-section: ticks end there, lines of a menu go on."""
_LONGEST_PX = 60
"""Columns on either side into which a tick may extend. Longer marks are lines, and cost more to examine."""
_ALIKE, _BRIGHT = 0.75, (0.5, 2.0)
"""Least correlation of two rulers' cross-sections, and bounds of the ratio of their heights, for both to be the same
scanner's. A lower correlation takes the lines of a menu for the ruler; a higher one loses the ruler under another major
tick or a blur. Menus of full lines reach .3."""
_HELD = 0.8
"""Share of the ticks that must be where they were for the ruler to be unchanged, whatever else is new."""
_SAME_ROWS = 3
"""Most rows of a profile that may differ, by half the height of a tick, before the ruler is examined again: a passing
mark changes as few; where the ruler changes, all ticks but the first move."""
_WIDTH = 3
"""Columns in which a ruler is looked for at once: the length of the shortest tick. Fewer see noise; more miss short
ticks."""


@dataclass(frozen=True, slots=True, eq=False)
class Ruler:
    """Holds one depth ruler as measured in a picture.

    columns: first column, and the one after the last, that all ticks have in common. rows: (n,) rows of the ticks, px.
    spacing_px, sigma_px: spacing of the ticks and its standard deviation. profile: (h,) greys above the surroundings.
    look: (columns and _BESIDE on either side,) cross-section of the median tick.
    """

    columns: tuple[int, int]
    rows: Array
    spacing_px: float
    sigma_px: float
    profile: Array32
    look: Array32


def candidates(image: GreyImage, tissue: Bits) -> tuple[int, ...]:
    """Returns the columns of a picture, (h, w) uint8, that have enough stationary marks for a ruler, the fullest first.

    tissue: the registration's mask, (h, w) bool, False where the picture never moves.
    """
    if image.shape[1] < _WIDTH:
        return ()
    thin = cv2.morphologyEx(np.ascontiguousarray(image), cv2.MORPH_TOPHAT, _THIN)
    still = (thin > _LEAST_GREY) & ~tissue
    counts = np.count_nonzero(still[1:] & ~still[:-1], axis=0)
    runs = np.convolve(counts >= _LEAST_TICKS, np.ones(_WIDTH), "valid") >= _WIDTH
    starts = np.flatnonzero(runs)
    return tuple(int(one) for one in starts[np.argsort(-counts[starts], kind="stable")])


def ruler_at(image: GreyImage, column: int) -> Ruler | None:
    """Returns the ruler whose ticks cover this column and those right of it; None where there is none.

    image: (h, w) uint8.
    """
    grid = _grid(_profile(image, (column, column + _WIDTH)))
    if grid is None:
        return None
    columns = _columns(image, grid[0], column)
    return _measured(image, columns)


def ruler_again(image: GreyImage, known: Ruler) -> Ruler | None:
    """Returns the ruler in place of a known one: `known` itself where it is unchanged, another where its ticks moved.

    Returns None where no ruler that looks like it is seen.
    """
    profile = _profile(image, known.columns)
    if same(profile, known.profile):
        return known
    marks = _marks(profile)
    if _holds(marks, known):
        return known
    found = _measured(image, known.columns)
    return found if found is not None and _alike(found.look, known.look) else None


def same(profile: Array32, before: Array32) -> bool:
    """Returns whether two profiles, (h,), differ in no more rows than a passing mark changes."""
    limit = max(_LEAST_GREY, float(before.max())) * _OF_USUAL
    return bool(np.count_nonzero(np.abs(profile - before) > limit) <= _SAME_ROWS)


def _profile(image: GreyImage, columns: tuple[int, int]) -> Array32:
    """Returns the greys of thin marks, (h,), as the mean over the columns."""
    strip = np.ascontiguousarray(image[:, columns[0] : columns[1]])
    means = cv2.reduce(strip, 1, cv2.REDUCE_AVG, dtype=cv2.CV_32F)
    return np.asarray(cv2.morphologyEx(means, cv2.MORPH_TOPHAT, _THIN), np.float32)[:, 0]


def _marks(profile: Array32) -> Array:
    """Returns the rows of the centres of the marks in a profile, (m,), ascending, px."""
    around = cv2.dilate(profile[:, None], np.ones((2 * _ABOUT + 1, 1), np.uint8))[:, 0]
    peaks = np.flatnonzero((profile >= around) & (profile > _LEAST_GREY))
    peaks = peaks[(peaks >= _ABOUT) & (peaks < profile.size - _ABOUT)]
    if peaks.size:
        peaks = peaks[np.append(True, np.diff(peaks) > _ABOUT)]
        peaks = peaks[profile[peaks] > _OF_USUAL * np.median(profile[peaks])]
    near = peaks[:, None] + np.arange(-_ABOUT, _ABOUT + 1)
    weights = profile[near].astype(np.float64)
    return np.asarray((weights * near).sum(1) / np.maximum(weights.sum(1), 1e-9))


def _grid(profile: Array32) -> tuple[Array, float, float] | None:
    """Finds the longest series of equal distances among the marks: rows of its ticks, spacing and its sigma, px."""
    marks = _marks(profile)
    if not _LEAST_TICKS <= marks.size <= _MOST_MARKS:
        return None
    gaps = np.diff(marks)
    usual = float(np.median(gaps))
    seeds = np.flatnonzero((np.abs(gaps - usual) < max(2 * _STRAY_PX, 0.1 * usual)) & (gaps >= _APART_PX))
    best: tuple[list[float], list[int]] = [], []
    for seed in {int(seeds[place]) for place in (0, seeds.size // 2, -1)} if seeds.size else set[int]():
        row = _row_of(marks.tolist(), seed)
        best = max(best, row, key=lambda one: len(one[0]))
    return _accepted(best, marks, profile.size)


def _row_of(marks: list[float], seed: int) -> tuple[list[float], list[int]]:
    """Returns ticks and their numbers, extended in both directions from a pair of neighbours."""
    rows, numbers = [marks[seed], marks[seed + 1]], [0, 1]
    for onward, beyond in ((True, marks[seed + 2 :]), (False, marks[:seed][::-1])):
        for mark in beyond:
            spacing = (rows[-1] - rows[0]) / (numbers[-1] - numbers[0])
            last, number = (rows[-1], numbers[-1]) if onward else (rows[0], numbers[0])
            steps = round((mark - last) / spacing)
            stray = abs(mark - last - steps * spacing)
            if abs(steps) > _FURTHEST:
                break
            if steps and stray <= max(_STRAY_PX, _STRAY_SHARE * spacing):
                place = len(rows) if onward else 0
                rows.insert(place, mark)
                numbers.insert(place, number + steps)
    return rows, numbers


def _accepted(row: tuple[list[float], list[int]], marks: Array, height: int) -> tuple[Array, float, float] | None:
    rows, numbers = np.array(row[0]), np.array(row[1], np.float64)
    if rows.size < _LEAST_TICKS or rows[-1] - rows[0] < _LEAST_SPAN * height:
        return None
    places = numbers[-1] - numbers[0] + 1
    within = np.count_nonzero((marks > rows[0] - 0.5) & (marks < rows[-1] + 0.5))
    if rows.size < (1 - _MISSING) * places or within - rows.size > _EXTRA * rows.size:
        return None
    # The spacing is the slope of the least-squares line of row against number.
    centred = numbers - numbers.mean()
    spread = float(centred @ centred)
    spacing = float(centred @ rows) / spread
    stray = rows - rows.mean() - spacing * centred
    sd = sqrt(float(stray @ stray) / (rows.size - 2))
    if spacing < _APART_PX or sd > max(_STRAY_PX, _STRAY_SHARE * spacing) / 2:
        return None
    return rows, spacing, max(sd, _ROUNDED_PX) / sqrt(spread)


def _columns(image: GreyImage, rows: Array, column: int) -> tuple[int, int]:
    """Returns the range of columns around this one that the ticks have in common, its end excluded."""
    left = max(column - _LONGEST_PX, 0)
    ticks = _ticks(image[:, left : column + _LONGEST_PX], rows)
    place = column - left
    usual = np.median(ticks[:, place : place + _WIDTH])
    covered = np.mean(ticks > _OF_USUAL * usual, axis=0) >= _HELD
    start, stop = place, place + 1
    while start > 0 and covered[start - 1]:
        start -= 1
    while stop < covered.size and covered[stop]:
        stop += 1
    return left + start, left + max(stop, min(start + _WIDTH, covered.size))


def _ticks(strip: GreyImage, rows: Array) -> Array32:
    """Returns the greys of the ticks at these rows above their surroundings, (n, columns)."""
    thin = cv2.morphologyEx(np.ascontiguousarray(strip), cv2.MORPH_TOPHAT, _THIN).astype(np.float32)
    places = np.clip(np.round(rows).astype(int), 1, strip.shape[0] - 2)
    return np.asarray(np.maximum(np.maximum(thin[places - 1], thin[places]), thin[places + 1]), np.float32)


def _measured(image: GreyImage, columns: tuple[int, int]) -> Ruler | None:
    profile = _profile(image, columns)
    grid = _grid(profile)
    if grid is None:
        return None
    rows, spacing_px, sigma_px = grid
    return Ruler(columns, rows, spacing_px, sigma_px, profile, _look(image, rows, columns))


def _look(image: GreyImage, rows: Array, columns: tuple[int, int]) -> Array32:
    """Returns the cross-section `look` of a `Ruler`; it is 0 beyond the edge of the picture."""
    start, stop = columns[0] - _BESIDE, columns[1] + _BESIDE
    usual = np.median(_ticks(image[:, max(start, 0) : min(stop, image.shape[1])], rows), axis=0)
    left, right = max(-start, 0), max(stop - image.shape[1], 0)
    return np.pad(usual, (left, right)).astype(np.float32)


def _alike(look: Array32, known: Array32) -> bool:
    own = look - look.mean(), known - known.mean()
    power = float(np.linalg.norm(own[0]) * np.linalg.norm(own[1]))
    ratio = float(look.max()) / max(float(known.max()), 1.0)
    return power > 0 and float(own[0] @ own[1]) / power >= _ALIKE and _BRIGHT[0] <= ratio <= _BRIGHT[1]


def _holds(marks: Array, known: Ruler) -> bool:
    """Returns whether the marks are the known ticks, except for a few that are covered or new."""
    if not marks.size:
        return False
    nearest = np.abs(marks[:, None] - known.rows).min(axis=0)
    within = np.count_nonzero((marks > known.rows[0] - 0.5) & (marks < known.rows[-1] + 0.5))
    held = np.count_nonzero(nearest <= _STRAY_PX)
    return bool(held >= _HELD * known.rows.size and within - held <= _EXTRA * known.rows.size)
