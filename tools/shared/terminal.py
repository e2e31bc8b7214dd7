"""Where commands speak: what a device, a file or a service says cannot take the terminal over."""

import sys
from typing import Any, TextIO, cast

from drivers.printable import printable_screen


class _Terminal:
    """A text stream that makes printable what goes through it; in everything else the one behind it."""

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
    """From now on standard output and error of this process pass on no controls but line breaks, and on a terminal
    what colours and redraws."""
    sys.stdout, sys.stderr = (cast(TextIO, _Terminal(stream)) for stream in (sys.stdout, sys.stderr))
