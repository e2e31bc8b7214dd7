"""Finds the animated drawing of each gesture, for the page, docs/gesture.md and the terminal's link."""

from pathlib import Path

from probewatch.appliance.core.quality.gesture import Gesture
from probewatch.appliance.supervision.languages import translated

DRAWINGS = Path(__file__).with_name("drawings")


def drawing(gesture: Gesture) -> Path:
    """Returns an animated SVG, which does not move for a person who has set reduced motion."""
    return DRAWINGS / f"gesture-{gesture.name.lower()}.svg"


def drawn(text: str, language: str) -> Path | None:
    """Returns the drawing of a gesture as the status names it; None for one that this version does not know."""
    return next((drawing(one) for one in Gesture if translated(one.value, language) == text), None)
