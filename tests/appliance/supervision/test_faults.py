"""Every fault has one whole row, and what the code says of a fault is in its row."""

import ast
from collections.abc import Iterator
from dataclasses import fields
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

from probewatch.appliance.supervision import policy
from probewatch.appliance.supervision.fault_row import FaultRow, Texts
from probewatch.appliance.supervision.faults import FAULT_ROWS
from probewatch.appliance.supervision.languages import GERMAN, LANGUAGES
from probewatch.appliance.types import Fault

ROOT = Path(__file__).parents[3]
ROWS = ROOT / "appliance" / "supervision" / "faults.py"
LONGEST_NAME = 20
"""Two columns of checks fit 80 columns."""
POLICIES = {
    "GROSS": ("polarity", "pose-convention"),
    "PLAIN": ("rotation", "latency", "marker-body-moved", "undecided"),
    "SCALE": ("scale", "exchanged-probe"),
    "OFFSET": ("offset",),
    "DEVICE": (
        *("frozen-video", "video-lost", "tracker-alert", "marker-body", "field-distortion", "tracker-lost"),
        "tracker-stale",
    ),
    "OUTPUT": ("output-failed",),
    "SILENT": ("estimator-silent",),
    "DAMAGED": ("memory-damaged", "log-damaged"),
    "UNSEEN": ("line-of-sight", "pose-unusable", "no-picture"),
    "PAUSED": ("user-freeze",),
    "ADVISORY": ("agreement", "log-not-written", "overloaded", "calibration-file", "calibration-due"),
}
"""Written twice, as the contact depends on it: a policy that changes by mistake is noticed. It may lack a new class.
"""


def test_every_fault_has_exactly_one_row() -> None:
    lacking = [f"Fault.{fault.name}" for fault in Fault if fault not in FAULT_ROWS]
    assert not lacking, f"no row in {ROWS.relative_to(ROOT)}: {', '.join(lacking)}"
    (table,) = (
        node.value
        for node in ast.parse(ROWS.read_text(encoding="utf-8")).body
        if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == "FAULT_ROWS"
    )
    assert isinstance(table, ast.Dict)
    assert [ast.unparse(key) for key in table.keys if key] == [f"Fault.{fault.name}" for fault in FAULT_ROWS]


@pytest.mark.parametrize("name", POLICIES)
def test_the_faults_that_open_the_contact_do_it_by_the_policy_that_was_meant(name: str) -> None:
    for word in POLICIES[name]:
        assert FAULT_ROWS[Fault(word)].policy is getattr(policy, name), f"{word}: {name} was meant"


def texts(row: FaultRow) -> dict[str, Texts]:
    """By language."""
    return {one.name: getattr(row, one.name) for one in fields(FaultRow) if one.type is Texts}


@pytest.mark.parametrize("fault", FAULT_ROWS)
def test_every_fault_is_said_in_every_language(fault: Fault) -> None:
    said = texts(FAULT_ROWS[fault])
    assert said.keys() == LANGUAGES.keys()
    for one in said.values():
        assert bool(one.text) is bool(one.remedy) is (fault is not Fault.AGREEMENT), "text and remedy, or a mere fact"
        assert bool(one.requested) is bool(said["en"].requested), f"{fault}: requested in one language alone"
    assert not said["en"].checks, "names of checks are English words"


@pytest.mark.parametrize("fault", FAULT_ROWS)
def test_a_text_has_one_translation(fault: Fault) -> None:
    said = FAULT_ROWS[fault].translations()
    assert {english: GERMAN[english] for english in said} == said


@cache
def code() -> dict[str, str]:
    """File → its text, of the appliance without the tables of texts."""
    files = sorted(file for file in (ROOT / "appliance").rglob("*.py") if file.name not in (ROWS.name, "languages.py"))
    return {file.relative_to(ROOT).as_posix(): file.read_text(encoding="utf-8") for file in files}


def checks_made(text: str) -> Iterator[tuple[str, Fault]]:
    """(name, fault) of each, where both are written beside each other: in a call, or a tuple that becomes one."""
    module = ast.parse(text) if "Fault." in text else ast.Module([], [])
    assigned = [one for one in module.body if isinstance(one, ast.Assign)]
    named = {one.id: node.value for node in assigned for one in node.targets if isinstance(one, ast.Name)}
    for node in ast.walk(module):
        parts = node.args if isinstance(node, ast.Call) else node.elts if isinstance(node, ast.Tuple) else []
        for name, fault in pairwise(parts):
            said = named.get(name.id) if isinstance(name, ast.Name) else name
            if isinstance(said, ast.Constant) and isinstance(said.value, str) and is_fault(fault):
                yield said.value, Fault[ast.unparse(fault).removeprefix("Fault.")]


def is_fault(node: ast.AST) -> bool:
    return isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "Fault"


def test_every_check_of_the_code_has_a_translated_name_in_the_row_of_its_fault() -> None:
    made = [(file, *one) for file, text in code().items() for one in checks_made(text)]
    assert len(made) > 30
    where = f"`checks` of the texts of its row in {ROWS.relative_to(ROOT)}"
    lacking = [(file, name, fault) for file, name, fault in made if name not in FAULT_ROWS[fault].checks]
    assert not lacking, "\n".join(f"{file}: '{name}' of {fault} is not among {where}" for file, name, fault in lacking)


def test_every_check_of_a_row_is_made_somewhere() -> None:
    names = [name for row in FAULT_ROWS.values() for name in row.checks]
    assert [name for name in names if not any(f'"{name}"' in text for text in code().values())] == []


def test_the_names_of_checks_are_short_and_each_is_of_one_fault() -> None:
    names = [name for row in FAULT_ROWS.values() for name in row.checks]
    assert len(names) == len({*names}) == len({GERMAN[name] for name in names})
    assert {name: GERMAN[name] for name in names if len(GERMAN[name]) > LONGEST_NAME} == {}
