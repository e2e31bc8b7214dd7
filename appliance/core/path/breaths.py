"""Breathing followed breath by breath: each has its own length, depth and level, and all of them have one shape.

Breaths that differ by a tenth from one another leave little of a press of a similar rate that their spectrum does not
cover; but what all of them have in common can be told from it (docs/method.md, section 7). How uncertain each length,
depth and level is goes into the covariance of the path, so nothing is claimed of motion that a breath could explain.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from appliance.core.path.noise import Blocks
from drivers.rigid import Array

_LEAST_BREATHS = 2
"""Whole ones. Fewer do not tell a shape from their own lengths and depths."""
_LEAST_DEPTH_MM = 1.0
"""Of breathing. Less is as soon the drift of a path; a scale that it hides stays hidden. Not measured."""
_SHORTEST_S = 1.5
"""Of a breath: 40 a minute, an infant's. Shorter ones are hardly to be told from a press."""
_PROMINENCE = 0.5
"""Of the end of a breath, in usual depths. Less takes a pause for an end, more leaves shallow breaths out."""
_HARMONICS = 2 * np.pi * np.arange(1, 5)[:, None]
"""Of the shape: breathing in takes about a quarter of a breath."""
_END_S, _DEPTH, _LEVEL, _SHAPE, _MIDDLE = 0.4, 0.3, 0.3, 0.3, 0.1
"""Standard deviation of what is not known of a breath: where it ends, s; its depth, level and the coefficients of the
shape, in usual depths; where its middle lies, in lengths. Twice and more of how quiet breaths differ; sigma changes by
a hundredth where depths and ends are ten times as free.
"""


@dataclass(frozen=True, eq=False)
class Breaths:
    """Of one row of a path in m blocks. ends_s: (n,) where the k breaths begin and end, those of a chain one after the
    other. first: (k,) of each breath's beginning among them. number: (m,) breath of each block. inside: (m,) whether it
    is in one. usual: (p,) what is believed of ends (n), depths (k), levels (n), shape (8) and middles (k) before they
    are fitted. sd: (p,) its standard deviation.
    """

    ends_s: Array
    first: NDArray[np.intp]
    number: NDArray[np.intp]
    inside: NDArray[np.bool_]
    usual: Array
    sd: Array

    @classmethod
    def found(cls, blocks: Blocks, breathing_mm: Array) -> "Breaths | None":
        """breathing_mm: (m,) what is most likely breathing. None where there are too few breaths."""
        centred = blocks.without_offsets(breathing_mm)
        low, middle, high = np.quantile(centred, [0.05, 0.5, 0.95])
        # A breath ends where it turns quickly, which is where it stays for less than half of the time.
        upside_down = -centred if middle > (low + high) / 2 else centred
        ends, first = list[float](), list[int]()
        number, inside, whole = np.zeros(len(blocks), dtype=np.intp), np.zeros(len(blocks), dtype=np.bool_), 0
        for chain in np.unique(blocks.chain):
            own = blocks.chain == chain
            turns_s = _turns(blocks.t_s[own], upside_down[own], _PROMINENCE * float(high - low))
            if turns_s.size < 2:
                continue
            whole += turns_s.size - 1
            turns_s = _continued(turns_s, blocks.t_s[own])
            number[own] = len(first) + np.searchsorted(turns_s, blocks.t_s[own], side="right") - 1
            inside |= own
            first += [len(ends) + k for k in range(turns_s.size - 1)]
            ends += list(turns_s)
        if whole < _LEAST_BREATHS or high - low < _LEAST_DEPTH_MM:
            return None
        n, k, size_mm = len(ends), len(first), float(high - low)
        shape = np.zeros(2 * len(_HARMONICS))
        usual = np.concatenate([np.zeros(n), np.ones(k), np.zeros(n), shape, np.zeros(k)])
        each = (_END_S, n), (_DEPTH, k), (_LEVEL * size_mm, n), (_SHAPE * size_mm, shape.size), (_MIDDLE, k)
        sd = np.concatenate([np.full(count, one) for one, count in each])
        breaths = cls(np.array(ends), np.array(first), number, inside, usual, sd)
        return replace(breaths, usual=breaths._shaped(blocks, centred))

    def _shaped(self, blocks: Blocks, breathing_mm: Array) -> Array:
        """`usual` with the shape that fits best."""
        shape = slice(2 * self.ends_s.size + self.first.size, -self.first.size)
        _, slopes = self.linear(blocks.t_s, self.usual)
        columns = blocks.without_offsets(slopes[shape])
        usual = self.usual.copy()
        usual[shape] = np.linalg.lstsq(columns.T, blocks.without_offsets(breathing_mm * self.inside), rcond=None)[0]
        return usual

    def linear(self, t_s: Array, state: Array) -> tuple[Array, Array]:
        """(m,) mm of breathing, and (p, m) its derivatives, by the state (p,)."""
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
        slopes = [
            starts * (share - 1) * rate - stops * share * rate,
            breath * (shape @ wave),
            starts * (1 - share) + stops * share,
            depth * wave,
            breath * slope * np.sin(2 * np.pi * share),
        ]
        return path * self.inside, np.concatenate(slopes) * self.inside


def _turns(t_s: Array, values: Array, prominence: float) -> Array:
    apart = max(1, round(_SHORTEST_S / max(float(np.median(np.diff(t_s))), 1e-3)))
    return np.asarray(t_s[find_peaks(values, distance=apart, prominence=prominence)[0]])


def _continued(turns_s: Array, t_s: Array) -> Array:
    """With as many breaths of the usual length at both sides as t_s (m,) asks for."""
    usual_s = float(np.median(np.diff(turns_s)))
    before = int(np.ceil(max(turns_s[0] - t_s[0], 0.0) / usual_s))
    after = int(np.floor(max(t_s[-1] - turns_s[-1], 0.0) / usual_s)) + 1
    return np.concatenate(
        [
            turns_s[0] - usual_s * np.arange(before, 0, -1),
            turns_s,
            turns_s[-1] + usual_s * np.arange(1, after + 1),
        ]
    )
