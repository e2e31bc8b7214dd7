"""What a live scan says where nothing is redrawn, as into the log of a script: it said nothing until its end."""

import io

import pytest
from rich.console import Console

from tools.recalibration.terminal import _Lines, progress_text

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
    clock_s = [0.0]
    monkeypatch.setattr("tools.recalibration.terminal.time.monotonic", lambda: clock_s[0])
    lines, screen = _Lines(Console(file=io.StringIO())), _Lines(Console(file=io.StringIO(), force_terminal=True))
    for clock_s[0], text in ((0.0, "a"), (1.0, "b"), (11.0, "b"), (30.0, "b"), (31.0, "c")):
        lines.tell(text)
        screen.tell("redrawn")
    assert capsys.readouterr().out == "a\nb\nc\n"
