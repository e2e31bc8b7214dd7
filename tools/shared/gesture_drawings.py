"""A moving drawing of each gesture, for the page, docs/gesture.md and the terminal's link."""

from pathlib import Path

from probewatch.appliance.core.quality.gesture import Gesture
from probewatch.appliance.supervision.languages import translated

DRAWINGS = Path(__file__).with_name("drawings")


def drawing(gesture: Gesture) -> Path:
    """An SVG that moves by itself, and stands still for who has asked for less motion."""
    return DRAWINGS / f"gesture-{gesture.name.lower()}.svg"


def drawn(text: str, language: str) -> Path | None:
    """The drawing of a gesture as the status names it; None for one that this version does not know."""
    return next((drawing(one) for one in Gesture if translated(one.value, language) == text), None)
