"""The demo's judgement, its report and its picture."""

import io
import json

import pytest
from rich.console import Console

from probewatch.appliance.types import State
from probewatch.tools.demo.director import Director
from probewatch.tools.demo.live_view import LiveView
from probewatch.tools.demo.outcome import History, Moment, Prompt, Switch, judge
from probewatch.tools.demo.report import Circumstances, print_report, report_fields
from probewatch.tools.demo.script import Injection, Planned, Script

MONITORING, WARNING, HALT = State.MONITORING, State.WARNING, State.HALT
REQUESTED, LOST = State.RECALIBRATION_REQUESTED, State.DEVICE_LOST
SCRIPT = Script((Injection("depth", 30.0, 34.5), Injection("lose-tracker", 60.0, 63.0)), 90.0)


def moment(t_s: float, state: State, fault: str | None = None) -> Moment:
    return Moment(t_s, state, fault, "because")


HEALTHY = (moment(8, MONITORING),)
DEPTH = (moment(30.1, WARNING, "scale"), moment(31.1, HALT, "scale"), moment(33.1, REQUESTED, "scale"))
TRACKER = (moment(60.5, WARNING, "tracker-lost"), moment(61.5, LOST, "tracker-lost"))
BACK, BACK_AGAIN = (moment(42, MONITORING),), (moment(65, MONITORING),)
GOOD = (*HEALTHY, *DEPTH, *BACK, *TRACKER, *BACK_AGAIN)
SWITCHES = tuple(Switch(t_s, t_s in (8, 42, 65)) for t_s in (8, 30.1, 42, 60.5, 65))


def sentence(*moments: Moment, switches: tuple[Switch, ...] = SWITCHES) -> str:
    return judge(SCRIPT, History(moments, switches, (41.0,), 90.0)).sentence


def test_a_run_as_it_should_be_passes() -> None:
    outcome = judge(SCRIPT, History(GOOD, SWITCHES, (41.0,), 90.0))
    assert (outcome.sentence, outcome.passed, outcome.unexpected, outcome.verified_s) == ("", True, (), 8)
    depth, tracker = outcome.findings
    assert depth.reached == pytest.approx({WARNING: 0.1, HALT: 1.1, REQUESTED: 3.1})
    assert (depth.named, depth.contact_open_after_s) == ("scale", pytest.approx(0.1))
    assert (depth.acknowledged_after_s, depth.verified_after_s) == (11.0, pytest.approx(42 - depth.injection.to_s))
    assert (tracker.named, tracker.acknowledged_after_s) == ("tracker-lost", None)


@pytest.mark.parametrize(
    ("moments", "said"),
    [
        ((), "The calibration was never verified."),
        ((*HEALTHY, *TRACKER, *BACK_AGAIN), "At 30.0 s depth was not found."),
        ((*HEALTHY, moment(30.1, WARNING, "offset"), *DEPTH[1:], *BACK, *TRACKER, *BACK_AGAIN), "was named offset"),
        ((*HEALTHY, *DEPTH[:2], *BACK, *TRACKER, *BACK_AGAIN), "did not lead to 'recalibration requested'"),
        (
            (*HEALTHY, *DEPTH, *BACK, *TRACKER, moment(62, HALT, "tracker-lost"), *BACK_AGAIN),
            "At 60.0 s lose-tracker led to 'halt' as well",
        ),
        ((*HEALTHY, DEPTH[0], moment(31, REQUESTED, "scale"), moment(32, HALT, "scale"), *BACK), "in the wrong order"),
        ((*HEALTHY, *DEPTH, moment(61, MONITORING)), "At 30.0 s depth was removed, but is not verified again in time"),
        ((*GOOD, moment(75, WARNING, "latency")), "At 75.0 s 'warning' (latency) came up without that fault."),
        ((*HEALTHY, moment(20, WARNING, "scale"), moment(22, MONITORING), *GOOD[1:]), "At 20.0 s 'warning' (scale)"),
        (
            (*HEALTHY, *DEPTH, moment(34, REQUESTED, "offset"), *GOOD[4:]),
            "At 34.0 s 'recalibration requested' (offset)",
        ),
        ((moment(31, MONITORING), *DEPTH[1:]), "At 30.0 s depth began while the service was still 'self-test'"),
    ],
)
def test_what_went_wrong_is_said_by_its_earliest_cause(moments: tuple[Moment, ...], said: str) -> None:
    assert said in sentence(*moments)


def test_a_contact_that_stays_closed_fails() -> None:
    assert "depth did not open the contact" in sentence(*GOOD, switches=SWITCHES[:1])
    assert "depth began while" in sentence(*GOOD, switches=())


WRONG = (*HEALTHY, moment(30.1, WARNING, "offset"), *DEPTH[1:], *BACK, *TRACKER, *BACK_AGAIN)


