"""Detects that the strain of a picture at rest has leapt: tissue passes through what lies between, a scanner need not.

A picture that fades into a stretched one, or is wiped, breaks no chain of pictures; but its strain is what it was up to
the middle of the fade, and what it will be from there on.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from probewatch.drivers.rigid import Array

_STEADY, _SOONEST = 3, 2
"""Number of looks for which the strain must be steady before a leap and after it, a third of a second from first to
last, and number before one that comes just as the rest has begun. Fewer take organs that slide for a leap (study,
gesture-hold, organ-8-axial, seed 2: two looks), more ask for more of the rest."""
_LEAP_NS, _UNSTEADY = 520_000_000, 0.15
"""ns from the last look before the leap to the first one after it, at most, and range of the strain among the looks of
either side ÷ the leap. Longer finds slower fades, more those in tissue that gives way to tremor; with either, breaths
that rest at both ends leap as well: at .7 s or .25 those that go as cos⁴ every 3 s (tests beside this)."""
_MOST_LOOKS = 12
"""Number of looks that are kept: more than both sides and the looks between them. Not varied."""
_LEAST_DOWN = 0.5
"""Ratio of the strain down to that across, below which no tissue is the cause: it keeps its volume. More voids what was
shown over tissue that slides sideways, less misses stretches of the width."""
_STRAINLESS = 0.25
"""Ratio to the least strain that counts, up to which a look shows none. The noise of a look is a twentieth. More lets
tissue that gives way to a small press be blamed for a larger one, less learns nothing from a look. Not varied."""


@dataclass(frozen=True, slots=True, eq=False)
class Strain:
    """Holds the strain between the first picture of a rest and a later one. log_zoom: (2,) logarithm of its
    magnification, lateral and axial. pressed: (2,) as of `pressed_between`.
    """

    t_ns: int
    log_zoom: Array
    pressed: Array

    def plus(self, other: "Strain") -> "Strain":
        """Returns the strain of the other's picture, where that is measured against the picture of this one."""
        return Strain(other.t_ns, self.log_zoom + other.log_zoom, self.pressed + other.pressed)


class StrainLeap:
    """Watches the strains of one rest. least: the smallest leap of the logarithm of an axis that counts."""

    def __init__(self, least: float) -> None:
        self._least = least
        self._strains: deque[Strain] = deque(maxlen=_MOST_LOOKS)
        self._base = Strain(0, np.zeros(2), np.zeros(2))

    def begin(self, t_ns: int) -> None:
        """Forgets all strains. Later ones refer to the picture of t_ns, which is not strained itself."""
        self._base = Strain(t_ns, np.zeros(2), np.zeros(2))
        self._strains.clear()
        self._strains.append(self._base)

    def go_on(self, strain: Strain) -> None:
        """Takes the picture of this strain, the latest that was taken, as the one that later strains refer to."""
        self._base = self._base.plus(strain)

    def step(self, strain: Strain) -> bool:
        """Returns whether the latest strains are steady, and differ from those before by more than the face pressed
        meanwhile.
        """
        self._strains.append(self._base.plus(strain))
        strains = list(self._strains)
        before, after = strains[:-_STEADY], strains[-_STEADY:]
        ends = [k for k in range(_SOONEST, len(before) + 1) if after[0].t_ns - before[k - 1].t_ns <= _LEAP_NS]
        return any(self._leapt(before[max(end - _STEADY, 0) : end], after) for end in ends)

    def _leapt(self, before: list[Strain], after: list[Strain]) -> bool:
        sides = [np.array([strain.log_zoom for strain in side]) for side in (before, after)]
        presses = [np.mean([strain.pressed for strain in side], axis=0) for side in (before, after)]
        leap = np.abs(sides[1].mean(axis=0) - sides[0].mean(axis=0))
        unsteady = np.max([np.ptp(side, axis=0) for side in sides], axis=0)
        pressed = 0.0 if is_across_alone(leap) else float(np.abs(presses[1] - presses[0]).sum())
        return bool(np.any((leap > self._least + pressed) & (unsteady <= _UNSTEADY * leap)))


class LastingStrain:
    """Watches whether the strain of a rest lasts: a breath takes it back. least: as of `StrainLeap`.

    The press of the face is averaged over the looks, as a tremor of the hand goes to and fro. A press that strained
    nothing earlier in the rest explains nothing.
    """

    def __init__(self, least: float) -> None:
        self._least = least
        self.restart()

    def restart(self) -> None:
        """Forgets the rest."""
        self._strainless_press = 0.0
        self._end()

    def step(self, strain: Strain | None) -> bool:
        """Returns whether this look and all since the last that was not strained are strained, by more on average than
        the face pressed meanwhile. strain: None where it is not known.
        """
        if strain is None or np.max(np.abs(strain.log_zoom)) <= self._least:
            self._end()
            if strain is not None and np.max(np.abs(strain.log_zoom)) <= _STRAINLESS * self._least:
                self._strainless_press = max(self._strainless_press, float(np.abs(strain.pressed).sum()))
            return False
        self._looks += 1
        self._log_zoom += strain.log_zoom
        self._pressed += strain.pressed
        strained, pressed = np.max(np.abs(self._log_zoom)) / self._looks, np.abs(self._pressed).sum() / self._looks
        return bool(strained > self._least + max(pressed - self._strainless_press, 0.0))

    def _end(self) -> None:
        self._looks, self._log_zoom, self._pressed = 0, np.zeros(2), np.zeros(2)


def is_across_alone(log_zoom: Array) -> bool:
    """Returns whether the logarithms of a zoom, (2,) lateral and axial, are of the width alone, so that no press
    explains them.
    """
    across, down = np.abs(log_zoom)
    return bool(down < _LEAST_DOWN * across)
