"""Sees one picture fade into another while the hand moves, so that no earlier one shows the tissue that is there now.

Two pictures mixed have less contrast than either: speckle of both that is not alike adds up as noise does, and half of
each has 1 ÷ √2 of it. So a fade is a dip of the contrast that all of the picture goes through together.
"""

from collections import deque

import numpy as np

from probewatch.appliance.core.detectors.picture_link import contrasts
from probewatch.appliance.core.registration.pyramid import Array32
from probewatch.drivers.rigid import Array

_WITHIN_NS, _HALF_NS = 800_000_000, 400_000_000
"""From before a dip to after it, at most, and for one that is half as long. Longer sees slower fades, and tissue of
other contrast has come into the picture by then."""
_LEAST_DIP, _MOST_PARTS = 0.15, 0.67
"""Fall of the logarithm of the contrast, and share of the parts that fall so far. Fades of .1 to .6 s in sweeps and
fans came to .12 to .29: mirrored least, moved by 15 % or turned by 5° most; healthy sessions of 8 to 20 s to .14 at
most, a half space with strong layers swept at 20 mm/s; two recordings of phantoms and a liver to .06 (study, one or two
seeds). Less voids what healthy motion showed, more misses fades into what is much alike."""
_LEAST_PARTS = 6
"""Parts that show something in all of it: fewer let a corner speak for the picture."""
_LEAST_PICTURES = 5
"""The fewest pictures that can hold a dip: two before it, one within and two after it."""


class DoubleExposure:
    """Takes every picture that goes on with the chain. ended: whether a fade ends with the latest one."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forgets all pictures taken so far."""
        self._levels: deque[tuple[int, Array]] = deque()
        self.ended = False

    def step(self, t_ns: int, picture: Array32) -> None:
        """Takes a small picture."""
        self._levels.append((t_ns, contrasts(picture)))
        while t_ns - self._levels[0][0] > _WITHIN_NS:
            self._levels.popleft()
        half = sum(at_ns < t_ns - _HALF_NS for at_ns, _ in self._levels)
        levels = np.array([level for _, level in self._levels])
        self.ended = max(_dip(levels), _dip(levels[half:])) >= _LEAST_DIP


def _dip(levels: Array) -> float:
    """How far contrast fell, at its lowest, below both that of the first two pictures and that of the last two, in most
    of the parts.

    levels: (n, parts) logarithms of their contrast, NaN where nothing is shown.
    """
    if len(levels) < _LEAST_PICTURES:
        return 0.0
    shown = np.all(np.isfinite(levels), axis=0)
    if np.count_nonzero(shown) < _LEAST_PARTS:
        return 0.0
    before, within, after = np.split(levels[:, shown], [2, -2])
    ends = np.minimum(before.mean(axis=0), after.mean(axis=0))
    return float(-np.min(np.quantile(within - ends, _MOST_PARTS, axis=1)))
