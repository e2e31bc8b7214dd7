"""Models breathing breath by breath: each has its own length, depth and level, and all of them have one shape.

The spectrum of breaths that differ by a tenth from one another covers nearly all of a press of a similar rate; but what
all breaths have in common can be distinguished from such a press (docs/method.md, section 7). The uncertainty of each
length, depth and level goes into the covariance of the path, so nothing is claimed from motion that a breath could
explain.

Over 30 s in the plane, with 4 mm of breathing and a pulse, sigma of the axial scale is .45 to .8 %. It is 3.1 to 3.3 %
with a spectrum of breathing and pulse instead, and 1.7 to 2.2 % with a rhythm of the pulse alone; the bound with the
tissue known is .24 %.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.path.blocks import Blocks
from probewatch.appliance.core.path.noise import Habit
from probewatch.drivers.rigid import Array

_LEAST_BREATHS = 2
"""Least number of whole breaths. Fewer do not separate a shape from their own lengths and depths."""
_LEAST_MORE = 1
"""Least number of whole breaths where the shape is known from before. With none at all, length and level are left to
the scale.
"""
_LEAST_DEPTH_MM = 1.0
"""Least depth of breathing, mm. Less may as well be the drift of a path; a scale that it hides stays hidden. Not
measured.
"""
_SHORTEST_S = 1.5
"""Shortest breath, s: 40 a minute, an infant's. Shorter ones can hardly be distinguished from a press."""
_PROMINENCE = 0.5
"""Least prominence of the end of a breath, in usual depths. Less takes a pause for an end, more leaves shallow breaths
out.
"""
_HARMONICS = 2 * np.pi * np.arange(1, 5)[:, None]
"""Harmonics of the shape, rad. There are four, as breathing in takes about a quarter of a breath."""
_COEFFICIENTS = 2 * len(_HARMONICS)  # a cosine and a sine of each
_SHAPE_AGAIN = 0.1
"""Standard deviation of the shape's coefficients, in usual depths, where the shape was learned from earlier breaths.
With .2 and .05, sigma of the axial scale after 10 s in the plane was 2.2 and 2.1, 2.3 and 2.0 % (two seeds). Where the
patient breathes otherwise than before (twice as deep, as a sine, faster), z-scores over 8 to 13 s were 1.5 RMS and
less, and 2.0 where the breathing had turned upside down (eight seeds each, paths without pictures).
"""
_END_S, _DEPTH, _LEVEL, _SHAPE, _MIDDLE = 0.4, 0.3, 0.3, 0.3, 0.1
"""Standard deviations of what is not known of a breath: the time at which it ends, s; its depth, its level and the
coefficients of the shape, in usual depths; and the place of its middle, in lengths. They are twice and more of how much
quiet breaths differ; sigma changes by a hundredth where depths and ends are ten times as free.
"""


