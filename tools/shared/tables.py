"""Tables that fit: in columns where the terminal is wide enough, else each row as a short list."""

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions, RenderResult
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from tools.shared.plain_text import shown

_ENDLESS = 10_000
"""Columns that no table reaches, to measure how wide one wants to be."""
_INDENT = 2
"""Columns by which the rest of a row is set in where the terminal is too narrow for a table."""
NOTHING = "–"


class FittingTable:
    """rows: as many cells as headings; the first one names the row. styles: one for each row, "" for none.

    right_from: number of the first column of figures, aligned on the right; tight: one space between columns.
    """

    def __init__(
        self,
        headings: Sequence[str],
        rows: Sequence[Sequence[str]],
        styles: Sequence[str] = (),
        right_from: int | None = None,
        tight: bool = False,
    ) -> None:
        self._right_from, self._tight = len(headings) if right_from is None else right_from, tight
        self._headings = [shown(heading) for heading in headings]
        self._rows = [[shown(cell) for cell in row] for row in rows]
        self._styles = [*styles, *("" for _ in rows[len(styles) :])]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        table = self._table()
        width = console.measure(table, options=options.update(max_width=_ENDLESS)).maximum
        yield from [table] if width <= options.max_width else self._lists()

    def _table(self) -> Table:
        table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0 if self._tight else (0, 1))
        for number, heading in enumerate(self._headings):
            table.add_column(heading, justify="right" if number >= self._right_from else "left")
        for row, style in zip(self._rows, self._styles, strict=True):
            table.add_row(*map(Text, row), style=style)
        return table

    def _lists(self) -> RenderResult:
        for (name, *cells), style in zip(self._rows, self._styles, strict=True):
            yield Text(name, style=style or "bold", overflow="fold")
            said = zip(self._headings[1:], cells, strict=True)
            lines = [f"{heading}: {cell}" for heading, cell in said if cell not in ("", shown(NOTHING))]
            yield Padding(Text("\n".join(lines), overflow="fold"), (0, 0, 0, _INDENT))
