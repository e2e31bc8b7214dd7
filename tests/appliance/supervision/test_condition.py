"""A condition that was never shown, or is only suspected, names nothing and lasts for no time."""

from probewatch.appliance.supervision.condition import Condition
from probewatch.appliance.types import Fault

S_NS = 1_000_000_000


def test_what_was_never_shown_names_nothing() -> None:
    never = Condition()
    assert (never.shown, never.active) == (False, False)
    assert not never.names(S_NS, 0)
    assert not never.lasts(S_NS, 0)


def test_what_is_unconfirmed_names_nothing_until_it_is_shown_again() -> None:
    slid = Condition()
    slid.show(0, Fault.OFFSET, "seen")
    assert slid.names(S_NS, S_NS)
    slid.mark_unconfirmed()
    assert not slid.names(2 * S_NS, S_NS)
    assert slid.active
    slid.show(3 * S_NS, Fault.OFFSET, "seen")
    assert slid.names(3 * S_NS, S_NS)


def test_another_fault_is_named_after_its_own_time() -> None:
    changed = Condition()
    changed.show(0, Fault.OFFSET, "seen")
    changed.show(2 * S_NS, Fault.SCALE, "seen")
    assert not changed.names(2 * S_NS, S_NS)
    assert not changed.names(3 * S_NS - 1, S_NS)
    assert changed.names(3 * S_NS, S_NS)


def test_what_has_lifted_names_nothing() -> None:
    gone = Condition()
    gone.show(0, Fault.OFFSET, "seen")
    gone.lift(S_NS)
    assert not gone.names(2 * S_NS, 0)
