"""Writes the generated pages: `python -m probewatch.tools.development.manual`.

They are docs/alarms.md from the supervisor's tables, docs/hazards.md from code and tests, docs/coverage.md and
docs/evidence.md from docs/evidence.json, docs/profiles.md from docs/profiles.json, the drawings of the gestures in
docs/pictures, and what the drivers' descriptors state: tables of docs/trackers.md, docs/devices.md and docs/connect.md,
and the unit's DeviceAllow.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import fields
from math import exp
from pathlib import Path

from statemachine.transition import Transition

from probewatch.appliance.configuration.config import SupervisorTimes
from probewatch.appliance.core.parameters import QUANTITIES
from probewatch.appliance.core.quality.gesture import Gesture
from probewatch.appliance.core.times import PRESENT_NS
from probewatch.appliance.limits import NAMED_NATS, WITHDRAWN_NATS, Limits
from probewatch.appliance.supervision.alarms import EARLIER, HAZARDS, PARTLY_EARLIER, SIGNALS, Signal
from probewatch.appliance.supervision.annunciator import BURSTS, LAMP_TEST_NS
from probewatch.appliance.supervision.audio import LONGEST_PAUSE_NS, REMINDER_NS
from probewatch.appliance.supervision.fault_row import FaultRow
from probewatch.appliance.supervision.ledger import Ledger
from probewatch.appliance.supervision.policy import Durations
from probewatch.appliance.supervision.supervisor import AlarmTable
from probewatch.appliance.types import Fault, State
from probewatch.tools.development import profiles as profile_page
from probewatch.tools.development.check_rows import check_rows
from probewatch.tools.development.driver_pages import written as driver_pages
from probewatch.tools.development.evidence_pages import pages, read_figures
from probewatch.tools.development.hazards import PAGE, TESTS, hazards, step_text, steps, traced
from probewatch.tools.development.markdown import table
from probewatch.tools.development.reset_pages import written as reset_pages
from probewatch.tools.development.status_pages import written as status_pages
from probewatch.tools.shared.gesture_drawings import drawing

MANUAL = Path(__file__).parents[2] / "docs" / "alarms.md"
_OWN = {
    "acknowledged": "A person has acknowledged the latched state.",
    "scanning": "The scan of a recalibration is going on.",
}

_HEAD = """# States and alarms

The contact is closed in one state only, *monitoring*; any other state, a crash, a cut cable and loss of power open it.
Connect alarm lamps and the sounder to the normally closed contact of their relay, the green lamp to the normally open
one: energised is safe, and a cart without power shows red, yellow and cyan and sounds.

*Halt* and *recalibration requested* latch, also across a restart and a power cut. They end when a person has
acknowledged **and** motion has verified the calibration since, in either order, or with a confirmed recalibration. They
keep the name of the first fault until another one has been shown instead for as long as a halt takes, or after an OK.
The new name sounds again, unless it was acknowledged with the first.

`make docs` writes this page from the code.
"""

_PROPOSALS = """A recalibration is requested only for what motion cannot recover: a scale, and the offset across the
picture (ζ). Its time counts from when that was first shown, alone or beside other faults.

Once motion has measured a FAULT of rotation, offset, scale or latency, `probewatch status`, the page, the alarm log
(`proposal`) and the report state old value, new value and sigma. Nothing is applied by itself:

| proposed | what to do |
| --- | --- |
| latency | set `latency_ms` in the tracker's URL, restart the service |
| rotation, offset in the picture's plane | `probewatch calibration recover` writes the recovered calibration, \
`probewatch calibration use` takes it once a person accepts the difference; then verify it by motion |
| scale, offset across the picture (ζ), and what stands beside one of them | set the scanner's depth and zoom as \
calibrated; else `probewatch recalibrate` |

Of two classes equally likely none is named. The status, the log (`undecided`) and the report name both, how far the
likelier one leads, and the motion that distinguishes them. The class that motion then names replaces `undecided`, also
while it is latched."""


def manual() -> str:
    """Returns the whole page, Markdown."""
    tables = (
        *(_hazards(), _checks(), _signals(), _audio(), _policy(), _certainty(), _durations()),
        *(_transitions(), _guards()),
    )
    return "\n".join((_HEAD, *(line for table in tables for line in table))).rstrip("\n") + "\n"


def profiles() -> dict[Path, str]:
    """Returns the page on profiles, of the figures that are kept."""
    return {profile_page.PAGE: profile_page.page(profile_page.read_figures())}


def drawings() -> dict[Path, str]:
    """Returns path and content of each gesture's drawing, for docs/gesture.md."""
    found = (drawing(gesture) for gesture in Gesture)
    return {MANUAL.parent / "pictures" / file.name: file.read_text(encoding="utf-8") for file in found}


