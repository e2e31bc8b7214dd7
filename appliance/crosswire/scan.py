"""The scan of a cross-wire: from samples to views, one for each passage of the picture plane through it. Pure.

Within a passage the spot is narrowest where the plane meets the crossing. Its squared spread is a parabola in the
distance, so three pictures give the instant between them at which pose and centre are taken; a plane that is early is
then as likely as one that is late, and no distance is mistaken for ζ.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from appliance.core.acquisition.pairing import Pairing
from appliance.crosswire.crossing import Crossing, Drawings, NoCrossing, find_crossing
from appliance.types import StampedPair, Vector
from drivers.rigid import interpolate
from drivers.samples import Frame, Matrix4, Pose

_HALF_WINDOW_NS = 250_000_000
"""Either side of a passage that gives one view. Shorter lets noise in the width make two of one; longer loses a hand's
quick way back. Not measured.
"""
_LARGEST_STEP_NS = 150_000_000
"""Between the three pictures of a passage: further apart its instant is guessed. Shorter loses those beside a picture
without a spot; at 20 Hz two in a row may be missing.
"""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The crossing seen once. centre_px, sigma_px: (2,) as in Crossing. matrix: (4, 4) sensor → tracker, mm."""

    t_ns: int
    centre_px: Vector
    sigma_px: Vector
    matrix: Matrix4


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
    """One paired picture. spread: of the spot squared, px², infinite where the wires show apart, NaN without spot."""

    t_ns: int
    matrix: Matrix4
    crossing: Crossing | None
    spread: float


class CrosswireScan:
    """Takes frames and poses in time order. latency_ms: of the tracker, positive where it is late.

    pictures, sightings: counts so far. refused: reason → pictures without a sighting. size_px: (width, height).
    """

    def __init__(self, latency_ms: float = 0.0) -> None:
        self._pairing = Pairing()
        self._pairing.latency_ns = round(latency_ms * 1e6)
        self._drawings = Drawings()
        self._looks: list[_Look] = []
        self.pictures = self.sightings = 0
        self.refused: Counter[str] = Counter()
        self.size_px: tuple[int, int] | None = None

    def step(self, sample: Frame | Pose) -> None:
        """Take the next sample."""
        if isinstance(sample, Frame):
            self.pictures += 1
            self.size_px = sample.image.shape[1], sample.image.shape[0]
        for item in self._pairing.step(sample):
            if isinstance(item, StampedPair):
                self._look(item)
            else:
                self.refused[item.reason] += 1

    def views(self) -> tuple[View, ...]:
        """One view for every passage that was seen from both sides."""
        narrowest = (index for index in range(1, len(self._looks) - 1) if self._is_passage(index))
        return tuple(self._view(index) for index in narrowest)

    def _look(self, pair: StampedPair) -> None:
        drawn = self._drawings.step(pair.frame.image)
        found = find_crossing(pair.frame.image, drawn)
        if isinstance(found, Crossing):
            self.sightings += 1
            self._looks.append(_Look(pair.stamp.t_ns, pair.matrix, found, found.spread_px**2))
        else:
            self.refused[found.value] += 1
            spread = np.inf if found is NoCrossing.PARTED else np.nan
            self._looks.append(_Look(pair.stamp.t_ns, pair.matrix, None, spread))

    def _is_passage(self, index: int) -> bool:
        """Narrower than the pictures next to it and than all within the window; NaN compares false."""
        here = self._looks[index]
        before, after = self._looks[index - 1], self._looks[index + 1]
        if here.crossing is None or max(here.t_ns - before.t_ns, after.t_ns - here.t_ns) > _LARGEST_STEP_NS:
            return False
        return before.spread > here.spread <= after.spread and here.spread <= self._least_around(index)

    def _least_around(self, index: int) -> float:
        here_ns = self._looks[index].t_ns
        first, last = index, index
        while first > 0 and here_ns - self._looks[first - 1].t_ns <= _HALF_WINDOW_NS:
            first -= 1
        while last < len(self._looks) - 1 and self._looks[last + 1].t_ns - here_ns <= _HALF_WINDOW_NS:
            last += 1
        return min(look.spread for look in self._looks[first : last + 1] if look.crossing is not None)

    def _view(self, index: int) -> View:
        before, here, after = self._looks[index - 1 : index + 2]
        assert here.crossing is not None
        crossing, fraction = here.crossing, _vertex(before.spread, here.spread, after.spread)
        other = after if fraction > 0 else before
        if other.crossing is None:
            return View(here.t_ns, crossing.centre_px, crossing.sigma_px, here.matrix)
        part = abs(fraction)
        return View(
            here.t_ns + round(part * (other.t_ns - here.t_ns)),
            (1 - part) * crossing.centre_px + part * other.crossing.centre_px,
            crossing.sigma_px,
            interpolate(here.matrix, other.matrix, part),
        )


def _vertex(before: float, here: float, after: float) -> float:
    """Where the parabola through three equidistant values is least, -½ … ½; 0 where a neighbour is infinite."""
    bend = before - 2 * here + after
    if not np.isfinite(bend) or bend <= 0:
        return 0.0
    return 0.5 * (before - after) / bend
