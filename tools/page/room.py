"""Words the status as people in the room read it: one headline, what is wrong, and which motion is missing. Pure."""

from collections.abc import Mapping
from typing import Any

from probewatch.appliance.supervision.alarms import EARLIER, PARTLY_EARLIER
from probewatch.appliance.supervision.languages import translated
from probewatch.tools.page.bars import bars
from probewatch.tools.page.contours import contours
from probewatch.tools.page.devices import devices
from probewatch.tools.page.lacks import lacks
from probewatch.tools.page.wording import figures
from probewatch.tools.shared.gesture_drawings import drawn
from probewatch.tools.shared.point_text import point_text
from probewatch.tools.shared.profile_text import profile_text

_PARTS = " · "
"""Separator between the clauses of the status's text."""


def room(status: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the fields of the room's view. simulated: whether a source is not a real device. headline: the state.
    named: what is wrong, empty where nothing is. point: the error of a point; contours: those of that error, over the
    picture. limits: whose limits are in force. rests: the remark that what is verified rests on earlier motion.
    gestures: drawing and text of each that is asked for. bars, devices: their rows. lacks: what the cart lacks for a
    button, by its request.
    """
    language = status.get("language", "en")
    said = status["text"].split(_PARTS)[1 if status["simulated"] else 0 :]
    earlier = {translated(text, language) for text in (EARLIER, PARTLY_EARLIER)}
    return {
        "simulated": bool(status["simulated"]),
        "headline": said[0] if said else "",
        "named": _PARTS.join(text for text in said[1:] if text not in earlier),
        "rests": next((text for text in said[1:] if text in earlier), ""),
        "gestures": _gestures(status["gesture"], language),
        "point": figures(point_text(status.get("point"), status.get("point_limit_mm"), language), language),
        "contours": contours(status.get("point")),
        "limits": figures(profile_text(status.get("limits"), language), language),
        "bars": bars(status["checks"], language),
        "devices": devices(status, language),
        "lacks": lacks(status),
    }


def _gestures(texts: list[str], language: str) -> list[dict[str, str]]:
    """Returns each gesture with the file of its drawing; one that a newer service asks for has none."""
    found = [(text, drawn(text, language)) for text in texts]
    return [{"drawing": "" if file is None else file.name, "text": text} for text, file in found]
