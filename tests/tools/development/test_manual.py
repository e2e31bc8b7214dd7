"""The manual says what the code does."""

import ast
import re
from dataclasses import fields
from pathlib import Path

import pytest

from probewatch.appliance.configuration.config import SupervisorTimes
from probewatch.appliance.core.quality.gesture import Gesture
from probewatch.appliance.limits import Limits
from probewatch.appliance.service.control.requests import Requests, ServiceActions
from probewatch.appliance.service.control.status import alarm_fields, check_lists
from probewatch.appliance.supervision.alarms import HAZARDS
from probewatch.appliance.supervision.faults import FAULT_ROWS
from probewatch.appliance.supervision.supervisor import AlarmTable
from probewatch.appliance.types import AlarmState, Fault, State
from probewatch.drivers.registry import drivers
from probewatch.tools.development import driver_pages, status_pages
from probewatch.tools.development.evidence_pages import pages, read_figures
from probewatch.tools.development.hazards import PAGE, ROOT, TESTS, found_by, hazards, traced
from probewatch.tools.development.manual import MANUAL, drawings, manual, profiles
from probewatch.tools.study.hazard import FAULTS

DOCS = Path(__file__).parents[3] / "docs"
FIGURES = read_figures()


def test_the_page_on_alarms_is_the_one_the_code_writes() -> None:
    assert MANUAL.read_text(encoding="utf-8") == manual(), "run make docs"


def test_every_check_is_described_once_on_the_page_on_alarms() -> None:
    """Their names stood in status, feed and report, and on no page."""
    names = [f"`{name}`" for row in FAULT_ROWS.values() for name in row.checks]
    rows = [line.split(" | ") for line in manual().partition("## Checks")[2].partition("## Signals")[0].splitlines()]
    told = [row for row in rows if len(row) == 5 and row[0].startswith("| `")]
    assert sorted(row[0].removeprefix("| ") for row in told) == sorted(names)
    assert all(row[2] and row[3] for row in told)


def test_the_page_on_hazards_is_the_one_the_code_writes() -> None:
    assert PAGE.read_text(encoding="utf-8") == hazards(FIGURES), "run make docs"
    assert TESTS.read_text(encoding="utf-8") == traced(), "run make docs"


def test_the_page_on_profiles_is_the_one_the_figures_write() -> None:
    for page, text in profiles().items():
        assert page.read_text(encoding="utf-8") == text, f"{page}: run make docs"


def test_the_drawings_of_the_gestures_are_those_of_the_page() -> None:
    page = (MANUAL.parent / "gesture.md").read_text(encoding="utf-8")
    assert len(drawings()) == len(Gesture)
    for file, text in drawings().items():
        assert file.read_text(encoding="utf-8") == text, "run make docs"
        assert f"(pictures/{file.name})" in page


def test_the_pages_on_what_was_measured_are_the_ones_the_figures_write() -> None:
    for page, text in pages(FIGURES).items():
        assert page.read_text(encoding="utf-8") == text, f"{page}: run make docs"


def test_the_tables_of_the_drivers_are_those_of_their_descriptors() -> None:
    for file, text in driver_pages.written().items():
        assert file.read_text(encoding="utf-8") == text, f"{file}: run make docs"
    made = [name for page in driver_pages.PAGES for name in driver_pages.BLOCKS.names(page.read_text(encoding="utf-8"))]
    simulated = {driver.twin: driver.scheme for driver in reversed(drivers().values()) if driver.kinds == ("tracker",)}
    of_options = [f"options {one}" for one in (*simulated.values(), "igtl")]
    assert sorted(made) == sorted(["trackers", "video", "outputs", *of_options])
    assert driver_pages.BLOCKS.page("<!-- drivers: video -->\nold\n<!-- /drivers -->\n").count("v4l2:") == 1
    with pytest.raises(KeyError):
        driver_pages.BLOCKS.page("<!-- drivers: options nobody -->\n<!-- /drivers -->\n")