@dataclass(frozen=True, eq=False)
class Breaths:
    """Represents the breaths in one row of a path of m blocks.

    ends_s: (n,) where the k breaths begin and end, those of a chain one after the other. first: (k,) index of each
    breath's beginning among them. number: (m,) breath of each block. inside: (m,) whether the block is in one. usual:
    (p,) what is believed of ends (n), depths (k), levels (n), shape (8) and middles (k) before they are fitted. sd:
    (p,) its standard deviation.
    """

    ends_s: Array
    first: NDArray[np.intp]
    number: NDArray[np.intp]
    inside: NDArray[np.bool_]
    usual: Array
    sd: Array

    @classmethod
    def found(cls, blocks: Blocks, breathing_mm: Array, habit: Habit | None = None) -> "Breaths | None":
        """Finds breaths; returns None where there are too few. breathing_mm: (m,) what is most likely breathing. habit:
        that of earlier breaths.
        """
        centred = blocks.without_offsets(breathing_mm)
        size_mm, rises = _size_and_sense(centred if habit is None else _wave(habit.shape_mm))
        ends, first = list[float](), list[int]()
        number, inside, whole = np.zeros(len(blocks), dtype=np.intp), np.zeros(len(blocks), dtype=np.bool_), 0
        # The turns of each chain, extended beyond its ends, delimit its breaths, which are numbered through all chains.
        for chain in np.unique(blocks.chain):
            own = blocks.chain == chain
            turns_s = _turns(blocks.t_s[own], -centred[own] if rises else centred[own], _PROMINENCE * size_mm)
            if turns_s.size < (2 if habit is None else 1):
                continue
            whole += turns_s.size - 1
            usual_s = float(np.median(np.diff(turns_s))) if habit is None else habit.length_s
            turns_s = _continued(turns_s, blocks.t_s[own], usual_s)
            number[own] = len(first) + np.searchsorted(turns_s, blocks.t_s[own], side="right") - 1
            inside |= own
            first += [len(ends) + k for k in range(turns_s.size - 1)]
            ends += list(turns_s)
        if whole < (_LEAST_BREATHS if habit is None else _LEAST_MORE) or size_mm < _LEAST_DEPTH_MM:
            return None
        n, k = len(ends), len(first)
        shape = np.zeros(_COEFFICIENTS) if habit is None else habit.shape_mm
        usual = np.concatenate([np.zeros(n), np.ones(k), np.zeros(n), shape, np.zeros(k)])
        shape_sd = (_SHAPE if habit is None else _SHAPE_AGAIN) * size_mm
        each = (_END_S, n), (_DEPTH, k), (_LEVEL * size_mm, n), (shape_sd, shape.size), (_MIDDLE, k)
        sd = np.concatenate([np.full(count, one) for one, count in each])
        breaths = cls(np.array(ends), np.array(first), number, inside, usual, sd)
        return breaths if habit is not None else replace(breaths, usual=breaths._shaped(blocks, centred))

    @property
    def _shape(self) -> slice:
        """Returns the part of the state that is the shape."""
        return slice(2 * self.ends_s.size + self.first.size, -self.first.size)

    def habit(self, state: Array) -> Habit:
        """Returns what these breaths have in common, by their state (p,)."""
        n, k = self.ends_s.size, self.first.size
        ends_s, depths = self.ends_s + state[:n], state[n : n + k]
        length_s = float(np.median(ends_s[self.first + 1] - ends_s[self.first]))
        return Habit(state[self._shape] * float(np.median(depths)), max(length_s, _SHORTEST_S))

    def _shaped(self, blocks: Blocks, breathing_mm: Array) -> Array:
        """Returns `usual` with the shape that fits best."""
        _, slopes = self.linear(blocks.t_s, self.usual)
        columns = blocks.without_offsets(slopes[self._shape])
        usual = self.usual.copy()
        learned_mm = blocks.without_offsets(breathing_mm * self.inside)
        usual[self._shape] = np.linalg.lstsq(columns.T, learned_mm, rcond=None)[0]
        return usual

    def linear(self, t_s: Array, state: Array) -> tuple[Array, Array]:
        """Returns the breathing of (22b), (m,) mm, and its derivatives by the state, (p, m), at the state (p,)."""
        n, k, number, begin = self.ends_s.size, self.first.size, self.number, self.first[self.number]
        moved, depth, level, shape, middle = np.split(state, np.cumsum([n, k, n, 2 * len(_HARMONICS)]))
        ends_s, depth, middle = self.ends_s + moved, depth[number], middle[number]
        length_s = np.maximum(ends_s[begin + 1] - ends_s[begin], _SHORTEST_S / 2)
        share = (t_s - ends_s[begin]) / length_s
        angle = _HARMONICS * (share + middle * np.sin(2 * np.pi * share))
        wave = np.concatenate([np.cos(angle) - 1, np.sin(angle)])
        slope = depth * (shape @ np.concatenate([-_HARMONICS * np.sin(angle), _HARMONICS * np.cos(angle)]))
        bent = 1 + 2 * np.pi * middle * np.cos(2 * np.pi * share)
        rate = (slope * bent + level[begin + 1] - level[begin]) / length_s
        breath = np.arange(k)[:, None] == number
        starts, stops = (np.arange(n)[:, None] == index for index in (begin, begin + 1))
        path = depth * (shape @ wave) + (1 - share) * level[begin] + share * level[begin + 1]
        # In the order of the state: ends, depths, levels, shape, middles.
        slopes = [
            starts * (share - 1) * rate - stops * share * rate,
            breath * (shape @ wave),
            starts * (1 - share) + stops * share,
            depth * wave,
            breath * slope * np.sin(2 * np.pi * share),
        ]
        return path * self.inside, np.concatenate(slopes) * self.inside


