"""Keeps the keyframe and follows the picture along a chain of keyframes; refuses what it cannot follow."""

from dataclasses import dataclass

import numpy as np

from probewatch.appliance.core.registration.keyframe import Keyframe, Registration, compose
from probewatch.appliance.core.registration.overlay import OverlayMask
from probewatch.appliance.core.registration.pyramid import Bits, Pyramid, pyramid
from probewatch.appliance.core.registration.shadow import Shadows
from probewatch.appliance.types import DRAGS, PRESSES, TissuePath
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import GreyImage

_LEAST_EVIDENCE, _LEAST_PEAK = 0.62, 0.08
"""Least sum of the likeness and twice its peak, and least peak. Higher values refuse good registrations, which breaks
the chain; lower ones accept those that went astray, which spoils the path. `make bench`, the self-check, shows how many
of either there are.
"""
_LEAST_OVERLAP = 0.5
"""Least share of the keyframe in view. A lower one lets a strip at the border decide for the picture; a chain that
continues takes another keyframe long before (`wants_keyframe`). Not measured.
"""
_LEAST_GAIN = 0.3
"""Least contrast of the image ÷ that of the keyframe. A lower one follows the picture before, which shines through
where a scanner averages over time; a higher one refuses tissue that a shadow or less contact dims. Not measured. """
_GOOD_CORRELATION = 0.93
"""Likeness from which no other place is searched. A higher one costs up to three registrations for a picture that was
followed well; a lower one keeps a start that was only nearly right. Not measured.
"""
_TURNS_RAD = (0.06, -0.06)
"""Turns that are tried where no registration convinces, 3.4° either way, for a hand that turned between two pictures.
Each costs a registration. Not measured.
"""

_GAINED = 0.02
"""Likeness by which such a registration must exceed an acceptable one. A higher one keeps a registration that is too
stiff or went astray; a lower one takes a looser one, which errs more, for a better one. Not varied by itself."""

