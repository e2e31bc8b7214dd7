"""A command of probewatch in this process: what it answers, for tests that are not about the process itself."""

import io
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from unittest.mock import patch

from probewatch.tools.cli import main


@dataclass(frozen=True, slots=True)
class Answer:
    returncode: int
    stdout: str
    stderr: str


def answered(*words: object) -> Answer:
    """What the console script would print and exit with."""
    out, errors = (io.TextIOWrapper(io.BytesIO(), "utf-8", newline="", write_through=True) for _ in range(2))
    with patch.object(sys, "argv", ["probewatch", *map(str, words)]), redirect_stdout(out), redirect_stderr(errors):
        try:
            main()
        except SystemExit as end:
            return Answer(int(end.code or 0), *(stream.buffer.getvalue().decode() for stream in (out, errors)))
    raise AssertionError("main() ends with an exit code")