def test_the_tables_of_the_status_are_those_of_its_rows() -> None:
    for file, text in status_pages.written().items():
        assert file.read_text(encoding="utf-8") == text, f"{file}: run make docs"
        assert status_pages.BLOCKS.names(text)
    assert "outdated" not in status_pages.BLOCKS.page("<!-- status: fields -->\noutdated\n<!-- /status -->\n")
    with pytest.raises(KeyError):
        status_pages.BLOCKS.page("<!-- status: nobody -->\n<!-- /status -->\n")


def test_the_page_that_a_driver_names_has_a_row_for_each_of_its_options() -> None:
    named = [driver for driver in drivers().values() if driver.page]
    assert named
    for driver in named:
        text = (DOCS / driver.page).read_text(encoding="utf-8")
        cells = re.findall(r"^\| (`[a-z_]+`(?:, `[a-z_]+`)*) \|", text, re.M)
        assert {f"`{option.name}`" for option in driver.options} <= {
            name for cell in cells for name in cell.split(", ")
        }


def headings(page: Path) -> set[str]:
    """Anchors of a page whose headings are words with hyphens."""
    return set(re.findall(r"^###? ([\w-]+)$", page.read_text(encoding="utf-8"), re.M))


def test_the_anomalies_of_a_hazard_are_found_in_all_tables_of_their_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = tmp_path / "known.md"
    rows = ["named `latency` late", "also `latency`, then `scale`", "a disk that is full", "a name such as scale"]
    head = "| | what | effect |\n|---|---|---|\n"
    tables = (f"{head}| {7 + k} | {row} | none |\n" for k, row in enumerate(rows))
    known.write_text("\n## Another part\n".join(tables))
    monkeypatch.setattr("probewatch.tools.development.hazards.ANOMALIES", known)
    page = " ".join(hazards(FIGURES).split())
    assert "2 of the 4 there name no hazard" in page
    for fault, numbers in (("latency", "7, 8"), ("scale", "8"), ("polarity", "none")):
        (row,) = re.findall(rf"\| `{fault}`:.*?(?=\| `|## )", page)
        assert re.search(rf"/\d+; {numbers} \|", row)


def test_every_hazard_has_severity_control_residual_and_evidence_with_links() -> None:
    rows = [line.removesuffix(" |").split(" | ") for line in hazards(FIGURES).splitlines() if line.startswith("| `")]
    assert [row[0].split("`")[1] for row in rows] == [*HAZARDS]
    for fault, (requirement, severity, control, residual, evidence) in zip(HAZARDS, rows, strict=True):
        assert HAZARDS[fault].text in requirement
        assert severity in ("high", "medium", "low", "advisory")
        assert "(../appliance/" in control, f"nothing finds {fault}"
        assert re.fullmatch(r"(–|\d+/\d+); (none|\d+(, \d+)*)", residual)
        assert [step.state.value for step in HAZARDS[fault].policy.steps] == states_of(control)
        files = tried_in(fault)
        assert files, f"no test names {fault}"
        assert f"[tests: {len(files)}]" in evidence
        assert all((ROOT / file).is_file() for file in files)
        assert len(f"{requirement}{severity}{control}{residual}{evidence}") < 1000, "a row is to be read"
        linked = set(re.findall(r"\(evidence\.md#([\w-]+)\)", evidence))
        assert bool(linked) == (not residual.startswith("–"))
        assert linked <= headings(DOCS / "evidence.md")
        assert linked == ({fault} if fault in FAULTS.values() else set())


def states_of(control: str) -> list[str]:
    """Those that a row of the table of hazards says it leads to."""
    said = control.partition("; by ")[0]
    return [] if said == "notice" else said.split(", ")


def tried_in(fault: Fault) -> list[str]:
    """Files of tests that name it."""
    return re.findall(rf"^{fault},(.+)$", traced(), re.M)


def test_every_hazard_that_the_study_simulates_was_measured() -> None:
    told = re.findall(r"^### ([\w-]+)$|^\| `([\w-]+)[=@]", (DOCS / "evidence.md").read_text(encoding="utf-8"), re.M)
    found, under = dict[str, str](), ""
    for heading, kind in told:
        under = heading or under
        found |= {kind: under} if kind else {}
    assert found == FAULTS, "run make evidence"


