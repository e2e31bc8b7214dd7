"""Detects one picture fading into another while the hand moves, when no earlier picture shows the present tissue.

A mixture of two pictures has less contrast than either: unlike speckle adds up as noise does, and half of each leaves
1 ÷ √2 of the contrast. So a fade is a dip of the contrast in all parts of the picture at once.
"""

from collections import deque

import numpy as np

from probewatch.appliance.core.detectors.picture_link import contrasts
from probewatch.appliance.core.registration.pyramid import Array32
from probewatch.drivers.rigid import Array

_WITHIN_NS, _HALF_NS = 800_000_000, 400_000_000
"""ns, longest time from before a dip to after it, and the same for a dip that is half as long. Longer times see slower
fades, but tissue of other contrast has come into the picture by then."""
_LEAST_DIP, _MOST_PARTS = 0.15, 0.67
"""Fall of the logarithm of the contrast, and share of the parts in which it falls that far. Fades of .1 to .6 s in
sweeps and fans reached .12 to .29: least when the picture was mirrored, most when it was moved by 15 % or turned by 5°.
Healthy sessions of 8 to 20 s reached .14 at most, in a half space with strong layers swept at 20 mm/s; two recordings
of phantoms and a liver reached .06 (study, one or two seeds). A lower value discards what healthy motion showed; a
higher one misses fades into a similar picture."""
_LEAST_PARTS = 6
"""Fewest parts that must show something throughout: with fewer a corner decides for the whole picture."""
_LEAST_PICTURES = 5
"""The fewest pictures that can hold a dip: two before it, one within and two after it."""


class DoubleExposure:
    """Takes every picture that continues the chain. ended: whether a fade ends with the latest picture."""

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
    """Returns how far the contrast fell, at its lowest and in most of the parts, below both ends of the series.

    The ends are the means of the first two and of the last two pictures.
    levels: (n, parts) logarithms of the contrast of each part, NaN where nothing is shown.
    """
    if len(levels) < _LEAST_PICTURES:
        return 0.0
    shown = np.all(np.isfinite(levels), axis=0)
    if np.count_nonzero(shown) < _LEAST_PARTS:
        return 0.0
    before, within, after = np.split(levels[:, shown], [2, -2])
    ends = np.minimum(before.mean(axis=0), after.mean(axis=0))
    return float(-np.min(np.quantile(within - ends, _MOST_PARTS, axis=1)))