def _rows() -> Iterator[tuple[State, Transition]]:
    for state in AlarmTable.states:
        for transition in state.transitions:
            yield state.value, transition


def _guard(transition: Transition) -> str:
    return " and ".join(str(one).replace("!", "not ") for one in transition.cond)


def _target(transition: Transition) -> State:
    assert transition.target is not None
    state = transition.target.value
    assert isinstance(state, State)
    return state


def _transitions() -> list[str]:
    """Returns one row for each event and its guards in the order in which they are tried, with all states that share
    them.
    """
    steps: dict[tuple[str, str], list[str]] = {}
    for state, transition in _rows():
        told = f"{_guard(transition) or 'always'} → **{_target(transition).value}**"
        steps.setdefault((state.value, transition.event), []).append(told)
    rows: dict[tuple[str, str], list[str]] = {}
    for (name, event), each in steps.items():
        rows.setdefault((event, "; ".join(each)), []).append(name)
    text = "Tried from left to right, twenty times a second and at every request; the first that holds is taken."
    lines = ((", ".join(states), *key) for key, states in rows.items())
    return ["## Transitions", "", text, "", *table(("state", "event", "when → next"), lines)]


def _guards() -> list[str]:
    words = {word for _, t in _rows() for word in re.findall(r"[a-z_]+", _guard(t))} - {"and", "or", "not"}
    rows = [(f"`{name}`", _OWN.get(name) or _said(getattr(Ledger, name))) for name in sorted(words)]
    return ["## Guards", "", *table(("guard", "holds when"), rows)]


def _said(guard: object) -> str:
    """Returns its docstring in one line, as a table needs it."""
    return " ".join(str(guard.__doc__).split())


def _policy() -> list[str]:
    text = (
        "The tone is that of the [state](#signals). *Of* names the checks whose time counts, where not all of them do."
    )
    rows: dict[tuple[str, ...], list[Fault]] = {}
    for fault, row in HAZARDS.items():
        policy = row.policy
        told = f"{steps(policy)}{', silent' if policy.silent else ''}"
        scan = step_text(policy.scan) if policy.scan else "it goes on"
        rows.setdefault((told, scan, policy.ending.value), []).append(fault)
    head = ("hazard", "leads to while it is shown", "during a recalibration scan", "ends when")
    named = ((", ".join(f"`{fault}`" for fault in faults), *cells) for cells, faults in rows.items())
    return ["## Policy", "", text, "", *table(head, named), *_PROPOSALS.splitlines(), ""]


def _certainty() -> list[str]:
    """Returns the policy's other half: how probable it must be before a row of the table counts."""
    sigma, hours = Limits().confidence_sigma, exp(NAMED_NATS) / 3600 / 30
    rows = [
        ("beyond its limit, but by less than that", "nothing; the reason says *not certain*"),
        (
            f"beyond its limit by {sigma:g} sigma in one window, or by a log likelihood ratio of {WITHDRAWN_NATS:g}",
            "not verified at once, until new motion refutes it",
        ),
        (
            "the marker body leapt, and no picture shows whether the hand did; a slower slip",
            "not verified at once; everything must be shown again",
        ),
        (
            f"the same in two windows in a row, or by {NAMED_NATS:.1f} (once in {hours:.0f} h by chance) for one class "
            "alone; or a fact, such as a mirrored picture",
            "the policy of its hazard, for as long as it is shown",
        ),
        (f"by {NAMED_NATS:.1f}, and two classes equally likely, for a second", "the policy of `undecided`"),
    ]
    return ["### Evidence that each step needs", "", *table(("evidence that something is wrong", "what follows"), rows)]


