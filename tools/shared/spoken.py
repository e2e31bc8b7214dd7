"""Holds the texts of the operator's commands themselves, and returns them in the language of the cart; `tools.german`
says where German is.
"""

from collections.abc import Mapping
from typing import Any

from probewatch.appliance.supervision.alarms import NOT_NOW
from probewatch.appliance.supervision.languages import LANGUAGES, translated, translated_text

SPOKEN = {
    "bump": "recorded: the tracker's position sensor was checked; an alert of a bump, if there was one, ends",
    "another": "this is another alarm; it has not been acknowledged yet",
    "ends": "it ends once the calibration is verified again: move the probe over tissue, or recalibrate",
    "ends dated": "it ends once a calibration that has not expired is verified: recalibrate",
    "now": "now",
    "nothing": "there is nothing to acknowledge",
    "not now": NOT_NOW,
    "silence": "It ends by itself once its cause is mended; silent until then: probewatch pause",
    "already": "already acknowledged, waiting until the calibration is verified again",
    "no lamps": "this service has no lamp and no tone, only the contact; see [[output]] in its configuration",
    "lamps": "for five seconds these must light up or sound:",
    "sound on": "the alarm sound is on again",
    "sound off": "the alarm is silent until 'probewatch pause --on'; it reminds once a minute",
    "stays off": "the alarm sound is switched off already, and stays so until 'probewatch pause --on'",
    "silent": "the alarm is silent for {seconds} s",
    "no tone": "this cart has no tone output",
    "no match": "none of the {number} entries matches",
    "whole": "{number} entries, the chain is whole",
    "broken": "the chain is NOT whole: copy the folder for whoever looks into it, then probewatch ack",
    "broken copy": "the chain is NOT whole: keep this folder as it is; probewatch ack is for the cart's own log",
    "written": "{number} entries written to {file}",
    "latched": "latched",
    "by": "by",
}
"""Every text of `ack`, `lamp-test`, `pause` and `log` that does not come from the service itself."""


def say(name: str, language: str, **fields: object) -> str:
    """Returns one of SPOKEN in the language."""
    return translated(SPOKEN[name], language).format(**fields)


def say_change(text: str, language: str) -> str:
    """Returns a state and its reason, such as "halt: mirrored", in the language; unchanged where the reason cannot be
    translated as a whole.
    """
    state, colon, reason = text.partition(": ")
    said = translated_text(reason, language)
    return text if reason and said == reason else f"{translated_text(state, language)}{colon}{said}"


def language_of(status: Mapping[str, Any]) -> str:
    """Returns the language of the cart by its status; English where this version does not have that language."""
    said = status.get("language", "en")
    return said if said in LANGUAGES else "en"