@pytest.mark.parametrize(
    ("busy_s", "too_busy"),
    [
        ((), False),
        (((31.0, 33.0),), True),
        (((31.0, 31.9), (32.0, 33.1)), True),
        (((31.0, 32.9),), False),
        (((0.0, 22.0),), True),
        (((0.0, 21.9),), False),
        (((59.0, 90.0),), False),
    ],
)
def test_what_went_wrong_while_the_machine_was_too_busy_says_nothing(
    busy_s: tuple[tuple[float, float], ...], too_busy: bool
) -> None:
    """Depth was named offset from 30.1 s on; its evidence goes back by 10 s, and its time is up at 60 s."""
    outcome = judge(SCRIPT, History(WRONG, SWITCHES, (41.0,), 90.0, busy_s))
    assert (outcome.passed, outcome.too_busy) == (False, too_busy)
    console = Console(file=io.StringIO(), width=80)
    print_report(console, outcome)
    head = "TOO BUSY: this computer is overloaded" if too_busy else "FAILED: At 30.0 s"
    assert head in console.file.getvalue().splitlines()[-1]


def test_a_good_run_on_a_busy_machine_passes() -> None:
    outcome = judge(SCRIPT, History(GOOD, SWITCHES, (41.0,), 90.0, ((0.0, 90.0),)))
    assert (outcome.passed, outcome.too_busy) == (True, False)


def test_without_faults_only_quiet_is_asked_for() -> None:
    assert judge(Script((), 30.0), History(HEALTHY, SWITCHES[:1], (), 30.0)).passed


def test_what_the_calibration_is_worth_is_told_in_millimetres_and_never_as_less() -> None:
    history = History(GOOD, SWITCHES, (41.0,), 90.0, point_mm=3.81)
    outcome = judge(SCRIPT, history)
    console = Console(file=io.StringIO(), width=200)
    print_report(console, outcome)
    assert console.file.getvalue().rstrip().endswith("nothing else alarmed. Verified to 3.9 mm.")
    assert report_fields(outcome, history, Circumstances(1, 1.0, "rigid", {}))["point_mm"] == 3.81


def test_the_report_is_json_and_a_table_of_80_columns() -> None:
    history = History((*GOOD, moment(75, WARNING, "latency")), SWITCHES, (41.0,), 90.0)
    outcome = judge(SCRIPT, history)
    fields = json.loads(json.dumps(report_fields(outcome, history, Circumstances(1, 1.0, "rigid", {}))))
    assert (fields["version"], fields["passed"]) == (1, False)
    assert fields["faults"][0]["recalibration_request_after_s"] == 3.1
    assert fields["unexpected"][0]["fault"] == "latency"
    console = Console(file=io.StringIO(), width=80)
    print_report(console, outcome)
    table = console.file.getvalue()
    assert max(map(len, table.splitlines())) <= 80
    assert "…" not in table, "no column is cut"
    assert all(word in table for word in ("lose-tracker", "verified", "FAILED: At 75.0 s"))


def status(**changed: object) -> dict[str, object]:
    check = {"name": "rotation-elevational", "fault": "rotation", "ratio": 0.5, "verdict": "OK"}
    failing = check | {"name": "polarity", "ratio": 2.0, "verdict": "FAULT"}
    unknown = check | {"name": "latency", "ratio": None, "verdict": "NOT_VERIFIED"}
    return {
        "state": "halt",
        "text": "HALT: calibration is wrong",
        "remedy": "Reset the flip",
        "fault": "polarity",
        "reason": "polarity +1 axes, limit 0.5 axes",
        "lamp": "red",
        "energised": False,
        "latched": "halt",
        "acknowledged": False,
        "notices": [],
        "remarks": [],
        "lost": {},
        "estimator": None,
        "audio": {"mode": "paused", "left_s": 29.0},
        "verification_age_s": None,
        "fps": {"video": 30.0, "tracker": 60.0},
        "counters": {"dropped_frames": 3, "dropped_poses": 0, "uptime_s": 20},
        "checks": [check | {"name": f"rotation-elevational{n}"[-20:]} for n in range(13)] + [failing, unknown],
        "devices": [check | {"name": f"alarm log integrity{n}"[-20:]} for n in range(12)],
        **changed,
    }


def test_the_live_view_fits_a_small_terminal() -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=80, height=24, color_system=None)
    with LiveView(console, Director((Planned("depth", 30.0),))) as view:
        for number in range(30):
            view.event(float(number), "relay board: contact opened " * 5)
        view.show(20.0, status())
        drawn = io.StringIO()
        Console(file=drawn, width=80).print(view.picture)
    lines = drawn.getvalue().splitlines()
    assert len(lines) < 24
    assert max(map(len, lines)) <= 80
    assert "next fault: depth in 10 s" in lines[0]
    text = drawn.getvalue()
    assert all(part in text for part in ("HALT", "contact OPEN", "━━━━─────┃  0.50 ✓", "2.00 ✗", "–   ?", "dropped: 3"))


def test_a_prompt_says_what_is_shown_what_is_missing_and_which_motion_shows_it() -> None:
    some = Prompt(5.0, 10, ("offset-axial",), ("rock it",))
    assert some.text == "shown: 9 of 10; missing: offset-axial; to show it: rock it"
    assert Prompt(6.0, 10, (), ()).text == "shown: all 10"
    history = History(GOOD, SWITCHES, (41.0,), 90.0, prompts=(some,))
    fields = report_fields(judge(SCRIPT, history), history, Circumstances(1, 1.0, "rigid", {}))
    assert fields["prompts"] == [{"t_s": 5.0, "asked": 10, "missing": ["offset-axial"], "gesture": ["rock it"]}]
