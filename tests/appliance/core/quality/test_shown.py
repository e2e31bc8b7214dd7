"""Verified, carried and missing, at their bounds."""

from dataclasses import replace

import pytest

from probewatch.appliance.core.quality.shown import Shown, shown
from probewatch.appliance.core.times import PRESENT_NS
from probewatch.appliance.types import Check, Fault, VerdictKind

S_NS = 1_000_000_000
NOW_NS = 100 * S_NS
CHECK = Check("scale-axial", Fault.SCALE, 0.1, 0.1, "%", 5.0, VerdictKind.OK, 95 * S_NS)


@pytest.mark.parametrize(
    ("verdict", "shown_ns", "first_ns", "expected"),
    [
        (VerdictKind.OK, 95 * S_NS, 0, Shown.VERIFIED),
        (VerdictKind.OK, NOW_NS - PRESENT_NS, 0, Shown.VERIFIED),
        (VerdictKind.OK, NOW_NS - PRESENT_NS - 1, 0, Shown.CARRIED),
        (VerdictKind.OK, 95 * S_NS, 95 * S_NS, Shown.VERIFIED),
        (VerdictKind.OK, 95 * S_NS, 95 * S_NS + 1, Shown.MISSING),
        (VerdictKind.OK, None, 0, Shown.MISSING),
        (VerdictKind.NOT_VERIFIED, 95 * S_NS, 0, Shown.CARRIED),
        (VerdictKind.NOT_VERIFIED, 50 * S_NS, 50 * S_NS, Shown.CARRIED),
        (VerdictKind.NOT_VERIFIED, 50 * S_NS, 50 * S_NS + 1, Shown.MISSING),
        (VerdictKind.NOT_VERIFIED, None, 0, Shown.MISSING),
        (VerdictKind.FAULT, 95 * S_NS, 0, Shown.MISSING),
    ],
)
def test_what_motion_shows(verdict: VerdictKind, shown_ns: int | None, first_ns: int, expected: Shown) -> None:
    assert shown(replace(CHECK, verdict=verdict, shown_ns=shown_ns), NOW_NS, first_ns) is expected


def test_what_the_line_does_not_speak_of_is_missing() -> None:
    assert shown(None, NOW_NS, 0) is Shown.MISSING
