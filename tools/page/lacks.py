"""Finds what a button of the page cannot do on a cart without lamps or tone. Pure."""

from collections.abc import Mapping
from typing import Any

from probewatch.appliance.supervision.annunciator import Role

NO_LAMPS, NO_TONE = "this cart has neither lamp nor tone, only the contact", "this cart has no tone"


def lacks(status: Mapping[str, Any]) -> dict[str, str]:
    """Returns, by request of the page, what the cart lacks for it; a request for which it lacks nothing is missing."""
    signals = {output["signal"] for output in status["outputs"]} - {Role.CONTACT.value}
    found = {} if signals else {"lamp-test": NO_LAMPS}
    return found if Role.TONE.value in signals else {**found, "silence": NO_TONE, "sound": NO_TONE}
