"""The demo's result: a table for people and JSON for machines (docs/demo-report.md)."""

from collections.abc import Mapping
from dataclasses import dataclass

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from appliance.types import State
from tools.demo_judgement import Finding, History, Moment, Outcome

VERSION = 1
_SHOWN = (State.WARNING, State.HALT, State.RECALIBRATION_REQUESTED, State.DEVICE_LOST)


@dataclass(frozen=True, slots=True)
class Circumstances:
    """What the run was made with. counters: of the service, at the end."""

    seed: int
    speed: float
    counters: Mapping[str, int]


def print_report(console: Console, outcome: Outcome) -> None:
    """Timeline, alarms that had no fault, and the judgement in one sentence."""
    if outcome.findings:
        console.print(_timeline(outcome.findings))
        console.print("Seconds after the fault began; verified: seconds after it ended.\n")
    if outcome.unexpected:
        console.print(_unexpected(outcome.unexpected))
    colour = "green" if outcome.passed else "yellow" if outcome.too_busy else "red"
    console.print(_sentence(outcome), soft_wrap=True, style=colour)


def _sentence(outcome: Outcome) -> str:
    if outcome.too_busy:
        return f"TOO BUSY: this computer is overloaded, so nothing can be told. {outcome.sentence}"
    if not outcome.passed:
        return f"FAILED: {outcome.sentence}"
    number = len(outcome.findings)
    if number == 0:
        return f"PASSED: calibration verified at {outcome.verified_s:.1f} s, and nothing alarmed."
    faults = "The fault was" if number == 1 else f"All {number} faults were"
    return f"PASSED: {faults} found, rightly named, halted and recovered from; nothing else alarmed."


def _timeline(findings: tuple[Finding, ...]) -> Table:
    table = Table(box=SIMPLE_HEAD, padding=0)
    for title in ("fault", "at", "named"):
        table.add_column(title, no_wrap=True)
    for title in ("warning", "halt", "recal.", "lost", "contact", "verified"):
        table.add_column(title, justify="right")
    for one in findings:
        numbers = (*(one.reached.get(state) for state in _SHOWN), one.contact_open_after_s, one.verified_after_s)
        table.add_row(one.injection.fault, _shown(one.injection.from_s), one.named or "–", *map(_shown, numbers))
    return table


def _unexpected(moments: tuple[Moment, ...]) -> Table:
    table = Table(
        "alarm without a fault", "at", "named", "reason", box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True
    )
    for one in moments:
        table.add_row(one.state.value, f"{one.t_s:.2f}", one.fault or "–", one.reason)
    return table


def _shown(number: float | None) -> str:
    return "–" if number is None else f"{number:.2f}"


def report_fields(outcome: Outcome, history: History, circumstances: Circumstances) -> dict[str, object]:
    """The JSON report; its keys are a contract."""
    return {
        "version": VERSION,
        "passed": outcome.passed,
        "reason": outcome.sentence,
        "too_busy": outcome.too_busy,
        "seed": circumstances.seed,
        "speed": circumstances.speed,
        "duration_s": _number(history.end_s),
        "verified_s": _number(outcome.verified_s),
        "faults": [_fault(one) for one in outcome.findings],
        "unexpected": [_moment(one) for one in outcome.unexpected],
        "timeline": [_moment(one) for one in history.moments],
        "contact": [{"t_s": _number(one.t_s), "energised": one.energised} for one in history.switches],
        "busy": [{"from_s": _number(one), "to_s": _number(other)} for one, other in history.busy_s],
        "counters": dict(circumstances.counters),
    }


def _fault(one: Finding) -> dict[str, object]:
    return {
        "fault": one.injection.fault,
        "class": one.injection.fault_class,
        "from_s": _number(one.injection.from_s),
        "to_s": _number(one.injection.to_s),
        "named": one.named,
        "warning_after_s": _number(one.reached.get(State.WARNING)),
        "halt_after_s": _number(one.reached.get(State.HALT)),
        "recalibration_request_after_s": _number(one.reached.get(State.RECALIBRATION_REQUESTED)),
        "device_lost_after_s": _number(one.reached.get(State.DEVICE_LOST)),
        "contact_open_after_s": _number(one.contact_open_after_s),
        "acknowledged_after_s": _number(one.acknowledged_after_s),
        "verified_after_s": _number(one.verified_after_s),
        "problem": one.problem,
    }


def _moment(one: Moment) -> dict[str, object]:
    return {"t_s": _number(one.t_s), "state": one.state.value, "fault": one.fault, "reason": one.reason}


def _number(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds, 3)
