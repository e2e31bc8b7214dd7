"""A table fits the terminal that it is written to, and is lines with tabs in a pipe."""

import io

import pytest
from rich.console import Console

from probewatch.tools.shared.tables import FittingTable, figures_in

HEADINGS = ("device", "what it is", "and what is wrong with it", "value", "limit")
ROWS = [
    ("/dev/video0", "a grabber of some maker", "it gives pictures of another size than before", "0.12", "5"),
    ("/dev/ttyUSB0", "a tracker", "–", "13.7", "60"),
]


def written(width: int, terminal: bool = True) -> list[str]:
    out = io.StringIO()
    Console(file=out, width=width, force_terminal=terminal, color_system=None, highlight=False).print(
        FittingTable(HEADINGS, ROWS, right_from=3), crop=False
    )
    return out.getvalue().rstrip("\n").split("\n")


@pytest.mark.parametrize("width", [40, 60, 80, 100, 120, 200])
def test_nothing_is_wider_than_the_terminal_and_nothing_is_lost(width: int) -> None:
    lines = written(width)
    assert max(map(len, lines)) <= width
    whole = "".join("".join(lines).split())
    for cell in ("0.12", "13.7", "grabber", "pictures", "size"):
        assert cell in whole


@pytest.mark.parametrize("width", [80, 100, 120])
def test_it_stays_a_table_where_that_can_be_read(width: int) -> None:
    heading = next(line for line in written(width) if line.strip())
    assert [name for name in ("device", "value", "limit") if name in heading] == ["device", "value", "limit"]


@pytest.mark.parametrize("width", [20, 80, 200])
def test_a_pipe_gets_a_line_for_each_row_with_tabs(width: int) -> None:
    assert written(width, terminal=False) == ["\t".join(HEADINGS), *("\t".join(row) for row in ROWS)]


@pytest.mark.parametrize(
    "cells", [("1.2 s", "never"), ("!3 of 20 (0 to 24 %)", "4"), ("+0.3 ± 0.1 mm", "–"), ("2e-05", "")]
)
def test_a_column_of_figures_is_known(cells: tuple[str, ...]) -> None:
    assert figures_in([("name", cell) for cell in cells]) == (False, True)


@pytest.mark.parametrize(
    "cells",
    [
        ("2026-01-02 08:00", "2026-01-03 08:00"),
        ("0.2.0", "0.3.1"),
        ("12ab34cd56ef…",),
        ("20260102.toml",),
        ("–", "never"),
        ("3 mm", "slid by 3 mm"),
    ],
)
def test_dates_versions_names_and_sentences_are_words(cells: tuple[str, ...]) -> None:
    assert figures_in([("name", cell) for cell in cells]) == (False, False)
