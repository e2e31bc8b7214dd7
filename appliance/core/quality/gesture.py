"""Chooses the shortest motion that shows what is still missing: a verification gesture, which is displayed to the
person who holds the probe.

What each motion shows follows from the Cramér–Rao bounds of that motion alone
(tests/appliance/core/quality/test_gesture.py): with .1 mm of tracker noise, 5 s of it show the parameters named beside
it within their limits by three sigmas, unless stated otherwise.
"""

from collections.abc import Iterable, Mapping
from enum import Enum


class Gesture(Enum):
    """Represents one motion of the hand over tissue; the text is for the operator, and has a translation."""

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
"""The parameters that each motion shows. Rocking shows offset-lateral only while the probe also slides sideways."""
_WITH = {"offset-lateral": Gesture.SIDEWAYS}


def gestures(missing: Iterable[str]) -> tuple[Gesture, ...]:
    """Returns the motions that together show every one of these parameters, in the order in which they are done."""
    names = set(missing)
    wanted = {gesture for gesture, shows in _SHOWS.items() if names.intersection(shows)}
    wanted |= {gesture for name, gesture in _WITH.items() if name in names}
    return tuple(gesture for gesture in Gesture if gesture in wanted)
