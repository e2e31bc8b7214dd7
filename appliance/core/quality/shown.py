"""Tells apart parameters that the present motion shows, that earlier motion showed, and that none has shown."""

from enum import Enum

from probewatch.appliance.core.times import PRESENT_NS
from probewatch.appliance.types import Check, VerdictKind


class Shown(Enum):
    """Names how a parameter is shown; the value is the word for it in JSON."""

    VERIFIED = "verified"
    CARRIED = "carried"
    MISSING = "missing"


def shown(check: Check | None, now_ns: int, first_ns: int) -> Shown:
    """Returns how the parameter of a check is shown. first_ns: from when on motion counts. check: None where the
    verdict has none of that name.
    """
    if check is None or check.shown_ns is None or check.verdict is VerdictKind.FAULT or check.shown_ns < first_ns:
        return Shown.MISSING
    present = check.verdict is VerdictKind.OK and now_ns - check.shown_ns <= PRESENT_NS
    return Shown.VERIFIED if present else Shown.CARRIED