def _wave(shape_mm: Array) -> Array:
    """Returns one breath of that shape, (n,) mm."""
    angle = _HARMONICS * np.linspace(0, 1, 40, endpoint=False)
    return np.asarray(shape_mm @ np.concatenate([np.cos(angle) - 1, np.sin(angle)]))


def _size_and_sense(breathing_mm: Array) -> tuple[float, bool]:
    """Returns the depth, mm, and whether a breath begins and ends low. Breathing turns quickly where a breath begins
    and ends, so it stays on that side for less than half of the time.
    """
    low, middle, high = np.quantile(breathing_mm, [0.05, 0.5, 0.95])
    return float(high - low), bool(middle > (low + high) / 2)


def _turns(t_s: Array, values: Array, prominence: float) -> Array:
    if t_s.size < 3:  # A chain of one or two blocks has no turn.
        return t_s[:0]
    apart = max(1, round(_SHORTEST_S / max(float(np.median(np.diff(t_s))), 1e-3)))
    return np.asarray(t_s[peaks(values, apart, prominence)])


def peaks(values: Array, apart: int, prominence: float) -> NDArray[np.intp]:
    """Returns the indices of the local maxima of `values` (n,) that stand out by `prominence`. Of two that are nearer
    to each other than `apart` the higher one is kept; a level top counts at its middle.

    The result is that of scipy.signal.find_peaks, with which the tests compare it. Importing that takes longer than
    everything else that an estimator must import to start again: 1.3 of 2.3 s, while the room waits.
    """
    starts = np.flatnonzero(np.diff(values, prepend=np.nan) != 0)
    levels, ends = values[starts], np.append(starts[1:], values.size) - 1
    top = 1 + np.flatnonzero((levels[1:-1] > levels[:-2]) & (levels[1:-1] > levels[2:]))
    found = (starts[top] + ends[top]) // 2
    kept = np.ones(found.size, dtype=np.bool_)
    for one in np.argsort(values[found])[::-1]:
        if kept[one]:
            kept &= (np.abs(found - found[one]) >= apart) | (found == found[one])
    return np.array([at for at in found[kept] if _prominence(values, at) >= prominence], dtype=np.intp)


def _prominence(values: Array, peak: int) -> float:
    """Returns how far the values fall from a peak before they rise above it or end, on the side where they fall
    less.
    """
    higher = np.flatnonzero(values > values[peak])
    after = int(np.searchsorted(higher, peak))
    left = higher[after - 1] + 1 if after else 0
    right = higher[after] if after < higher.size else values.size
    return float(values[peak] - max(values[left : peak + 1].min(), values[peak:right].min()))


def _continued(turns_s: Array, t_s: Array, usual_s: float) -> Array:
    """Returns the turns, extended on both sides at the usual distance by as many as t_s (m,) needs."""
    before = int(np.ceil(max(turns_s[0] - t_s[0], 0.0) / usual_s))
    after = int(np.floor(max(t_s[-1] - turns_s[-1], 0.0) / usual_s)) + 1
    return np.concatenate(
        [
            turns_s[0] - usual_s * np.arange(before, 0, -1),
            turns_s,
            turns_s[-1] + usual_s * np.arange(1, after + 1),
        ]
    )
