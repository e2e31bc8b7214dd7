"""Protects the terminal from control characters in texts of devices, files and services, and shows progress."""

import sys
from typing import TYPE_CHECKING, Any, TextIO, cast

from probewatch.drivers.printable import printable_screen

if TYPE_CHECKING:
    from rich.progress import Progress


class _Terminal:
    """Represents a text stream that makes its text printable before it passes it on."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str, /) -> int:
        self._stream.write(printable_screen(text, self._stream.isatty()))
        return len(text)

    def writelines(self, lines: list[str], /) -> None:
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def guard_terminal() -> None:
    """Makes standard output and error of this process pass on no control characters but line breaks and, on a terminal,
    those that set colours and redraw.
    """
    sys.stdout, sys.stderr = (cast(TextIO, _Terminal(stream)) for stream in (sys.stdout, sys.stderr))


def progress_bar(text: str) -> "Progress":
    """Returns a progress bar on stderr, which is shown only where that is a terminal."""
    # Every command loads this module, and few need the 40 ms that rich takes to load.
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415

    console = Console(stderr=True)
    columns = TextColumn(text), BarColumn(), TimeRemainingColumn()
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
