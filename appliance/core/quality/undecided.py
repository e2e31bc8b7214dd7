"""Raises an alarm, with both names, where something is surely wrong and two classes explain it equally well."""

from collections.abc import Set as AbstractSet

from probewatch.appliance.core.quality.sequential_test import Accusation
from probewatch.appliance.core.times import HELD_NS
from probewatch.appliance.limits import NAMED_NATS
from probewatch.appliance.types import Check, Fault, VerdictKind

REPORTS_FAULTS = (Fault.UNDECIDED,)


def undecided(found: Accusation, excused: AbstractSet[str], named_nats: float = NAMED_NATS) -> Check | None:
    """Returns a FAULT where nothing within the limits explains the motion, by the evidence that names a fault, and two
    classes explain it equally well; else None.

    excused: parameters that may look wrong for another reason; neither of the two may be among them. named_nats: the
    threshold of that evidence.
    """
    if not found.rivals or found.nats < named_nats or excused & {rival.check.name for rival in found.rivals}:
        return None
    return Check("undecided", Fault.UNDECIDED, found.nats, 0.0, "nat", named_nats, VerdictKind.FAULT)


class Choice:
    """Withholds the check of an undecided fault until it has lasted. check: that check, once it has; None before, and
    where nothing is undecided.
    """

    def __init__(self) -> None:
        self.check: Check | None = None
        self._since_ns: int | None = None

    def note(self, check: Check | None, now_ns: int) -> None:
        """Takes what the solution at now_ns leaves open; None where it leaves nothing open."""
        if check is None:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = now_ns
        held = self._since_ns is not None and now_ns - self._since_ns >= HELD_NS
        self.check = check if held else None
