"""Writes docs/pictures/self-test.svg: `python -m probewatch.tools.development.self_test_picture RECORD`.

RECORD is what a self-test of this version has kept, such as of `probewatch simulate cart` on a busy computer; the
picture is what that self-test printed, on a terminal of 110 columns.
"""

import io
import json
import re
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from probewatch.tools.selftest.items import Item
from probewatch.tools.selftest.listed import print_items

PICTURE = Path(__file__).parents[2] / "docs" / "pictures" / "self-test.svg"
_COLUMNS = 110
"""Columns of the drawn terminal. Fewer wrap the longest item, more leave an empty margin."""


def picture(record: dict[str, Any]) -> str:
    """Returns the SVG of the items of a record."""
    console = Console(record=True, width=_COLUMNS, file=io.StringIO(), force_terminal=True, highlight=False)
    print_items([Item(**item) for item in record["items"]], console, "en")
    drawn = console.export_svg(title="probewatch self-test", unique_id="self-test")
    return re.sub(r" *@font-face \{[^}]*\}\n?", "", drawn)  # a page would load these fonts from elsewhere


@click.command()
@click.argument("record", type=click.Path(exists=True, dir_okay=False, path_type=Path))
def main(record: Path) -> None:
    """Writes the picture of RECORD."""
    PICTURE.write_text(picture(json.loads(record.read_text(encoding="utf-8"))), encoding="utf-8")
    click.echo(f"written: {PICTURE}")


if __name__ == "__main__":
    main()
