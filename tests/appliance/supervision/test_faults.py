"""Every fault has one whole row, and what the code says of a fault is in its row."""

import ast
from dataclasses import fields
from pathlib import Path

import pytest

from appliance.supervision import policy
from appliance.supervision.fault_row import FaultRow, Texts
from appliance.supervision.faults import FAULT_ROWS
from appliance.supervision.languages import GERMAN, LANGUAGES
from appliance.types import Fault

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


def code() -> dict[str, ast.Module]:
    """File → what it says, of the appliance without the tables of texts."""
    files = sorted(file for file in (ROOT / "appliance").rglob("*.py") if file.name not in (ROWS.name, "languages.py"))
    return {file.relative_to(ROOT).as_posix(): ast.parse(file.read_text(encoding="utf-8")) for file in files}


def test_every_check_of_a_row_is_made_somewhere() -> None:
    written = {node.value for module in code().values() for node in ast.walk(module) if isinstance(node, ast.Constant)}
    assert [name for row in FAULT_ROWS.values() for name in row.checks if name not in written] == []


def test_the_names_of_checks_are_short_and_each_is_of_one_fault() -> None:
    names = [name for row in FAULT_ROWS.values() for name in row.checks]
    assert len(names) == len({*names}) == len({GERMAN[name] for name in names})
    assert {name: GERMAN[name] for name in names if len(GERMAN[name]) > LONGEST_NAME} == {}
