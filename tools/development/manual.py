"""`python -m tools.development.manual`: writes docs/alarms.md from the supervisor's tables and the figures of the last
study, docs/hazards.md from code and tests, docs/coverage.md and docs/evidence.md from docs/evidence.json,
docs/profiles.md from docs/profiles.json, and the drawings of the gestures in docs/pictures.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import fields
from math import exp
from pathlib import Path

from statemachine.transition import Transition

from appliance.core.quality.gesture import Gesture
from appliance.core.times import PRESENT_NS
from appliance.limits import NAMED_NATS, WITHDRAWN_NATS, Limits
from appliance.supervision.alarms import EARLIER, HAZARDS, PARTLY_EARLIER, SIGNALS, Signal
from appliance.supervision.annunciator import BURSTS, LAMP_TEST_NS
from appliance.supervision.audio import LONGEST_PAUSE_NS, REMINDER_NS
from appliance.supervision.ledger import Ledger
from appliance.supervision.policy import POLICY, Durations, Policy, pulses
from appliance.supervision.supervisor import AlarmTable
from appliance.types import Fault, State
from tools.development import profiles as profile_page
from tools.development.evidence_figures import Figures
from tools.development.evidence_pages import pages, read_figures
from tools.development.hazard_pages import hazard_pages, remedies
from tools.development.hazards import PAGE, hazards, step_told, steps
from tools.development.markdown import table
from tools.shared.gesture_drawings import drawing

MANUAL = Path(__file__).parents[2] / "docs" / "alarms.md"
_OWN = {
    "acknowledged": "A person has acknowledged the latched state.",
    "scanning": "The scan of a recalibration is going on.",
}

_HEAD = """# States and alarms

`make docs` writes this page from the code; `tests/tools/development/test_manual.py` fails when they differ.

The contact is closed in one state only, MONITORING. Every other state, a crash, a cut cable and a missing supply open
it. A lamp or a sounder hangs on the normally closed contact of its relay, the green lamp on the normally open one:
energised is safe for all of them, and a dead cart lights red, yellow and cyan and sounds.

HALT and RECALIBRATION REQUESTED latch: they end when a person has acknowledged **and** the line has verified the
calibration since, in either order, or with a recalibration that was confirmed. They outlive a restart and a power cut.
They are told as the fault that led there until another one has been shown in its place for as long as a HALT takes, or
anew after an OK: then as that one, and it sounds again unless it was acknowledged with the first.
"""


_PROPOSALS = """As in the paper, a recalibration is requested only for what motion does not recover: a scale, and the
offset across the picture (ζ); its time counts from when that was first shown, whether alone or beside other faults. All
else ends in HALT, with the way out of it: set the flip back, correct the tool file, or accept what is
proposed. HALT is no milder: both latch.

A FAULT of rotation, offset, scale or latency is reported with its old value, its new one and the sigma once
motion has measured them: by `probewatch status`, the page, the alarm log (`proposal`) and the report. Nothing is
applied:

- latency: set `latency_ms` in the tracker's URL and restart the service;
- rotation, in-plane offset: `probewatch calibration recover` writes the recovered X, `probewatch calibration use` takes
  it once a person has accepted the difference, and new motion must verify it before the contact closes;
- a scale, the offset across the picture (ζ), and whatever stands beside one of them: motion alone does not recover it,
  `probewatch recalibrate` does. A scale is mostly the scanner's depth or zoom: set it as calibrated first.

