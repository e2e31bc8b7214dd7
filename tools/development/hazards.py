"""`make docs` writes docs/hazards.md: each hazard, what finds it, what then happens, its tests, its figures.

What finds a hazard declares it (`FINDS` of a module of the appliance); a test that tries it names it.
"""

import ast
from collections.abc import Iterable, Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

from appliance.supervision.alarms import HAZARDS
from appliance.supervision.policy import POLICY, Policy, Step
from appliance.types import Fault
from tools.development.evidence_figures import Figures
from tools.study.hazard import FAULTS, Hazard

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "hazards.md"

_GENERAL = ("tests/tools", "tests/support", "tests/rules", "tests/data")
"""Tests of how a hazard is shown, not of whether it is found and controlled."""

_HEAD = """# Hazards, controls, tests and figures

`make docs` writes this page from the code; `tests/tools/development/test_manual.py` fails when they differ. Of each
hazard it tells what is required (its section in the manual), which part of the code finds it, what the supervisor then
does (its row of the policy), which files of tests name it, and where what was measured stands. The invariant of
all of them, *closed ⇒ everything required was shown by motion recent enough, and nothing contradicts it*, is driven by
random disturbances in `tests/invariant/`; the loss of each part is walked by `tests/live/test_failures.py`. What a user
reads and does is in [alarms.md](alarms.md), what the product is not for in [intended-use.md](intended-use.md).

It is not the risk analysis of a medical device: severity and probability of harm depend on what the contact drives.
"""


def hazards(figures: Figures) -> str:
    """The whole page, Markdown. figures: what was last measured."""
    finders = found_by()
    tests = _tried_by()
    lines = [_HEAD, "| requirement | found by | control | tests | figure |", "| --- | --- | --- | --- | --- |"]
    for hazard, row in HAZARDS.items():
        cells = (
            f"[`{hazard}`](alarms.md#{hazard}): {row.text}",
            _listed(finders[hazard]),
            f"contact {'opens' if POLICY[hazard].steps else 'stays as it is'}; {steps(POLICY[hazard])}",
            _listed(one for one in tests[hazard] if not one.startswith(_GENERAL)),
            _figures(hazard, figures),
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join((*lines, ""))


@cache
def found_by() -> dict[Fault, list[str]]:
    """Hazard → files of the appliance that declare in `FINDS` that they tell of it."""
    files = sorted(file.relative_to(ROOT).as_posix() for file in (ROOT / "appliance").rglob("*.py"))
    finds = {file: getattr(import_module(_module(file)), "FINDS", ()) for file in files}
    return {hazard: [file for file in files if hazard in finds[file]] for hazard in HAZARDS}


@cache
def _tried_by() -> dict[Fault, list[str]]:
    """Hazard → files of tests that name it, or import what finds it alone."""
    finders = found_by()
    alone = {_module(file): hazard for hazard in HAZARDS for file in finders[hazard] if _counted(file, finders) == 1}
    found: dict[Fault, list[str]] = {hazard: [] for hazard in HAZARDS}
    for file in sorted((ROOT / "tests").rglob("test_*.py")):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        for hazard in _named(tree) | {alone[name] for name in _imported(tree) if name in alone}:
            found[hazard].append(file.relative_to(ROOT).as_posix())
    return found


def steps(row: Policy) -> str:
    """What a row of the policy leads to."""
    return ", then ".join(step_told(step) for step in row.steps) or "notice beside the state"


def step_told(step: Step) -> str:
    """One step of it."""
    after = " + ".join(f"`{name}`" for name in step.after)
    by = " or ".join(f"`{name}`" for name in step.by)
    return f"{step.state.value} {f'after {after}' if after else 'at once'}{f' of {by}' if by else ''}"


def _figures(hazard: Fault, figures: Figures) -> str:
    """Sections of the evidence on its kinds that were measured."""
    kinds = dict.fromkeys(Hazard.parse(one.hazard).kind for one in figures.found)
    return ", ".join(f"[{kind}](evidence.md#{kind})" for kind in kinds if FAULTS[kind] is hazard) or "not measured"


def _listed(files: Iterable[str]) -> str:
    return ", ".join(f"`{file}`" for file in files)


def _counted(file: str, finders: dict[Fault, list[str]]) -> int:
    """How many hazards this file finds: a test of one that finds a single hazard is a test of that hazard."""
    return sum(file in files for files in finders.values())


def _module(file: str) -> str:
    return file.removesuffix(".py").replace("/", ".")


def _imported(tree: ast.Module) -> Iterator[str]:
    return (str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom))


def _named(tree: ast.Module) -> set[Fault]:
    """By its member of Fault, by the word that JSON and log have for it, or by what the operator reads."""
    words = {text: hazard for hazard, row in HAZARDS.items() for text in (hazard.value, row.text)}
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "Fault":
            found |= {hazard for hazard in HAZARDS if hazard.name == node.attr}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in words:
            found.add(words[node.value])
    return found
