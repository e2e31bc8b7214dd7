"""Does a quantity grow? A straight line's slope with the uncertainty that short runs and slow wander give it."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from scipy.special import stdtrit

BLOCKS = 10
"""Readings near each other wander together; medians of blocks this coarse are nearly independent."""
CONFIDENCE = 0.95
TELLING_S = 600.0
"""Memory wanders over minutes: of a run shorter than this a slope tells nothing, however small its interval."""


class Finding(Enum):
    FLAT = "flat"
    GROWS = "grows"
    UNTOLD = "the run is too short to tell"


@dataclass(frozen=True, slots=True)
class Growth:
    """per_h ± error_per_h: slope and half its 95 % interval. first, last: medians of the first and the last block."""

    span_s: float
    per_h: float
    error_per_h: float
    first: float
    last: float

    def finding(self, limit_per_h: float, limit: float) -> Finding:
        """FLAT only if the whole interval is below limit_per_h and the last block is not more than limit above the
        first; GROWS if the whole interval is above, or the blocks tell so. A run below TELLING_S is judged by its
        blocks alone.
        """
        telling = self.span_s >= TELLING_S
        if self.last - self.first > limit or (telling and self.per_h - self.error_per_h > limit_per_h):
            return Finding.GROWS
        return Finding.FLAT if telling and self.per_h + self.error_per_h < limit_per_h else Finding.UNTOLD


def growth(t_s: Sequence[float], values: Sequence[float]) -> Growth:
    """Of readings in the order of time; at least two for each block. Raises ValueError for fewer."""
    if len(values) < 2 * BLOCKS:
        raise ValueError(f"{len(values)} readings are too few, {2 * BLOCKS} are the least")
    hours = np.array([np.mean(block) for block in np.array_split(np.asarray(t_s, float), BLOCKS)]) / 3600
    medians = np.array([np.median(block) for block in np.array_split(np.asarray(values, float), BLOCKS)])
    off = hours - hours.mean()
    slope = float(off @ medians / (off @ off))
    rest = medians - medians.mean() - slope * off
    sigma = float(np.sqrt(rest @ rest / (BLOCKS - 2) / (off @ off)))
    factor = float(stdtrit(BLOCKS - 2, (1 + CONFIDENCE) / 2))
    return Growth(t_s[-1] - t_s[0], slope, factor * sigma, float(medians[0]), float(medians[-1]))
