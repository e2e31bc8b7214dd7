"""Whose limits are in force: whoever shows limits names the same profile, and what is not as it has it."""

import io
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from probewatch.appliance.core.quality.report import LineReport, report_json
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Verdict, VerdictKind
from probewatch.tools.openigtlink.wording import fields_of as openigtlink_fields
from probewatch.tools.page.room import room
from probewatch.tools.report.recording_page import write_recording_page
from probewatch.tools.report.trace import Trace
from probewatch.tools.shared.replay_outcome import Outcome, print_outcome
from probewatch.tools.shared.status_view import StatusView, one_line
from probewatch.tools.shared.status_watch import Seen
from probewatch.tools.shared.subject import Subject
from tests.support.answering import recorded

LIMITS = Limits(profile="fine", offset_mm=10.0)
FIELDS = {"profile": "fine", "beside": {"offset_mm": 10.0}}
SAID = "limits: fine, but for offset_mm 10"
REPORT = LineReport(1, 1, 1, {}, None, None, 0, (), Verdict(0, VerdictKind.OK, ()), limits=LIMITS)
SUBJECT = Subject(((Path("x.mha"), "ab" * 32),), None, None, (), "probewatch 0", "2026-01-01T00:00:00+00:00")


def terminal(status: dict[str, Any]) -> str:
    stream = io.StringIO()
    Console(file=stream, width=200, highlight=False).print(StatusView().picture(status))
    return stream.getvalue()


def test_whoever_shows_limits_names_their_profile(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status = recorded(limits=FIELDS)
    assert SAID in terminal(status)
    assert SAID in one_line(status)
    assert room(status)["limits"] == SAID
    assert room({**status, "language": "de"})["limits"] == "Grenzen: fine, außer offset_mm 10"
    assert openigtlink_fields(Seen(status, 0))["limits"] == FIELDS
    assert report_json(REPORT, [])["limits"] == FIELDS
    print_outcome(Outcome(Path("x.mha"), REPORT, []), SUBJECT)
    assert SAID in capsys.readouterr().out
    write_recording_page(tmp_path / "x.html", SUBJECT, "x.mha", Trace(), REPORT, [], None, "")
    assert SAID in (tmp_path / "x.html").read_text(encoding="utf-8")


def test_those_that_are_shipped_need_no_line_of_a_terminal() -> None:
    shipped, older = recorded(limits={"profile": "coarse", "beside": {}}), recorded()
    del older["limits"]
    for status in (shipped, older):
        assert "limits:" not in terminal(status)
        assert "limits:" not in one_line(status)
    assert room(shipped)["limits"] == "limits: coarse"
    assert room(older)["limits"] == ""
