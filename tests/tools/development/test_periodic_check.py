"""The sheet of the periodic check: every step has a tolerance and room for what was measured, and its limits are the
shipped ones."""

import re
from pathlib import Path

from probewatch.appliance.limits import Limits
from probewatch.appliance.supervision.policy import Durations
from probewatch.appliance.types import State
from probewatch.tools.commands.probe import _LOOSE_BOUND_MS, _MANY_LOST, _POOR_FIT_MM

DOCS = Path(__file__).parents[3] / "docs"
SHEET, CONTROL = ((DOCS / name).read_text() for name in ("periodic-check.md", "control.md"))
ROWS = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in re.findall(r"^\| \d.*\|$", SHEET, re.M)]


def test_every_step_has_a_tolerance_and_a_field() -> None:
    assert [row[0].strip("| ") for row in ROWS] == [str(number) for number in range(1, len(ROWS) + 1)]
    for number, step, tolerance, field, passed in ROWS:
        assert step, number
        assert re.search(r"\d|equal|every|year", tolerance), step
        assert "____" in field, step
        assert "☐" in passed, step


def test_what_it_tells_to_read_is_there() -> None:
    """The status was to be read for late ticks, which it does not print; the last 200 states, for those of a year."""
    (step,) = (row for row in ROWS if "status --json" in row[1])
    told = re.findall(r"`(\w+)`", step[2])
    assert told == ["counters", "dropped_frames", "dropped_poses", "late_ticks", "fps"]
    (row,) = re.findall(r"^\| `counters` .*$", CONTROL, re.M)
    assert all(f"`{name}`" in row for name in told[1:-1])
    assert "\n| `fps` " in CONTROL
    (step,) = (row for row in ROWS if "log --state" in row[1])
    states = re.findall(r'--state (?:"([^"]+)"|(\w+))', step[1])
    assert {State(one or other) for one, other in states} == {State.HALT, State.DEVICE_LOST, State.INTERNAL_FAULT}
    assert "--since" in step[1]


def test_its_figures_are_those_of_the_shipped_configuration() -> None:
    limits = Limits()
    for said in (
        f"{limits.rotation_deg:g}° in rotation, {limits.scale_percent:g} % in scale, {limits.offset_mm:g} mm in offset",
        f"{limits.latency_ms:g} ms in latency",
        f"{100 * _MANY_LOST:g} % lost at most",
        f"± {_LOOSE_BOUND_MS:g} ms at most in the median",
        f"marker fit {_POOR_FIT_MM:g} mm at most",
    ):
        assert said in SHEET, said
    assert Durations().device_lost_after_ns <= 2_500_000_000
