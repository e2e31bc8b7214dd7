"""What was not looked up is never told to be well."""

import json
from pathlib import Path

import pytest

from probewatch.tools.development.vulnerabilities import FOUND, NOT_CHECKED, judged, main

ROOT = Path(__file__).parents[3]
WELL = {"name": "numpy", "version": "2.0", "vulns": []}
BAD = {"name": "paho", "version": "1.0", "vulns": [{"id": "CVE-1", "fix_versions": ["1.1"]}]}
SKIPPED = {"name": "rich", "skip_reason": "no answer"}


@pytest.mark.parametrize(
    ("parts", "locked", "code"),
    [
        ([WELL, WELL], 2, 0),
        ([WELL, BAD], 2, FOUND),
        ([WELL, SKIPPED], 2, NOT_CHECKED),
        ([BAD, SKIPPED], 2, NOT_CHECKED),
        ([WELL], 2, NOT_CHECKED),
        ([], 0, 0),
        ([], 30, NOT_CHECKED),
    ],
)
def test_a_report(parts: list[dict[str, object]], locked: int, code: int, capsys: pytest.CaptureFixture[str]) -> None:
    assert judged(json.dumps({"dependencies": parts}), locked) == code
    said = capsys.readouterr()
    assert ("NOT CHECKED" in said.err) == (code == NOT_CHECKED)
    assert ("CVE-1, fixed in 1.1" in said.out) == (BAD in parts)


@pytest.mark.parametrize("report", ["", "{}", "[]", '{"dependencies": 3}', '{"dependencies": [3]}'])
def test_what_is_no_report_is_no_verdict(report: str) -> None:
    assert judged(report, 0) == NOT_CHECKED


@pytest.mark.parametrize("script", ["exit 0", "exit 1", "echo no database >&2; exit 0"])
def test_a_program_that_ends_well_without_a_report_has_checked_nothing(
    script: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "pip-audit"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    assert main(str(program), ROOT / "requirements.lock") == NOT_CHECKED
    assert "NOT CHECKED" in capsys.readouterr().err


def test_without_the_program_nothing_is_checked(capsys: pytest.CaptureFixture[str]) -> None:
    assert main("/nowhere/pip-audit", ROOT / "requirements.lock") == NOT_CHECKED
    assert "NOT CHECKED" in capsys.readouterr().err
