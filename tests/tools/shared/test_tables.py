"""A table is in columns where there is room, else each row is a list, and nothing is lost."""

import io

import pytest
from rich.cells import cell_len
from rich.console import Console

from appliance.core.quality.examination import examine_nothing
from appliance.core.quality.judgement import judge
from appliance.core.quality.report import LineReport
from appliance.core.quality.verification import Standing
from appliance.limits import Limits
from appliance.types import Check, Fault, VerdictKind
from tools.commands.replay import _table

DOUBTFUL = Check("offset-elevational", Fault.OFFSET, -28.4, 1.5, "mm", 4.0, VerdictKind.NOT_VERIFIED)


@pytest.mark.parametrize("columns", [38, 80])
def test_the_report_of_a_replay_fits(columns: int) -> None:
    checks = (DOUBTFUL, *examine_nothing(Limits()).checks)
    report = LineReport(1, 1, 1, {}, None, None, 0, checks, judge(0, checks, Standing(())))
    stream = io.StringIO()
    Console(file=stream, width=columns).print(_table(report))
    lines = stream.getvalue().splitlines()
    assert all(cell_len(line) <= columns for line in lines)
    assert "…" not in stream.getvalue()
    said = " ".join(stream.getvalue().split())
    for check in checks:
        assert check.name in said
    for part in ("-28.4 mm", "1.5", "4 mm", "7.1", "NOT_VERIFIED"):
        assert part in said
    assert ("of limit: 7.1" in said) == (columns == 38)
