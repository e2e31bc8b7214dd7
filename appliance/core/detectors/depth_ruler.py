"""Detects from the scanner's own depth ruler that the depth setting has changed; no motion is needed."""

from collections.abc import Callable
from math import hypot

import numpy as np

from probewatch.appliance.core.detectors.detector import Detector
from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.core.detectors.ruler import Ruler, candidates, ruler_again, ruler_at
from probewatch.appliance.core.registration.pyramid import Bits
from probewatch.appliance.types import Check, Fault, VerdictKind

REPORTS_FAULTS = (Fault.SCALE,)

_NEW_DEPTH_PERCENT = 1.5
"""%, change of the spacing from which the depth setting is another, whatever error of the scale the limits tolerate: no
scanner changes its depth in smaller steps, and a ruler is accurate to .1 to .3 %. A lower value asks more of rulers
with few ticks; a higher one misses a change of 3 % on a ruler of six ticks."""
_UNITS = (2.0, 2.5, 4.0, 5.0, 10.0)
"""Ratios of tick units (1, 2, 5, 10, 20, 50 mm). Where the spacing changes by exactly one of them, the ticks may have
another unit at the same depth, so the OK is withdrawn and nothing is named: motion or the zoomed picture must decide.
"""
_UNIT_SLACK = 0.005
"""Relative tolerance about such a ratio; the sigmas are added to it. A larger one leaves new depths unnamed."""
_LOOK_EVERY = 15
"""Pictures between two searches for a ruler that is not known, .5 s at 30 Hz: each search costs .5 ms, and then .1 ms
for each column that is tried, one per picture. Fewer pictures cost more; more learn the ruler later."""
_MOST_COLUMNS = 12
"""Columns that are tried after each search, the fullest first. More find a ruler amid much text, and take longer."""

_BAND_PX = 320_000
"""Pixels that one search covers, a little more than 640 × 480; larger pictures are searched in bands of columns, one
after the other. More pixels cost more in one picture (45 ms for all of 1920 × 1080); fewer learn the ruler later."""
_DRAWN_SHARE = 0.5
"""Share of a ruler's ticks that must lie where nothing ever moves. A lower one keeps for longer a false ruler of
speckle, which the mask covered at rest and leaves within a second of motion; a higher one loses a ruler that something
moving touches. Not measured."""
_GONE = 300
"""Pictures without the ruler after which another is looked for, 10 s at 30 Hz: the scanner may have moved it. Fewer
give up a ruler that a menu covers; more leave changes unseen for longer."""


class DepthRuler(Detector):
    """Compares the ruler's spacing with the spacing at the time when motion last showed both scales.

    It states nothing else about the calibration, and nothing at all where no ruler is found. A change is named once a
    second picture shows it; the first withdraws the OK.
    tissue: the registration's mask, (h, w) bool, None until it is known. confidence_sigma: as in Limits.
    """

    def __init__(self, tissue: Callable[[], Bits | None], scale_limit_percent: float, confidence_sigma: float) -> None:
        self._tissue = tissue
        self._limit = min(_NEW_DEPTH_PERCENT, scale_limit_percent)
        self._confidence = confidence_sigma
        self._shown: Ruler | None = None
        self._known: Ruler | None = None
        self._visible = False
        self._just_changed = False
        self._to_try: list[int] = []
        self._best: Ruler | None = None
        self._wait = self._unseen = self._band = self._known_ns = 0

    def see(self, seen: Observation) -> bool:
        """See Detector."""
        if seen.repeated:
            return False
        if self._shown is None and self._known is not None and not self._is_drawn(self._known):
            self._known = None
        before, found = self._known, None
        if before is not None:
            found = ruler_again(seen.image, before)
        self._visible = found is not None
        self._unseen = 0 if self._visible else self._unseen + 1
        if found is None or before is None:
            if before is None or self._unseen > _GONE:
                self._look_for(seen)
            return False
        self._just_changed = False
        if found is before:
            return False
        self._known, self._known_ns = found, seen.t_ns
        self._to_try.clear()
        changed = abs(found.spacing_px / before.spacing_px - 1) * 100
        self._just_changed = changed > _sigma_percent(found, before) * self._confidence + self._limit
        return self._just_changed

    def on_verified(self, shows: Callable[[Fault], bool], until_ns: int) -> None:
        """See Detector. The current ruler becomes that of the reference, unless it appeared after the motion."""
        if self._known is None or self._known is self._shown or not self._visible or self._known_ns > until_ns:
            return
        if shows(Fault.SCALE):
            self._shown = self._known

    def checks(self) -> tuple[Check, ...]:
        """Returns the check of the spacing, its change in % since motion showed the scales; none without a ruler."""
        if self._shown is None or self._known is None or not self._visible:
            return ()
        ratio = self._known.spacing_px / self._shown.spacing_px
        value, sigma = 100 * (ratio - 1), _sigma_percent(self._known, self._shown)
        room = self._confidence * sigma
        verdict = VerdictKind.OK
        if abs(value) + room > self._limit:
            certain = abs(value) - room > self._limit and not self._just_changed and not self._another_unit(ratio)
            verdict = VerdictKind.FAULT if certain else VerdictKind.NOT_VERIFIED
        return (Check("depth-ruler", Fault.SCALE, value, sigma, "%", self._limit, verdict),)

    def _is_drawn(self, ruler: Ruler) -> bool:
        """Returns whether the ticks lie where nothing ever moves, as far as motion has shown until now.

        Speckle at rest may have marks at equal distances, as a ruler has; motion reveals this before it verifies.
        """
        tissue, (start, stop) = self._tissue(), ruler.columns
        if tissue is None:
            return False
        ticks = tissue[np.round(ruler.rows).astype(int), start:stop]
        return bool(np.count_nonzero(~ticks.all(axis=1)) >= _DRAWN_SHARE * len(ticks))

    def _another_unit(self, ratio: float) -> bool:
        assert self._shown is not None
        assert self._known is not None
        slack = _UNIT_SLACK + self._confidence * _sigma_percent(self._known, self._shown) / 100
        return any(abs(max(ratio, 1 / ratio) / unit - 1) <= slack for unit in _UNITS)

    def _look_for(self, seen: Observation) -> None:
        """Tries one column per picture and keeps the ruler with most ticks, because its long ticks alone are fewer."""
        if self._to_try:
            found = ruler_at(seen.image, self._to_try.pop(0))
            if found is not None and (self._best is None or found.rows.size > self._best.rows.size):
                self._best = found
            if not self._to_try and self._best is not None:
                self._known, self._shown, self._best = self._best, None, None
                self._known_ns = seen.t_ns
                self._visible = True
            return
        tissue, self._wait = self._tissue(), self._wait - 1
        if tissue is None or self._wait > 0 or tissue.shape != seen.image.shape:
            return
        self._wait = _LOOK_EVERY
        bands = -(-tissue.size // _BAND_PX)
        self._band = (self._band + 1) % bands
        width = tissue.shape[1]
        start, stop = width * self._band // bands, width * (self._band + 1) // bands
        columns = candidates(seen.image[:, start:stop], tissue[:, start:stop])
        self._to_try = [start + column for column in _apart(columns)[:_MOST_COLUMNS]]


def _apart(columns: tuple[int, ...]) -> list[int]:
    """Returns the columns without those next to one that comes before them."""
    taken = list[int]()
    for column in columns:
        if all(abs(column - other) > 2 for other in taken):
            taken.append(column)
    return taken


def _sigma_percent(one: Ruler, other: Ruler) -> float:
    return 100 * hypot(one.sigma_px / one.spacing_px, other.sigma_px / other.spacing_px)
