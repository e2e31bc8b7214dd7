"""Keeps the keyframe and follows the picture along a chain of keyframes; refuses what it cannot follow."""

from dataclasses import dataclass

import numpy as np

from appliance.core.registration.keyframe import Keyframe, Registration, compose
from appliance.core.registration.overlay import OverlayMask
from appliance.core.registration.pyramid import Bits, Pyramid, pyramid
from drivers.rigid import Array
from drivers.samples import GreyImage

_LEAST_EVIDENCE, _LEAST_PEAK = 0.62, 0.08
"""Likeness plus twice its peak, and the peak. More refuses good registrations, which breaks the chain; less accepts
those that went astray, which spoils the path. How many of either: `make bench`, the self-check.
"""
_LEAST_OVERLAP = 0.5
"""Share of the keyframe in view. Less lets a border strip speak for the picture; a chain that goes on takes another
keyframe long before (`wants_keyframe`). Not measured.
"""
_LEAST_GAIN = 0.3
"""Contrast of the image ÷ that of the keyframe. Less follows the picture before, which shines through where a scanner
averages over time; more refuses tissue that a shadow or less contact dims. Not measured.
"""
_GOOD_CORRELATION = 0.93
"""Likeness from which nothing is looked for elsewhere. More costs up to three registrations for a picture that was well
followed; less keeps a start that was nearly right. Not measured.
"""
_TURNS_RAD = (0.06, -0.06)
"""Turns that are tried where none convinces, 3.4° either way, for a hand that turned between two pictures. Each costs a
registration. Not measured.
"""

Warp = tuple[Array, float]
_REST: Warp = (np.zeros(2), 0.0)
"""No way and no turn."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """One picture along the chain.

    registration: against the keyframe, None where the picture starts a chain. path: (u px, α rad) against the first
    picture of the chain. step: (u px, α rad) against the picture before, None at the start of a chain.
    chain: number of the chain; it grows by one wherever the picture was lost. reason: why it was lost.
    """

    chain: int
    keyframe: int
    registration: Registration | None
    path: Warp
    step: Warp | None
    reason: str = ""


class RealTimeTracker:
    """Registers each picture to the keyframe; aspect = λ_axial ÷ λ_lateral."""

    def __init__(self, aspect: float) -> None:
        self._aspect = aspect
        self._overlay = OverlayMask()
        self._shape: tuple[int, int] | None = None
        self._keyframe: Keyframe | None = None
        self._keyframe_sequence = 0
        self._keyframe_path = _REST
        self._before: tuple[Pyramid, int, Warp] | None = None
        self._warm = _REST
        self._chain = 0
        self._anchor: tuple[Keyframe, int, Warp] | None = None

    @property
    def settled(self) -> bool:
        """False while static overlay may still hold the registration back."""
        return self._overlay.settled

    @property
    def mask(self) -> Bits | None:
        """(h, w) bool, True where tissue may be seen; None until enough motion was seen."""
        return self._overlay.mask

    def step(self, image: GreyImage, sequence: int) -> Tracked:
        """Follow the next picture, (h, w) uint8. Raises ValueError where its size is not that of the first."""
        levels = pyramid(image)
        self._shape = self._shape or levels.shape
        if levels.shape != self._shape:
            raise ValueError(f"a picture of {levels.shape} px after pictures of {self._shape}: take another tracker")
        if self._overlay.step(levels) and self._before is not None:
            self._take_keyframe(*self._before)
        tracked = self._follow(levels, sequence)
        self._before = (levels, sequence, tracked.path)
        return tracked

    def renew_keyframe(self) -> None:
        """The Motion Analyzer wants the latest picture as keyframe from now on."""
        if self._before is not None:
            self._take_keyframe(*self._before)

    def take_anchor(self) -> None:
        """The latest picture is kept as anchor: a second keyframe, which no motion renews."""
        if self._before is not None:
            levels, _, path = self._before
            self._anchor = (Keyframe(levels, self._aspect, self._overlay.mask), self._chain, path)

    def against_anchor(self) -> Registration | None:
        """The latest picture against the anchor; None where there is none, or the two are not alike."""
        if self._anchor is None or self._before is None:
            return None
        anchor, chain, path = self._anchor
        if not anchor.textured:
            return None
        start = self._between(path, self._before[2]) if chain == self._chain else _REST
        found = anchor.register(self._before[0], start)
        return found if acceptable(found) else None

    def restart(self) -> None:
        """Forget keyframe and anchor: what comes next cannot be compared with what came before."""
        self._keyframe = self._anchor = None
        self._before = None

    def _follow(self, levels: Pyramid, sequence: int) -> Tracked:
        if self._keyframe is None or self._before is None:
            return self._start(levels, sequence, "no keyframe yet")
        if not self._keyframe.textured:
            return self._start(levels, sequence, "picture without structure")
        found = self._search(self._keyframe, levels)
        if not acceptable(found) and self._keyframe_sequence != self._before[1]:
            self._take_keyframe(*self._before)
            found = self._search(self._keyframe, levels) if self._keyframe.textured else found
        if not acceptable(found):
            return self._start(levels, sequence, "picture no longer matches the keyframe")
        self._warm = (found.u_px, found.alpha_rad)
        path = compose(self._keyframe_path, self._warm, self._aspect)
        step = self._between(self._before[2], path)
        return Tracked(self._chain, self._keyframe_sequence, found, path, step)

    def _between(self, before: Warp, path: Warp) -> Warp:
        turned, _ = compose(before, (np.zeros(2), path[1] - before[1]), self._aspect)
        return path[0] - turned, path[1] - before[1]

    def _search(self, keyframe: Keyframe, levels: Pyramid) -> Registration:
        """Warm start first; where that does not convince, wherever the keyframe's middle is seen, turned as well."""
        best = keyframe.register(levels, self._warm)
        if likeness(best) >= _GOOD_CORRELATION:
            return best
        place = keyframe.guess(levels)
        for turn_rad in (0.0, *_TURNS_RAD):
            best = max(best, keyframe.register(levels, (place, turn_rad)), key=likeness)
            if acceptable(best):
                break
        return best

    def _start(self, levels: Pyramid, sequence: int, reason: str) -> Tracked:
        self._chain += 1
        self._take_keyframe(levels, sequence, _REST)
        return Tracked(self._chain, sequence, None, _REST, None, reason)

    def _take_keyframe(self, levels: Pyramid, sequence: int, path: Warp) -> None:
        self._keyframe = Keyframe(levels, self._aspect, self._overlay.mask)
        self._keyframe_sequence = sequence
        self._keyframe_path = path
        self._warm = _REST


def acceptable(found: Registration) -> bool:
    """The self-check, which needs no truth: enough of the keyframe in view, and it looks like the keyframe there and
    not as much a little beside. Where the descent went astray, beside is as good.

    Likeness alone does not do: speckle that has changed and speckle that was never the same can be as much alike, but
    only the first is less alike beside.
    """
    alike = found.peak >= _LEAST_PEAK and likeness(found) + 2 * found.peak >= _LEAST_EVIDENCE
    return found.converged and alike and found.overlap >= _LEAST_OVERLAP


def likeness(found: Registration) -> float:
    """Correlation, but none for a faint image: scanners average over time, so the picture before shines through."""
    return found.correlation if found.gain >= _LEAST_GAIN else 0.0
