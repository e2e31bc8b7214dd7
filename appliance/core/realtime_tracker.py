"""Keeps the keyframe and follows the picture along a chain of keyframes; refuses what it cannot follow."""

from dataclasses import dataclass

import cv2
import numpy as np

from appliance.core.overlay import OverlayMask
from appliance.core.registration import Array, Keyframe, Pyramid, Registration, compose, pyramid
from drivers.samples import GreyImage

ACCEPT_CORRELATION = 0.5
_GOOD_CORRELATION = 0.85
_LEAST_OVERLAP = 0.5
_SEARCH_LEVEL = 2

Warp = tuple[Array, float]
_REST: Warp = (np.zeros(2), 0.0)


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
        self._keyframe: Keyframe | None = None
        self._keyframe_sequence = 0
        self._keyframe_path = _REST
        self._before: tuple[Pyramid, int, Warp] | None = None
        self._warm = _REST
        self._chain = 0

    @property
    def settled(self) -> bool:
        """False while static overlay may still hold the registration back."""
        return self._overlay.settled

    def step(self, image: GreyImage, sequence: int) -> Tracked:
        """Follow the next picture, (h, w) uint8 of constant size."""
        levels = pyramid(image)
        if self._overlay.step(levels) and self._before is not None:
            self._take_keyframe(*self._before)
        tracked = self._follow(levels, sequence)
        self._before = (levels, sequence, tracked.path)
        return tracked

    def renew_keyframe(self) -> None:
        """The Motion Analyzer wants the latest picture as keyframe from now on."""
        if self._before is not None:
            self._take_keyframe(*self._before)

    def restart(self) -> None:
        """Forget the keyframe: what comes next cannot be compared with what came before."""
        self._keyframe = None
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
        return Tracked(self._chain, self._keyframe_sequence, found, path, self._since(path))

    def _since(self, path: Warp) -> Warp:
        assert self._before is not None
        before = self._before[2]
        turned, _ = compose(before, (np.zeros(2), path[1] - before[1]), self._aspect)
        return path[0] - turned, path[1] - before[1]

    def _search(self, keyframe: Keyframe, levels: Pyramid) -> Registration:
        """Warm start first; a zero start and a correlation peak only where the warm one does not convince."""
        best = keyframe.register(levels, self._warm)
        if best.correlation < _GOOD_CORRELATION:
            best = max(best, keyframe.register(levels), key=lambda r: r.correlation)
        if not acceptable(best):
            best = max(best, keyframe.register(levels, self._peak(levels)), key=lambda r: r.correlation)
        return best

    def _peak(self, levels: Pyramid) -> Warp:
        """Whole-picture translation by phase correlation, good to a few pixels over large jumps."""
        assert self._before is not None
        level = min(_SEARCH_LEVEL, len(levels) - 1)
        now, before = levels[level], self._before[0][level]
        window = cv2.createHanningWindow((now.shape[1], now.shape[0]), cv2.CV_32F)
        (dx, dy), _ = cv2.phaseCorrelate(before, now, window)
        jump = np.array([dx, dy]) * 2.0**level
        return self._warm[0] + jump, self._warm[1]

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
    """The self-check: enough of the keyframe in view, and it looks like the keyframe."""
    return found.correlation >= ACCEPT_CORRELATION and found.overlap >= _LEAST_OVERLAP
