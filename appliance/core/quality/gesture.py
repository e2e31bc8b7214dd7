"""The shortest motion that shows what is still missing: a verification gesture, shown to the person who holds the
probe.

By the Cramér–Rao bounds of each motion alone (tests/appliance/core/quality/test_gesture.py): 5 s of it at .1 mm of
tracker noise show the parameters named beside it within their limits, by three sigmas, unless said otherwise.
"""

from collections.abc import Iterable, Mapping
from enum import Enum


class Gesture(Enum):
    """One motion of the hand over tissue; the text is the operator's, and has a translation."""

    SIDEWAYS = "slide it sideways, 10 mm to and fro"
    PRESS = "press and release quickly, 6 mm"
    ROCK = "rock it in the picture's plane, 8° each way"
    TWIST = "twist it about its long axis, 8° each way"
    TILT = "fan it out of the picture's plane, 8° each way"


_SHOWS: Mapping[Gesture, tuple[str, ...]] = {
    Gesture.SIDEWAYS: ("polarity", "latency", "scale-lateral", "rotation-elevational"),
    Gesture.PRESS: ("scale-axial",),
    Gesture.ROCK: ("offset-axial", "offset-lateral"),
    Gesture.TWIST: ("rotation-lateral", "offset-elevational"),
    Gesture.TILT: ("rotation-axial",),
}
"""offset-lateral is shown by rocking while the probe slides sideways, not by rocking alone."""
_WITH = {"offset-lateral": Gesture.SIDEWAYS}


def gestures(missing: Iterable[str]) -> tuple[Gesture, ...]:
    """What to do so that motion shows every one of these parameters, in the order in which one does it."""
    names = set(missing)
    wanted = {gesture for gesture, shows in _SHOWS.items() if names.intersection(shows)}
    wanted |= {gesture for name, gesture in _WITH.items() if name in names}
    return tuple(gesture for gesture in Gesture if gesture in wanted)
