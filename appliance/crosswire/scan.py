"""Derives views from the samples of a cross-wire scan, one for each passage of the picture plane through it. Pure.

Within a passage the spot is narrowest where the plane meets the crossing. Its squared spread is a parabola in the
distance, so three pictures give the instant between them at which pose and centre are taken; a plane that is early is
then as likely as one that is late, and no distance is mistaken for ζ.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from probewatch.appliance.core.acquisition.pairing import Pairing
from probewatch.appliance.crosswire.crossing import ROUGH_SCALE_MM_PER_PX, Crossing, Missed, NoCrossing, find_crossing
from probewatch.appliance.crosswire.drawings import Drawings
from probewatch.appliance.types import StampedPair, Vector
from probewatch.drivers.rigid import interpolate
from probewatch.drivers.samples import Frame, Matrix4, Pose

_HALF_WINDOW_NS = 250_000_000
"""Time, ns, to either side of a passage that gives one view. Shorter lets noise in the width make two of one; longer
loses a hand's quick way back. Not measured."""
_LARGEST_STEP_NS = 150_000_000
"""Time, ns, between the three pictures of a passage, at most: further apart its instant would be guessed. Shorter loses
passages beside a picture without a spot; at 20 Hz two in a row may be missing."""
_WIDENS = 1.35
"""Factor by which the squared spread must grow to either side of a passage within the window: at 2 mm/s that of wires
at 45° grows by half, at 4 mm/s they part. More loses slow passages, less takes bubbles, whose spread fluctuates as they
fade (tests/appliance/crosswire/test_scan.py)."""
_AROUND_NS = 100_000_000
"""Greatest distance, ns, from a passage of the poses that give its speed. Further apart they show where the hand turns
back, nearer the tracker's noise. Not varied."""
_PARTS_MM = 1.0
"""mm by which wires must part again on either side for their nearest approach to be one: three of a spot's widths."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Represents one sighting of the crossing. centre_px, covariance_px: as in Crossing. matrix: (4, 4) sensor →
    tracker, mm.

    earlier, later: (4, 4) poses of pictures around it, apart_s between them, for the derivative by latency; None where
    unknown. confidence: that of its picture, 0 … 1.
    """

    t_ns: int
    centre_px: Vector
    covariance_px: Vector
    matrix: Matrix4
    earlier: Matrix4 | None = None
    later: Matrix4 | None = None
    apart_s: float = 0.0
    confidence: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """Represents one paired picture and what was found in it. matrix: (4, 4) sensor → tracker, mm."""

    t_ns: int
    matrix: Matrix4
    found: Crossing | Missed
    gap_mm: float

    @property
    def spread(self) -> float:
        """Returns the squared spread of the spot, px²; infinite where the wires appear apart, NaN without a spot."""
        if isinstance(self.found, Crossing):
            return self.found.spread_px**2
        return np.inf if self.found.reason is NoCrossing.PARTED else np.nan


