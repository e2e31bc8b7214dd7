"""Terminals as pictures for docs/, drawn into the folder that PROBEWATCH_SCREENSHOTS names, where it is set."""

import io
import os
import re
from pathlib import Path

from rich.console import CONSOLE_SVG_FORMAT, Console
from rich.text import Text

from tests.support.demo_cart import PROBEWATCH

_FONTS = re.compile(r"@font-face \{\{.*?\}\}\n", re.DOTALL)
"""Of rich's pictures: they would load them from elsewhere."""


def draws() -> bool:
    """Whether anybody wants pictures."""
    return bool(os.environ.get("PROBEWATCH_SCREENSHOTS"))


def draw_terminal(name: str, title: str, shown: str, columns: int = 110) -> None:
    """The text of a terminal as an SVG; places of this computer are shortened to what a cart has."""
    if not draws():
        return
    console = Console(record=True, width=columns, file=io.StringIO())
    text = Text(shown.replace(str(PROBEWATCH), "probewatch").strip("\n"))
    for pattern, style in ((r"(?m)^ *✓ \S.*?(?=  )|^  \+.*|All green\.", "green"), (r"(?m)^ *[✗?!] .*|^  -.*", "red")):
        text.highlight_regex(pattern, style)
    console.print(text)
    picture = console.export_svg(title=title, code_format=_FONTS.sub("", CONSOLE_SVG_FORMAT), unique_id=name)
    picture = "\n".join(line.rstrip() for line in picture.splitlines()) + "\n"
    Path(os.environ["PROBEWATCH_SCREENSHOTS"], f"{name}.svg").write_text(picture, encoding="utf-8")
