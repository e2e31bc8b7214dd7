"""Reports the demo's result: a table for people and JSON for machines (docs/demo-report.md)."""

from collections.abc import Mapping
from dataclasses import dataclass

from rich.console import Console

from probewatch.appliance.core.quality.check_fields import up_to
from probewatch.appliance.types import State
from probewatch.tools.demo.outcome import Finding, History, Moment, Outcome, Prompt
from probewatch.tools.shared.tables import NOTHING, FittingTable

VERSION = 1
_SHOWN = (State.WARNING, State.HALT, State.RECALIBRATION_REQUESTED, State.DEVICE_LOST)


@dataclass(frozen=True, slots=True)
class Circumstances:
    """Holds how the run was made. counters: those of the service, at the end."""

    seed: int
    speed: float
    tissue: str
    counters: Mapping[str, int]


def print_report(console: Console, outcome: Outcome) -> None:
    """Prints the timeline, alarms that had no fault, and the judgement in one sentence."""
    if outcome.findings:
        console.print(_timeline(outcome.findings), crop=False)
        console.print("Seconds after the fault began; verified: seconds after it ended.\n")
    if outcome.unexpected:
        console.print(_unexpected(outcome.unexpected), crop=False)
    colour = "green" if outcome.passed else "yellow" if outcome.too_busy else "red"
    console.print(_sentence(outcome), soft_wrap=True, style=colour)


def _sentence(outcome: Outcome) -> str:
    if outcome.too_busy:
        return f"TOO BUSY: this computer is overloaded, so there is no result. {outcome.sentence}"
    if not outcome.passed:
        return f"FAILED: {outcome.sentence}"
    number = len(outcome.findings)
    worth = "" if outcome.point_mm is None else f" Verified to {up_to(outcome.point_mm)} mm."
    if number == 0:
        return f"PASSED: calibration verified at {outcome.verified_s:.1f} s, and nothing alarmed.{worth}"
    faults = "The fault was" if number == 1 else f"All {number} faults were"
    return f"PASSED: {faults} found, rightly named, halted and recovered from; nothing else alarmed.{worth}"


def _timeline(findings: tuple[Finding, ...]) -> FittingTable:
    headings = ("fault", "at", "named", "warning", "halt", "recal.", "lost", "contact", "verified")
    rows = []
    for one in findings:
        numbers = (*(one.reached.get(state) for state in _SHOWN), one.contact_open_after_s, one.verified_after_s)
        rows.append((one.injection.fault, _shown(one.injection.from_s), one.named or NOTHING, *map(_shown, numbers)))
    return FittingTable(headings, rows, right_from=3, tight=True)


def _unexpected(moments: tuple[Moment, ...]) -> FittingTable:
    headings = ("alarm without a fault", "at", "named", "reason")
    rows = [(one.state.value, f"{one.t_s:.2f}", one.fault or NOTHING, one.reason) for one in moments]
    return FittingTable(headings, rows)


def _shown(number: float | None) -> str:
    return NOTHING if number is None else f"{number:.2f}"


def report_fields(outcome: Outcome, history: History, circumstances: Circumstances) -> dict[str, object]:
    """Returns the JSON report; its keys are a contract."""
    return {
        "version": VERSION,
        "passed": outcome.passed,
        "reason": outcome.sentence,
        "too_busy": outcome.too_busy,
        "seed": circumstances.seed,
        "speed": circumstances.speed,
        "tissue": circumstances.tissue,
        "duration_s": _number(history.end_s),
        "verified_s": _number(outcome.verified_s),
        "point_mm": _number(outcome.point_mm),
        "faults": [_fault(one) for one in outcome.findings],
        "unexpected": [_moment(one) for one in outcome.unexpected],
        "timeline": [_moment(one) for one in history.moments],
        "prompts": [_prompt(one) for one in history.prompts],
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


def _prompt(one: Prompt) -> dict[str, object]:
    return {"t_s": _number(one.t_s), "asked": one.asked, "missing": [*one.missing], "gesture": [*one.gesture]}


def _number(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds, 3)
