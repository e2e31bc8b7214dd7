"""Prints tables that fit. In a terminal they have columns, with less space or with cells of several lines where it is
narrow; in a pipe they are lines with tabs, for cut and grep. It also determines which columns of any table are figures.
"""

import re
from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions, RenderResult
from rich.padding import Padding
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from probewatch.tools.shared.plain_text import shown

_ENDLESS = 10_000
"""Columns, more than any table has, to measure the natural width of one."""
_INDENT = 2
"""Columns by which the rest of a row is indented where the terminal is too narrow for a table."""
_LEAST_WORDS = 12
"""Columns that a cell with words needs, or else they would be torn apart: below that each row becomes a short list."""
NOTHING = "–"
_FIGURE = re.compile(r"[-+−<>±]?\s?\d+(\.\d+)?(e[-+]?\d+)?(?![\w.-])")
"""Matches the beginning of a figure, before its unit, but no date, version, SHA-256 or name of a file."""
_INSTEAD = re.compile(r"[^\W\d]*|–")
"""Matches what stands in place of a figure: a dash or one word, such as never."""


def figures_in(rows: Sequence[Sequence[str]]) -> tuple[bool, ...]:
    """Returns for each column whether its cells are figures; an empty tuple where there are no rows. A mark before a
    cell, ! or +, as pages have it, does not count.
    """
    return tuple(map(_are_figures, zip(*rows, strict=True)))


def _are_figures(cells: Sequence[str]) -> bool:
    bare = [cell.lstrip("!").strip() for cell in cells]
    figures = [_FIGURE.match(cell) is not None for cell in bare]
    return any(figures) and all(figure or _INSTEAD.fullmatch(cell) for figure, cell in zip(figures, bare, strict=True))


class FittingTable:
    """Represents a table that adapts to where it is printed. Print it with crop=False, or lines in a pipe are cut off.

    rows: as many cells as headings; the first one names the row. styles: one for each row, "" for none. right_from:
    number of the first column of figures, aligned on the right. tight: one space between columns.
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
        if not console.is_terminal:
            yield from self._lines()
            return
        for tight in (self._tight, True):
            table = self._table(tight)
            if self._width(console, options, table) <= options.max_width:
                yield table
                return
        table = self._table(True, folded=True)
        fits = self._least_width(console, options) <= options.max_width
        yield from [table] if fits else self._lists()

    @staticmethod
    def _width(console: Console, options: ConsoleOptions, table: Table) -> int:
        return console.measure(table, options=options.update(max_width=_ENDLESS)).maximum

    def _least_width(self, console: Console, options: ConsoleOptions) -> int:
        """Returns the width that the table would have if every cell with words were folded to the least width."""
        cut = [
            [cell if self._is_figure(number) else cell[:_LEAST_WORDS] for number, cell in enumerate(row)]
            for row in self._rows
        ]
        least = FittingTable(self._headings, cut, (), self._right_from, tight=True)
        return self._width(console, options, least._table(True))

    def _is_figure(self, number: int) -> bool:
        return number >= self._right_from

    def _table(self, tight: bool, folded: bool = False) -> Table:
        table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0 if tight else (0, 1))
        for number, heading in enumerate(self._headings):
            figure = self._is_figure(number)
            table.add_column(
                heading, justify="right" if figure else "left", no_wrap=not folded or figure, overflow="fold"
            )
        for row, style in zip(self._rows, self._styles, strict=True):
            table.add_row(*map(Text, row), style=style)
        return table

    def _lines(self) -> RenderResult:
        for cells in (self._headings, *self._rows):
            yield Segment("\t".join(" ".join(cell.split()) for cell in cells))
            yield Segment.line()

    def _lists(self) -> RenderResult:
        for (name, *cells), style in zip(self._rows, self._styles, strict=True):
            yield Text(name, style=style or "bold", overflow="fold")
            said = zip(self._headings[1:], cells, strict=True)
            lines = [f"{heading}: {cell}" for heading, cell in said if cell not in ("", shown(NOTHING))]
            yield Padding(Text("\n".join(lines), overflow="fold"), (0, 0, 0, _INDENT))