def rows_of(heading: str) -> list[list[str]]:
    """Cells of the first table of a section of the page on alarms, without its heading."""
    lines = manual().split(f"## {heading}\n")[1].split("\n## ")[0].split("\n")
    return [line[2:-2].split(" | ") for line in lines if line.startswith("| ")][2:]


def test_every_hazard_says_what_to_do_and_its_limit() -> None:
    limits = {**Limits().model_dump(), **SupervisorTimes().model_dump()}
    rows = rows_of("Hazards")
    assert [row[2] for row in rows] == [f"`{fault}`" for fault in HAZARDS]
    for fault, (text, remedy, _, limit) in zip(HAZARDS, rows, strict=True):
        hazard = HAZARDS[fault]
        assert text == f"**{hazard.text}**"
        assert remedy.startswith(hazard.remedy)
        assert hazard.requested in remedy
        told = re.findall(r"`(\w+)` ([\d.]+)", limit)
        assert bool(told) == (limit != "–")
        assert all(limits[key] == pytest.approx(float(value), rel=1e-3) for key, value in told)
        assert found_by()[fault], f"nothing decides that {fault} is there"


def test_every_hazard_has_a_policy_and_says_where_it_leads() -> None:
    led = {fault: row[1] for row in rows_of("Policy") for fault in re.findall(r"`([a-z-]+)`", row[0])}
    assert led.keys() == HAZARDS.keys()
    for fault, told in led.items():
        last = [step.state.value for step in HAZARDS[fault].policy.steps][-1:] or ["notice beside the state"]
        assert told.rpartition(", then ")[2].startswith(last[0])


MAKES_OF_OTHERS = {"appliance/core/exact_fields.py", "appliance/supervision/device_health.py"}
"""They read a check, or make one of a class that they are given."""


def checks_made(file: Path) -> list[ast.Call]:
    calls = (node for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))) if isinstance(node, ast.Call))
    return [call for call in calls if isinstance(call.func, ast.Name) and call.func.id == "Check"]


def test_whoever_makes_a_check_declares_what_it_finds() -> None:
    made = {file.relative_to(ROOT).as_posix(): checks_made(file) for file in (ROOT / "appliance").rglob("*.py")}
    makers = {file: calls for file, calls in made.items() if calls and file not in MAKES_OF_OTHERS}
    assert len(makers) > 10
    for file, calls in makers.items():
        declared = {fault for fault, files in found_by().items() if file in files}
        told = {node.attr for call in calls for node in ast.walk(call) if is_fault(node)} - {"AGREEMENT"}
        assert declared, f"{file} makes checks and has no REPORTS_FAULTS"
        assert told <= {fault.name for fault in declared}, f"REPORTS_FAULTS of {file} leaves some out"


def is_fault(node: ast.AST) -> bool:
    return isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "Fault"


def test_the_page_shows_every_transition_in_the_order_in_which_they_are_tried() -> None:
    told = [
        (state, event, *step.split(" → "))
        for states, event, when in rows_of("Transitions")
        for state in states.split(", ")
        for step in when.split("; ")
    ]
    assert [(state, event, to.strip("*")) for state, event, _, to in sorted(told, key=lambda row: row[:2])] == sorted(
        (
            (state.value.value, one.event, one.target.value.value)
            for state in AlarmTable.states
            for one in state.transitions
        ),
        key=lambda row: row[:2],
    )


def test_the_page_on_the_control_socket_lists_every_request_and_every_field_of_the_status() -> None:
    text = (DOCS / "control.md").read_text(encoding="utf-8")
    requests, status = text.split("## Status")
    actions = ServiceActions(**{one.name: None for one in fields(ServiceActions)})  # type: ignore[arg-type]
    assert set(re.findall(r"^\| `([a-z-]+)` \|", requests, re.M)) == set(Requests(actions).names)
    alarm = AlarmState(State.MONITORING, 0, None, "", True, None)
    known = alarm_fields(0, alarm, "en").keys() | check_lists(0, None, ()).keys()
    assert known <= set(re.findall(r"^\| `([a-z_]+)` \|", status, re.M))