class CrosswireScan:
    """Takes frames and poses in time order. latency_ms: that of the tracker, positive where it is late.

    scale_mm_per_px: (lateral, axial) of the pictures, right within a factor of two. pictures, sightings: counts so far.
    refused: reason → pictures without a sighting. size_px: (width, height). views: one for each passage so far.
    misses_mm: how far the wires stayed apart where they came nearest and did not meet. last: what the newest paired
    picture showed.
    """

    def __init__(self, latency_ms: float = 0.0, scale_mm_per_px: tuple[float, float] = ROUGH_SCALE_MM_PER_PX) -> None:
        self._pairing = Pairing()
        self._pairing.latency_ns = round(latency_ms * 1e6)
        self._drawings = Drawings()
        self._scale = scale_mm_per_px
        self._looks: list[Look] = []
        self._settled = 0
        self.pictures = self.sightings = 0
        self.refused: Counter[str] = Counter()
        self.size_px: tuple[int, int] | None = None
        self.views: list[View] = []
        self.misses_mm: list[float] = []
        self.last: Look | None = None

    def step(self, sample: Frame | Pose) -> tuple[View, ...]:
        """Takes the next sample. Returns the views that it settles, a quarter of a second after their passage."""
        if isinstance(sample, Frame):
            self.pictures += 1
            self.size_px = sample.image.shape[1], sample.image.shape[0]
        for item in self._pairing.step(sample):
            if isinstance(item, StampedPair):
                self._look(item)
            else:
                self.refused[item.reason] += 1
        return self._settle(_HALF_WINDOW_NS)

    def finish(self) -> tuple[View, ...]:
        """Ends the scan. Returns the views of its last quarter of a second."""
        return self._settle(0)

    def _look(self, pair: StampedPair) -> None:
        drawn = self._drawings.step(pair.frame.image)
        found = find_crossing(pair.frame.image, drawn, self._scale)
        gap_mm = np.nan
        if isinstance(found, Crossing):
            self.sightings += 1
        else:
            self.refused[found.reason.value] += 1
            if found.reason is NoCrossing.PARTED and len(found.spots_px) == 2:
                gap_mm = float(np.linalg.norm((found.spots_px[1] - found.spots_px[0]) * self._scale))
        self.last = Look(pair.stamp.t_ns, pair.matrix, found, gap_mm)
        self._looks.append(self.last)

    def _settle(self, younger_ns: int) -> tuple[View, ...]:
        """Decides on the looks that are old enough, and forgets those that no passage can need any more."""
        new = []
        while self._settled < len(self._looks) and self._looks[-1].t_ns - self._looks[self._settled].t_ns >= younger_ns:
            if self._is_passage(self._settled):
                new.append(self._view(self._settled))
            elif self._is_miss(self._settled):
                self.misses_mm.append(self._looks[self._settled].gap_mm)
            self._settled += 1
        while self._settled > 1 and self._looks[self._settled - 1].t_ns - self._looks[0].t_ns > 2 * _HALF_WINDOW_NS:
            del self._looks[0]
            self._settled -= 1
        self.views += new
        return tuple(new)

    def _is_passage(self, index: int) -> bool:
        """Returns whether the spot is narrower than next to it and than all within the window; NaN compares false."""
        if not 0 < index < len(self._looks) - 1:
            return False
        here = self._looks[index]
        before, after = self._looks[index - 1], self._looks[index + 1]
        if not isinstance(here.found, Crossing):
            return False
        if max(here.t_ns - before.t_ns, after.t_ns - here.t_ns) > _LARGEST_STEP_NS:
            return False
        around = self._around(index)
        spreads = [look.spread for look in around if isinstance(look.found, Crossing)]
        if not (before.spread > here.spread <= after.spread and here.spread <= min(spreads)):
            return False
        # Wires part on either side; what stays one spot until it is gone is a bubble or the end of something.
        wider = here.spread * _WIDENS
        return any(look.spread > wider for look in around if look.t_ns < here.t_ns) and any(
            look.spread > wider for look in around if look.t_ns > here.t_ns
        )

    def _is_miss(self, index: int) -> bool:
        """Returns whether the wires come nearest here, and part again on either side without having met."""
        around, here = self._around(index), self._looks[index]
        if not here.gap_mm <= np.nanmin([look.gap_mm for look in around] + [np.inf]):
            return False
        if any(isinstance(look.found, Crossing) for look in around):
            return False
        before = [look.gap_mm for look in around if look.t_ns < here.t_ns]
        after = [look.gap_mm for look in around if look.t_ns > here.t_ns]
        return all(len(side) > 0 and np.nanmax([*side, 0.0]) > here.gap_mm + _PARTS_MM for side in (before, after))

    def _around(self, index: int, within_ns: int = _HALF_WINDOW_NS) -> list[Look]:
        here_ns = self._looks[index].t_ns
        first, last = index, index
        while first > 0 and here_ns - self._looks[first - 1].t_ns <= within_ns:
            first -= 1
        while last < len(self._looks) - 1 and self._looks[last + 1].t_ns - here_ns <= within_ns:
            last += 1
        return self._looks[first : last + 1]

    def _view(self, index: int) -> View:
        # Pose and centre are interpolated to the instant at which the squared spread is least.
        before, here, after = self._looks[index - 1 : index + 2]
        assert isinstance(here.found, Crossing)
        crossing, part, t_ns, matrix, centre = here.found, 0.0, here.t_ns, here.matrix, here.found.centre_px
        fraction = _vertex(before.spread, here.spread, after.spread)
        other = after if fraction > 0 else before
        if isinstance(other.found, Crossing):
            part = abs(fraction)
            t_ns = here.t_ns + round(part * (other.t_ns - here.t_ns))
            centre = (1 - part) * crossing.centre_px + part * other.found.centre_px
            matrix = interpolate(here.matrix, other.matrix, part)
        near = self._around(index, _AROUND_NS)
        apart_s = (near[-1].t_ns - near[0].t_ns) / 1e9
        return View(
            t_ns, centre, crossing.covariance_px, matrix, near[0].matrix, near[-1].matrix, apart_s, crossing.confidence
        )


def _vertex(before: float, here: float, after: float) -> float:
    """Returns where the parabola through three equidistant values is least, -½ … ½; 0 where a neighbour is infinite."""
    bend = before - 2 * here + after
    if not np.isfinite(bend) or bend <= 0:
        return 0.0
    return 0.5 * (before - after) / bend