Where two classes are as likely, none is named: the status, the log (`undecided`) and the report name each, by how much
the likeliest leads, and the motion that shows which. The contact is open meanwhile. Once the evidence that something is
wrong is what names a fault, and the choice has lasted a second, it is the hazard `undecided`: WARNING, then HALT. What
motion then names takes its place, also while it is latched."""


def manual(figures: Figures) -> str:
    """The whole page, Markdown. figures: what was last measured."""
    tables = (
        *(_diagram(), _transitions(), _guards(), _policy(), _certainty(), _durations()),
        *(_signals(), _hazards(), _audio(), hazard_pages(figures)),
    )
    return "\n".join((_HEAD, *(line for table in tables for line in table)))


def profiles() -> dict[Path, str]:
    """The page on profiles, of the figures that are kept."""
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


def _diagram() -> list[str]:
    """What the tick does; requests are in the table."""
    edges = [(a, _target(t)) for a, t in _rows() if t.event == "tick" and a is not _target(t)]
    lines = [f"    {a.name} --> {b.name}" for a, b in dict.fromkeys(edges)]
    names = [f"    {state.name} : {state.value}" for state in State]
    return ["## Diagram", "", "```mermaid", "stateDiagram-v2", "    [*] --> SELF_TEST", *names, *lines, "```", ""]


def _transitions() -> list[str]:
    rows = [(a.value, t.event, _guard(t) or "always", _target(t).value) for a, t in _rows()]
    text = "Tried from top to bottom, twenty times a second and at every request; the first that holds is taken."
    return ["## Transitions", "", text, "", *table(("state", "event", "when", "next"), rows)]


def _guards() -> list[str]:
    words = {word for _, t in _rows() for word in re.findall(r"[a-z_]+", _guard(t))} - {"and", "or", "not"}
    rows = [(f"`{name}`", _OWN.get(name) or _said(getattr(Ledger, name))) for name in sorted(words)]
    return ["## Guards", "", *table(("guard", "holds when"), rows)]


def _said(guard: object) -> str:
    """Its docstring in one line, as a table wants it."""
    return " ".join(str(guard.__doc__).split())


def _policy() -> list[str]:
    text = (
        "What each hazard leads to while it is shown; nothing else does. *Of* names the checks whose time counts,\n"
        "where not every check of the hazard leads there. The supervisor reads this table\n"
        "(`appliance/supervision/policy.py`), `tests/appliance/supervision/test_policy.py` walks each row."
    )
    head = ("hazard", "leads to", "tone", "during a recalibration scan", "ends when")
    rows = [
        (
            f"`{fault}`",
            steps(row),
            _tones(fault, row),
            step_told(row.scan) if row.scan else "it goes on",
            row.ending.value,
        )
        for fault, row in POLICY.items()
        if fault is not Fault.AGREEMENT
    ]
    return ["## Policy", "", text, "", *table(head, rows), *_PROPOSALS.splitlines(), ""]


def _certainty() -> list[str]:
    """The policy's other half: how probable it must be before a row of the table counts."""
    sigma, hours = Limits().confidence_sigma, exp(NAMED_NATS) / 3600 / 30
    rows = [
        ("beyond its limit, but by less than that", "nothing; the reason tells it as *not certain*", "none"),
        (
            f"beyond its limit by {sigma:g} sigma in one window, or by a likelihood ratio of {WITHDRAWN_NATS:g} nats",
            "the OK is withdrawn: not verified at once, until new motion answers it",
            "1 pulse once",
        ),
        (
            "a leap of the marker body that no picture witnessed; a slower slip",
            "what was shown before counts no more: not verified at once",
            "1 pulse once",
        ),
        (
            f"the same in two windows in a row, or by {NAMED_NATS:.1f} nats (once in {hours:.0f} h for nothing) "
            "and by one class alone; or a fact, as a mirrored picture",
            "the row of its hazard, for as long as it is shown",
            "as the row says",
        ),
        (
            f"by {NAMED_NATS:.1f} nats, and by two classes alike, for a second",
            "the row of `undecided`",
            "as the row says",
        ),
    ]
    head = ("how sure the line is that something is wrong", "what follows", "tone")
    return ["### How sure, before how loud", "", *table(head, rows)]


def _tones(fault: Fault, row: Policy) -> str:
    tones = [_tone(pulses(step.state, fault)) for step in row.steps]
    return ", then ".join(dict.fromkeys(tones)) or "silent"


def _durations() -> list[str]:
    defaults = {one.name.removesuffix("_ns"): getattr(Durations(), one.name) / 1e9 for one in fields(Durations)}
    rows = [(f"`{name}_s`", f"{default_s:g}") for name, default_s in defaults.items()]
    return ["## Durations", "", "In `[supervisor]` of the configuration.", "", *table(("key", "default, s"), rows)]


def _signals() -> list[str]:
    rows = [_signal(state, row) for state, row in SIGNALS.items()]
    head = ("state", "priority", "lamp", "tone", "text", "remedy")
    told = f"While monitoring the text adds *{EARLIER}*, or *{PARTLY_EARLIER}*, where motion"
    carried = (
        f"{told}\nof the last {PRESENT_NS / 1e9:g} s does not show all that is verified: it is carried until it is too"
        " old, and then missing."
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
    head = ("class", "kind", "self-test", "text", "remedy")
    rows = [
        (f"`{name}`", name.kind.value, "yes" if POLICY[name].tested else "", row.text, remedies(row))
        for name, row in HAZARDS.items()
    ]
    return ["## Hazards", "", *table(head, rows)]


def _audio() -> list[str]:
    pause_s, reminder_s, test_s = (t_ns / 1e9 for t_ns in (LONGEST_PAUSE_NS, REMINDER_NS, LAMP_TEST_NS))
    return [
        "## Audio",
        "",
        f"`probewatch pause` silences for at most {pause_s:g} s; `probewatch ack` until another alarm comes;",
        "`probewatch pause --off REASON` until `--on`. Acknowledged or off, an alarm of high or medium priority",
        f"reminds of itself with one pulse every {reminder_s:g} s. `probewatch lamp-test` shows and sounds everything",
        f"for {test_s:g} s and leaves the contact alone. All of it is in the alarm log, with who asked.",
        "",
    ]


if __name__ == "__main__":
    MEASURED = read_figures()
    for path, text in {
        MANUAL: manual(MEASURED),
        PAGE: hazards(MEASURED),
        **pages(MEASURED),
        **profiles(),
        **drawings(),
    }.items():
        path.write_text(text, encoding="utf-8")
