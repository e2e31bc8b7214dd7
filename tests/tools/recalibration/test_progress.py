"""A live scan without a terminal prints its progress in lines; it printed nothing until its end."""

import io

import pytest
from rich.console import Console

from probewatch.tools.recalibration.terminal import _Lines, progress_text

SCAN = {"views": [{}, {}], "pictures": 60, "refusals": [{"reason": "too few views", "what": "2 of 20"}]}


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"trouble": "", "scan": None}, "waiting for the first picture"),
        ({"trouble": "the pictures are lost", "scan": SCAN}, "the pictures are lost"),
        ({"trouble": "", "scan": SCAN}, "2 views in 60 pictures · too few views: 2 of 20"),
        ({"trouble": "", "scan": {**SCAN, "refusals": []}}, "2 views in 60 pictures · the scan is complete"),
    ],
)
def test_how_far_a_scan_is_stands_in_one_line(fields: dict[str, object], said: str) -> None:
    assert progress_text(fields) == said


def test_a_line_is_told_when_it_is_new_and_not_more_often_than_every_ten_seconds(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter((0.0, 1.0, 11.0, 30.0, 31.0))
    monkeypatch.setattr("probewatch.tools.recalibration.terminal.time.monotonic", lambda: next(clock))
    lines = _Lines(Console(file=io.StringIO()))
    for text in ("a", "b", "b", "b", "c"):
        lines.tell(text)
    assert capsys.readouterr().out == "a\nb\nc\n"


def test_a_terminal_that_is_redrawn_gets_no_lines(capsys: pytest.CaptureFixture[str]) -> None:
    _Lines(Console(file=io.StringIO(), force_terminal=True)).tell("redrawn")
    assert capsys.readouterr().out == ""
