"""`make docs` writes docs/hazards.md: each hazard, what finds it, what then happens, and which tests try it.

Found in the code: who makes a check of a class names it, and so does a test that tries it.
"""

import ast
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from appliance.supervision.alarms import HAZARDS
from appliance.types import Fault, Kind

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "hazards.md"

CONTROLS = {
    Kind.CALIBRATION: "contact opens, warning; halt that latches until acknowledged and verified again",
    Kind.DEVICE: "contact opens, warning; device lost, an alarm of high priority; recovers by itself",
    Kind.INTERNAL: "contact opens; internal fault, an alarm of high priority; the part is started again",
    Kind.INTEGRITY: "contact opens; internal fault until a person has acknowledged it",
    Kind.SIGHT: "contact opens; not verified until there is something to compare",
    Kind.ADVISORY: "notice beside the state and entry of the log; the contact stays as it is",
}
"""What the supervisor does; the transitions are in docs/alarms.md."""

_FINDERS = (
    "appliance/core",
    "appliance/storage",
    "appliance/supervision/watchers",
    "appliance/supervision/overload.py",
)
_TESTS = ("tests",)
_GENERAL = ("tests/tools", "tests/support", "tests/rules", "tests/data")
"""Tests of how a hazard is shown, not of whether it is found and controlled."""

_HEAD = """# Hazards, controls and tests

`make docs` writes this page from the code; `tests/tools/development/test_manual.py` fails when they differ. It tells
which part of the code finds a hazard, what the supervisor then does, and which files of tests name it. The invariant of
all of them, *closed ⇒ everything required was shown by motion recent enough, and nothing contradicts it*, is driven by
random disturbances in `tests/invariant/`; the loss of each part is walked by `tests/live/test_failures.py`. What a user
reads and does is in [alarms.md](alarms.md), what the product is not for in [intended-use.md](intended-use.md).

It is no risk analysis of a medical device: severity and probability of harm depend on what the contact is wired to.
"""


def hazards() -> str:
    """The whole page, Markdown."""
    finders = _named_in(_FINDERS, _named)
    alone = {_module(file): hazard for hazard in HAZARDS for file in finders[hazard] if _counted(file, finders) == 1}
    tests = _named_in(_TESTS, lambda tree: _named(tree) | {alone[name] for name in _imported(tree) if name in alone})
    lines = [_HEAD, "| hazard | found by | control | tests |", "| --- | --- | --- | --- |"]
    for hazard, row in HAZARDS.items():
        cells = (
            f"`{hazard}`: {row.text}",
            _listed(finders[hazard]),
            CONTROLS[hazard.kind],
            _listed(one for one in tests[hazard] if not one.startswith(_GENERAL)),
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join((*lines, ""))


def _listed(files: Iterable[str]) -> str:
    return ", ".join(f"`{file}`" for file in files)


def _named_in(places: tuple[str, ...], named: Callable[[ast.Module], set[Fault]]) -> dict[Fault, list[str]]:
    """Hazard → files that name it."""
    found: dict[Fault, list[str]] = {hazard: [] for hazard in HAZARDS}
    for file in sorted(file for place in places for file in _modules(ROOT / place)):
        for hazard in named(ast.parse(file.read_text(encoding="utf-8"))):
            found[hazard].append(file.relative_to(ROOT).as_posix())
    return found


def _counted(file: str, finders: dict[Fault, list[str]]) -> int:
    """How many hazards this file finds: a test of one that finds a single hazard is a test of that hazard."""
    return sum(file in files for files in finders.values())


def _module(file: str) -> str:
    return file.removesuffix(".py").replace("/", ".")


def _imported(tree: ast.Module) -> Iterator[str]:
    return (str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom))


def _modules(place: Path) -> list[Path]:
    return [place] if place.is_file() else [*place.rglob("*.py")]


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