def _durations() -> list[str]:
    defaults = {one.name.removesuffix("_ns"): getattr(Durations(), one.name) / 1e9 for one in fields(Durations)}
    defaults = {name: default_s for name, default_s in defaults.items() if f"{name}_s" in SupervisorTimes.model_fields}
    rows = [(f"`{name}_s`", f"{default_s:g}") for name, default_s in defaults.items()]
    return ["## Durations", "", "In `[supervisor]` of the configuration.", "", *table(("key", "default, s"), rows)]


def _signals() -> list[str]:
    rows = [_signal(state, row) for state, row in SIGNALS.items()]
    head = ("state", "priority", "lamp", "tone", "text", "remedy")
    carried = (
        f"While monitoring the text adds *{EARLIER}* or *{PARTLY_EARLIER}* where motion of the last\n"
        f"{PRESENT_NS / 1e9:g} s does not show everything that is verified."
    )
    return ["## Signals", "", carried, "", *table(head, rows)]


def _signal(state: State, row: Signal) -> Sequence[str]:
    flash = "steady" if row.flash_hz == 0 else f"{row.flash_hz:g} Hz"
    kind = "technical" if row.technical else "probe"
    lamp, tone = f"{row.lamp.value}, {flash}", _tone(row.pulses)
    return state.value, f"{row.priority.value}, {kind}", lamp, tone, row.text, row.remedy


def _tone(number: int) -> str:
    return "silent" if number == 0 else f"{number} pulse{'s' if number > 1 else ''}{_period(number)}"


def _period(number: int) -> str:
    period_ms = BURSTS[number].period_ms
    return " once" if period_ms == 0 else f" every {period_ms / 1000:g} s"


def _hazards() -> list[str]:
    """Returns what the operator reads, what it means, and what to do."""
    text = (
        "What leads to which state: [policy](#policy). What finds each, and the tests: [hazards](hazards.md). "
        "How soon: [evidence](evidence.md)."
    )
    head = ("text", "what to do", "class", "limit (default)")
    rows = ((f"**{row.text}**", _remedies(row), f"`{name}`", _limit(name)) for name, row in HAZARDS.items())
    return ["## Hazards", "", text, "", *table(head, rows)]


def _checks() -> list[str]:
    """Returns what each check measures."""
    text = (
        "What `checks` of [status](control.md), [feed](feed.md) and [report](replay-report.md) measure. Beside each "
        "value stands its `limit`, beyond which a fault is named."
    )
    head = ("name", "class", "measures", "against", "unit")
    return ["## Checks", "", text, "", *table(head, check_rows())]


def _remedies(row: FaultRow) -> str:
    """Returns what the operator does, also once a recalibration is requested."""
    return f"{row.remedy}; once a recalibration is requested: {row.requested}" if row.requested else row.remedy


def _limit(fault: Fault) -> str:
    """Returns the keys of the configuration with their defaults."""
    defaults = {**Limits().model_dump(), **SupervisorTimes().model_dump()}
    measured = [QUANTITIES[fault].limit_key] if fault in QUANTITIES else []
    return ", ".join(f"`{name}` {defaults[name]:.4g}" for name in (*measured, *HAZARDS[fault].limits)) or "–"


def _audio() -> list[str]:
    pause_s, reminder_s, test_s = (t_ns / 1e9 for t_ns in (LONGEST_PAUSE_NS, REMINDER_NS, LAMP_TEST_NS))
    return [
        "## Audio",
        "",
        *table(
            ("command", "what"),
            (
                ("`probewatch ack`", "silent until another alarm comes"),
                ("`probewatch pause`", f"silent for {pause_s:g} s at most"),
                ("`probewatch pause --off REASON`", "silent until `probewatch pause --on`"),
                ("`probewatch lamp-test`", f"every lamp and the tone for {test_s:g} s; the contact stays as it is"),
            ),
        ),
        f"Acknowledged or off, or paused again within {reminder_s:g} s and so for longer than {pause_s:g} s, an alarm "
        f"of high or medium priority still gives one pulse every {reminder_s:g} s.",
        "The alarm log says who asked.",
        "",
    ]


if __name__ == "__main__":
    MEASURED = read_figures()
    for path, text in {
        MANUAL: manual(),
        PAGE: hazards(MEASURED),
        TESTS: traced(),
        **pages(MEASURED),
        **profiles(),
        **drawings(),
        **driver_pages(),
        **reset_pages(),
        **status_pages(),
    }.items():
        path.write_text(text, encoding="utf-8")