Warp = tuple[Array, float]
_REST: Warp = (np.zeros(2), 0.0)
"""No displacement and no turn."""
START = TissuePath(np.zeros((4, 2)), np.zeros(4), np.zeros(4), 0.0)
"""The path at the first picture of a chain."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """Holds one picture along the chain.

    registration: against the keyframe, None where the picture starts a chain. path: (u px, α rad) against the first
    picture of the chain. step: (u px, α rad) against the picture before, None at the start of a chain.
    chain: number of the chain, which grows by one wherever the picture was lost. reason: why it was lost. tissue: the
    paths by what tissue may do. keyframe: sequence number of the keyframe.
    """

    chain: int
    keyframe: int
    registration: Registration | None
    path: Warp
    step: Warp | None
    reason: str = ""
    tissue: TissuePath = START


class RealTimeTracker:
    """Registers each picture to the keyframe.

    aspect: λ_axial ÷ λ_lateral. axial_mm_per_px: None where it is unknown. may: what the tissue may do, as bits, by the
    motion so far. What it is known not to do makes registration more precise: with all terms free, the lateral motion
    of a sweep of rigid tissue, in steps of .3 s, was a seventh too small; with none, the turn over soft tissue was
    twice too large.
    """

    def __init__(self, aspect: float, axial_mm_per_px: float | None = None) -> None:
        self._aspect, self._axial_mm_per_px = aspect, axial_mm_per_px
        self._along = self._keyframe_along = START
        self.may = DRAGS | PRESSES
        self._overlay, self._shadows = OverlayMask(), Shadows()
        self._shape: tuple[int, int] | None = None
        self._keyframe: Keyframe | None = None
        self._keyframe_sequence = 0
        self._keyframe_path = _REST
        self._clear_share = 1.0
        self._before: tuple[Pyramid, int, Warp] | None = None
        self._warm: Warp | Array = _REST
        self._chain = 0
        self._anchor: tuple[Keyframe, int, Warp] | None = None

    @property
    def settled(self) -> bool:
        """Returns whether static overlay can no longer hold the registration back."""
        return self._overlay.settled

    @property
    def mask(self) -> Bits | None:
        """Returns the mask, (h, w) bool, True where tissue may be seen; None until enough motion was seen."""
        return self._overlay.mask

    def step(self, image: GreyImage, sequence: int) -> Tracked:
        """Follows the next picture, (h, w) uint8. Raises ValueError where its size is not that of the first."""
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
        """Makes the latest picture the keyframe, as the Motion Analyzer asks."""
        if self._before is not None:
            self._take_keyframe(*self._before)

    def take_anchor(self) -> None:
        """Keeps the latest picture as the anchor: a second keyframe, which no motion renews."""
        if self._before is not None:
            levels, _, path = self._before
            self._anchor = (self._keyframe_of(levels), self._chain, path)

    def against_anchor(self) -> Registration | None:
        """Registers the latest picture against the anchor; returns None without one, or where the two are not alike."""
        if self._anchor is None or self._before is None:
            return None
        anchor, chain, path = self._anchor
        if not anchor.textured:
            return None
        start = self._between(path, self._before[2]) if chain == self._chain else _REST
        found = anchor.register(self._before[0], start, self.may)
        return found if acceptable(found) else None

    def restart(self) -> None:
        """Forgets keyframe and anchor, because later pictures cannot be compared with earlier ones."""
        self._keyframe = self._anchor = None
        self._before = None
        self._shadows = Shadows()

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
        self._warm = found.field
        path = compose(self._keyframe_path, (found.u_px, found.alpha_rad), self._aspect)
        step = self._between(self._before[2], path)
        self._along = self._continued(found)
        return Tracked(self._chain, self._keyframe_sequence, found, path, step, tissue=self._along)

    def _continued(self, found: Registration) -> TissuePath:
        before = self._keyframe_along
        ways = zip(before.path_px, before.path_rad, found.readings, strict=True)
        path = [compose((u_px, alpha), (then.u_px, then.alpha_rad), self._aspect) for u_px, alpha, then in ways]
        return TissuePath(
            np.array([u_px for u_px, _ in path]),
            np.array([alpha for _, alpha in path]),
            before.drag_px + [reading.drag_px for reading in found.readings],
            before.tilt_rad + found.tilt_rad,
            self._clear_share,
        )

    def _between(self, before: Warp, path: Warp) -> Warp:
        turned, _ = compose(before, (np.zeros(2), path[1] - before[1]), self._aspect)
        return path[0] - turned, path[1] - before[1]

    def _search(self, keyframe: Keyframe, levels: Pyramid) -> Registration:
        """Registers from a warm start first, and where that does not convince from where the keyframe's middle is seen.

        From there turns are tried as well. Tissue that may give way may have done so by a large amount.
        """
        best = keyframe.register(levels, self._warm, self.may)
        if likeness(best) >= _GOOD_CORRELATION:
            return best
        place = keyframe.guess(levels)
        for turn_rad in (0.0, *_TURNS_RAD):
            lost = not acceptable(best)
            found = keyframe.register(levels, (place, turn_rad), self.may, loose=bool(self.may))
            better = likeness(found) > likeness(best) + (0.0 if lost else _GAINED)
            if better and (lost or acceptable(found)):
                best = found
            if acceptable(best):
                break
        return best

    def _start(self, levels: Pyramid, sequence: int, reason: str) -> Tracked:
        self._chain += 1
        self._along = START
        self._take_keyframe(levels, sequence, _REST)
        return Tracked(self._chain, sequence, None, _REST, None, reason)

    def _take_keyframe(self, levels: Pyramid, sequence: int, path: Warp) -> None:
        self._keyframe = self._keyframe_of(levels)
        self._clear_share = self._shadows.clear_share
        self._keyframe_sequence = sequence
        self._keyframe_path = path
        self._keyframe_along = self._along
        self._warm = _REST

    def _keyframe_of(self, levels: Pyramid) -> Keyframe:
        mask = self._shadows.outside(levels, self._overlay.mask)
        return Keyframe(levels, self._aspect, mask, axial_mm_per_px=self._axial_mm_per_px)


def acceptable(found: Registration) -> bool:
    """Returns whether a registration passes the self-check (equation 14), which needs no truth.

    Enough of the keyframe must be in view, and the picture must be like the keyframe there, and less so a little beside
    it. Where the descent went astray, the places beside it are as good. Likeness alone does not suffice: speckle that
    has changed and speckle that was never the same can be equally alike, but only the first is less alike beside.
    """
    alike = found.peak >= _LEAST_PEAK and likeness(found) + 2 * found.peak >= _LEAST_EVIDENCE
    return found.converged and alike and found.overlap >= _LEAST_OVERLAP


def likeness(found: Registration) -> float:
    """Returns the correlation, or 0 for a faint image: where a scanner averages, the picture before shines through."""
    return found.correlation if found.gain >= _LEAST_GAIN else 0.0
