"""Writes docs/hazards.md for `make docs`: each hazard, its severity, control, what remains, and the evidence; and
docs/hazard-tests.csv, the tests of each.

What finds a hazard declares it (`REPORTS_FAULTS` of a module of the appliance); a test that tries it names it.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

from probewatch.appliance.supervision.alarms import HAZARDS, SIGNALS, Priority
from probewatch.appliance.supervision.policy import Policy, Step
from probewatch.appliance.types import Fault
from probewatch.tools.development.evidence_figures import Figures, of_fault
from probewatch.tools.development.markdown import table

ROOT = Path(__file__).parents[2]
PAGE, ANOMALIES = ROOT / "docs" / "hazards.md", ROOT / "docs" / "known-anomalies.md"
TESTS = ROOT / "docs" / "hazard-tests.csv"

_GENERAL = ("tests/tools", "tests/support", "tests/rules", "tests/data")
"""Tests of how a hazard is shown, not of whether it is found and controlled."""

_HEAD = """# Hazards

What controls each hazard, what remains, and the tests. Texts and remedies: [alarms.md](alarms.md#hazards); use:
[intended-use.md](intended-use.md). `make docs` writes this page from code and tests.

- **severity**: highest priority of alarm that it leads to. Severity and probability of harm depend on what the contact
  drives: this is not the risk analysis of a medical device.
- **control**: states that it leads to ([when](alarms.md#policy)), which open the contact, and the code that finds it. A
  notice leaves the contact as it is.
- **residual**: simulated runs without a FAULT in the last study (– where it is not simulated); numbers of the [known
  anomalies](known-anomalies.md) that name it. {unnamed} of the {rows} there name no hazard and may touch any: read all.
- **evidence**: figures of what was simulated; number of files of tests that name it.

`tests/invariant/` drives all with random disturbances against one invariant: *closed ⇒ everything required was shown by
motion recent enough, and nothing contradicts it*. `tests/live/test_failures.py` tries the loss of each part.
"""
_PRIORITIES = (Priority.HIGH, Priority.MEDIUM, Priority.LOW, Priority.NONE)


def hazards(figures: Figures) -> str:
    """Returns the whole page, Markdown. figures: what was last measured."""
    head = ("hazard", "severity", "control", "residual", "evidence")
    known = _known()
    unnamed = sum(not any(f"`{hazard}`" in row for hazard in HAZARDS) for row in known.values())
    told = _HEAD.format(unnamed=unnamed, rows=len(known))
    return "\n".join([told, *table(head, (_row(hazard, figures) for hazard in HAZARDS))])


def traced() -> str:
    """Returns each hazard with each file of tests that names it, CSV."""
    rows = [f"{hazard},{file}" for hazard in HAZARDS for file in _tests(hazard)]
    return "\n".join(("hazard,tests", *rows, ""))


def _row(hazard: Fault, figures: Figures) -> tuple[str, ...]:
    row, number = HAZARDS[hazard].policy, len(_tests(hazard))
    reached = ", ".join(step.state.value for step in row.steps)
    finders = ", ".join(f"[{Path(file).stem}](../{file})" for file in found_by()[hazard])
    return (
        f"`{hazard}`: {HAZARDS[hazard].text}",
        _severity(row),
        f"{reached or 'notice'}; by {finders}",
        f"{_missed(hazard, figures)}; {_anomalies(hazard)}",
        f"{_figures(hazard, figures)}[tests: {number}]({TESTS.name})",
    )


def _tests(hazard: Fault) -> list[str]:
    return [one for one in _tried_by()[hazard] if not one.startswith(_GENERAL)]


def _severity(row: Policy) -> str:
    """Returns the severity of the worst state that it leads to."""
    reached = {SIGNALS[step.state].priority for step in row.steps}
    return next((priority.value for priority in _PRIORITIES if priority in reached), "advisory")


def _missed(hazard: Fault, figures: Figures) -> str:
    found = of_fault(figures.found, hazard)
    runs = sum(one.runs for one in found)
    return f"{sum(one.runs - len(one.fault_s) for one in found)}/{runs}" if runs else "–"


def _known() -> dict[str, str]:
    """Returns number → row of each known anomaly; the page has several tables, whose headings have no number."""
    return {
        found[1]: found[0] for found in re.finditer(r"^\| (\d+) \|.*$", ANOMALIES.read_text(encoding="utf-8"), re.M)
    }


def _anomalies(hazard: Fault) -> str:
    return ", ".join(number for number, row in _known().items() if f"`{hazard}`" in row) or "none"


@cache
def found_by() -> dict[Fault, list[str]]:
    """Returns hazard → files of the appliance that declare in `REPORTS_FAULTS` that they report it."""
    files = sorted(file.relative_to(ROOT).as_posix() for file in (ROOT / "appliance").rglob("*.py"))
    finds = {file: getattr(import_module(_module(file)), "REPORTS_FAULTS", ()) for file in files}
    return {hazard: [file for file in files if hazard in finds[file]] for hazard in HAZARDS}


@cache
def _tried_by() -> dict[Fault, list[str]]:
    """Returns hazard → files of tests that name it, or import a module that finds it alone."""
    finders = found_by()
    alone = {_module(file): hazard for hazard in HAZARDS for file in finders[hazard] if _counted(file, finders) == 1}
    found: dict[Fault, list[str]] = {hazard: [] for hazard in HAZARDS}
    for file in sorted((ROOT / "tests").rglob("test_*.py")):
        nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
        for hazard in _named(nodes) | {alone[name] for name in _imported(nodes) if name in alone}:
            found[hazard].append(file.relative_to(ROOT).as_posix())
    return found


def steps(row: Policy) -> str:
    """Returns what a row of the policy leads to."""
    return ", then ".join(step_text(step) for step in row.steps) or "notice beside the state"


def step_text(step: Step) -> str:
    """Returns the text of one step."""
    after = " + ".join(f"`{name}`" for name in step.after)
    by = " or ".join(f"`{name}`" for name in step.by)
    return f"{step.state.value} {f'after {after}' if after else 'at once'}{f' of {by}' if by else ''}"


def _figures(hazard: Fault, figures: Figures) -> str:
    """Returns a link to the section of the evidence on it, where it was measured."""
    return f"[figures](evidence.md#{hazard}), " if of_fault(figures.found, hazard) else ""


def _counted(file: str, finders: dict[Fault, list[str]]) -> int:
    """Returns how many hazards this file finds: a test of one that finds a single hazard is a test of that hazard."""
    return sum(file in files for files in finders.values())


def _module(file: str) -> str:
    return f"probewatch.{file.removesuffix('.py').replace('/', '.')}"


def _imported(nodes: list[ast.AST]) -> Iterator[str]:
    return (str(node.module) for node in nodes if isinstance(node, ast.ImportFrom))


def _named(nodes: list[ast.AST]) -> set[Fault]:
    """Returns the hazards that the nodes name: by their member of Fault, by the word that JSON and log have for them,
    or by what the operator reads.
    """
    words = {text: hazard for hazard, row in HAZARDS.items() for text in (hazard.value, row.text)}
    found = set()
    for node in nodes:
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "Fault":
            found |= {hazard for hazard in HAZARDS if hazard.name == node.attr}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in words:
            found.add(words[node.value])
    return found
