"""Translates the English of the service and its log to the language of the room. The page's own words are in
german.js.
"""

import re
from typing import Any

from probewatch.appliance.supervision import languages

_DECIMAL = re.compile(r"(?<![\d.])(\d+)\.(\d+)(?![\d.]*\d)")
"""Matches a figure, but no address or version, which have more than one point."""
_BACK = "not verified, the calibration before is in force: "
"""Beginning of the session's message when the service has not verified the new calibration; state and reason follow."""
_BACK_DE = "nicht bestätigt, die Kalibrierung davor ist in Kraft: "


def translated_text(text: str, language: str) -> str:
    """Returns the text in the language, with its decimal sign; unchanged where it cannot be translated whole."""
    said = languages.translated_text(text, language)
    return said if said == text else figures(said, language)


def figures(text: str, language: str) -> str:
    """Returns the text with the decimal sign of its language: German writes 2,5 for 2.5."""
    return _DECIMAL.sub(r"\1,\2", text) if language == "de" else text


def worded(event: dict[str, Any], language: str) -> dict[str, Any]:
    """Returns the event of the page with these texts in the language of the room; each is translated whole, or left as
    it was.

    Compared parameters get a title beside the name, which stays.
    """
    status = event["status"]
    event["alarms"] = _alarms(event["alarms"], language)
    event["recalibration"] = _recalibration(event["recalibration"], language)
    if status is not None:
        event["status"] = {**status, "reason": translated_text(status["reason"], language)}
    return event


def _titled(one: dict[str, Any], language: str) -> dict[str, Any]:
    return {**one, "title": translated_text(one["name"], language), "unit": translated_text(one["unit"], language)}


def _alarms(alarms: dict[str, Any], language: str) -> dict[str, Any]:
    return {**alarms, **{name: [_entry(entry, language) for entry in alarms[name]] for name in ("entries", "hour")}}


def _entry(entry: dict[str, Any], language: str) -> dict[str, Any]:
    """Returns an entry with state and reason in one language."""
    said = [translated_text(entry[name], language) for name in ("state", "reason")]
    if entry["reason"] and said[1] == entry["reason"]:
        return entry
    return {**entry, "state": said[0], "reason": said[1]}


def _recalibration(fields: dict[str, Any], language: str) -> dict[str, Any]:
    scan = fields["scan"]
    if scan is not None:
        scan = {**scan, "compared": [_titled(one, language) for one in scan["compared"]]}
    return {**fields, "message": _message(fields["message"], language), "scan": scan}


def _message(message: str, language: str) -> str:
    if language == "en" or not message.startswith(_BACK):
        return translated_text(message, language)
    state, _, reason = message.removeprefix(_BACK).partition(": ")
    said = translated_text(reason, language)
    return message if said == reason else f"{_BACK_DE}{translated_text(state, language)}: {said}"
