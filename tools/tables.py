"""Tables that fit: in columns where the terminal is wide enough, else each row as a short list."""

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from tools.plain_text import shown

_GAP = 2
_INDENT = 2
NOTHING = "–"


class FittingTable:
    """rows: as many cells as headings; the first one names the row. styles: one for each row, "" for none."""

    def __init__(self, headings: Sequence[str], rows: Sequence[Sequence[str]], styles: Sequence[str] = ()) -> None:
        self._headings = [shown(heading) for heading in headings]
        self._rows = [[shown(cell) for cell in row] for row in rows]
        self._styles = [*styles, *("" for _ in rows[len(styles) :])]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        columns = zip(self._headings, *self._rows, strict=True)
        width = sum(max(map(cell_len, column)) + _GAP for column in columns)
        yield from [self._table()] if width <= options.max_width else self._lists()

    def _table(self) -> Table:
        table = Table(*self._headings, box=SIMPLE_HEAD, pad_edge=False)
        for row, style in zip(self._rows, self._styles, strict=True):
            table.add_row(*map(Text, row), style=style)
        return table

    def _lists(self) -> RenderResult:
        for (name, *cells), style in zip(self._rows, self._styles, strict=True):
            yield Text(name, style=style or "bold", overflow="fold")
            said = zip(self._headings[1:], cells, strict=True)
            lines = [f"{heading}: {cell}" for heading, cell in said if cell not in ("", shown(NOTHING))]
            yield Padding(Text("\n".join(lines), overflow="fold"), (0, 0, 0, _INDENT))
