"""Prints the items of a self-test for a person: lines with tabs into a pipe, a table on a terminal."""

from collections.abc import Sequence

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from probewatch.tools.german.translation import recognised, told
from probewatch.tools.selftest.items import Item

_MARKS = {True: ("✓", "green"), False: ("✗", "red"), None: ("?", "red")}


def print_items(found: Sequence[Item], console: Console, language: str) -> None:
    """Prints each item, and how many are not green."""
    table = Table.grid(padding=(0, 2))
    for item in found:
        mark, colour = _MARKS[item.green]
        named = item.name.partition(" ")[0] if ":" in item.name else item.name  # a lost device's, before its URL
        name, what, remedy = (recognised(text, language) for text in (named, item.what, item.remedy))
        said = f"{what}{'. ' if remedy else ''}{remedy}"  # with brackets, as [calibration] due_days
        if console.is_terminal:
            table.add_row(Text(f"{mark} {name}", style=colour), Text(said, style="" if item.green else colour))
        else:
            click.echo(f"{mark}\t{name}\t{said}")
    if console.is_terminal:
        console.print(table)
    bad = sum(not item.green for item in found)
    text = "1 of {number} is not green." if bad == 1 else "{bad} of {number} are not green."
    some = told(text, language, bad=bad, number=len(found))
    console.print(Text(some, style="red") if bad else Text(told("All green.", language), style="green"))
