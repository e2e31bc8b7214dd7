"""Somebody at a terminal: a command on a real pseudo-terminal, what it shows as plain text, and what is typed."""

import codecs
import contextlib
import fcntl
import os
import re
import struct
import subprocess
import termios
import threading
from pathlib import Path
from types import TracebackType
from typing import Self

from tests.support.demo_cart import PROBEWATCH
from tests.support.polling import until

_ROWS, _COLUMNS = 50, 160
_ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


class Person:
    """Runs `probewatch` with these arguments; leaving the context ends it. process: of it."""

    def __init__(self, *arguments: str | Path) -> None:
        self._command = [str(PROBEWATCH), *map(str, arguments)]
        self._shown = ""
        self._seen = 0

    def __enter__(self) -> Self:
        self._ours, theirs = os.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", _ROWS, _COLUMNS, 0, 0))
        terminal = os.environ | {"TERM": "xterm", "COLUMNS": str(_COLUMNS), "LINES": str(_ROWS)}
        self.process = subprocess.Popen(
            ["setsid", "--ctty", *self._command], stdin=theirs, stdout=theirs, stderr=theirs, env=terminal
        )
        os.close(theirs)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self._reader.join(5)
        os.close(self._ours)

    def _read(self) -> None:
        decoder = codecs.getincrementaldecoder("utf-8")("replace")
        with contextlib.suppress(OSError):  # of a terminal whose other side is closed
            while data := os.read(self._ours, 65536):
                self._shown += decoder.decode(data)

    @property
    def text(self) -> str:
        """Everything shown, without colours and redraws."""
        return _ESCAPES.sub("", self._shown).replace("\r\n", "\n")

    def sees(self, words: str, within_s: float = 60.0) -> str:
        """Waits for these words behind those that were waited for last; what was shown from there on."""

        def look() -> str:
            ended = not self._reader.is_alive()
            text = self.text
            found = text.find(words, self._seen)
            assert found >= 0 or not ended, f"it ended without '{words}': {text[self._seen :]}"
            return text[self._seen : found + len(words)] if found >= 0 else ""

        text = until(look, within_s, 0.05, lambda: self.text[-3000:])
        self._seen += len(text)
        return text

    def types(self, line: str) -> None:
        """And Enter."""
        os.write(self._ours, f"{line}\n".encode())

    def interrupts(self) -> None:
        """Ctrl-C."""
        os.write(self._ours, b"\x03")

    def ends(self, within_s: float = 60.0) -> int:
        """Its exit code, once everything has been shown."""
        code = self.process.wait(within_s)
        self._reader.join(5)
        return code
