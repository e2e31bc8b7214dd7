"""The page tells how many slips were seen, all sessions together."""

import json
from pathlib import Path

import pytest

from probewatch.tools.development import slips


def figure(session: str, lasting_s: float, tried: int, named: int, doubted: int) -> dict[str, object]:
    told = {"session": session, "tissue": "still", "way": "bend", "size": 3.5, "lasting_s": lasting_s}
    return {**told, "tried": tried, "named": named, "misnamed": 1, "doubted": doubted}


def test_sessions_are_counted_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = [figure("hold", 0.0, 60, 58, 0), figure("gesture", 0.0, 60, 59, 0), figure("hold", 0.5, 18, 0, 6)]
    quiet = [
        {"session": name, "tissue": "still", "hours": 0.25, "faults": 1, "doubts": 2} for name in ("hold", "mixed")
    ]
    monkeypatch.setattr(slips, "FIGURES", tmp_path / "slips.json")
    assert slips.slip_page() == []
    slips.FIGURES.write_text(json.dumps({"seen": seen, "quiet": quiet}))
    page = "\n".join(slips.slip_page())
    assert "(hold, gesture; seed 1" in page
    (row,) = [line for line in page.splitlines() if line.startswith("| bend")]
    named, half, five = row.removesuffix(" |").split(" | ")[1:]
    assert named == "117/120 (93–99 %) named; 2/120 named otherwise"
    assert half == "1/18 named otherwise; 6/18 withdrawn"
    assert five == "–"
    assert "2 FAULTs and 4 withdrawals in 0.50 h" in page
