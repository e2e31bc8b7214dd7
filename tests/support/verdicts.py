"""What the verdicts of a session say, for tests of the whole line."""

from collections.abc import Sequence

from probewatch.appliance.types import Fault, Verdict


def faults(verdicts: Sequence[Verdict]) -> list[Fault]:
    """Every class that was named, in the order in which they came."""
    return list(dict.fromkeys(one.fault for one in verdicts if one.fault is not None))
