"""Writes the structured log in a thread of its own, so that it never delays a tick: a JSON object a line on stderr, or
an entry in systemd's journal.
"""

import json
import queue
import sys
import threading
from typing import Any, Protocol, TextIO

import structlog

from probewatch.appliance.service.host.journal import journal_stream
from probewatch.drivers.closable import Closable
from probewatch.drivers.printable import printable_lines, printable_value

_LEVELS = {"debug": 10, "info": 20, "warning": 30, "error": 40}
"""Levels of Python's logging, which structlog filters by."""
_LONGEST_QUEUE = 2000
"""Lines that may wait for a slow reader of stderr. More takes memory, fewer drop lines when busy. Not measured."""


class LogStream(Protocol):
    """Describes where lines go: a text stream, or the journal."""

    def write(self, line: str, /) -> object: ...
    def flush(self) -> None: ...


class LogWriter(Closable):
    """Queues lines, up to a limit, and writes them in a thread. When the reader of stderr is slow, the newest line is
    dropped and counted.

    After lines were dropped, the next line that can be written reports their number.
    """

    def __init__(self, stream: LogStream) -> None:
        self._stream = stream
        self._lines: queue.Queue[str | None] = queue.Queue(_LONGEST_QUEUE)
        self.dropped = self._reported_dropped = 0
        self._thread = threading.Thread(target=self._write, name="log", daemon=True)
        self._thread.start()

    def msg(self, line: str) -> None:
        try:
            self._lines.put_nowait(line)
        except queue.Full:
            self.dropped += 1

    log = debug = info = warn = warning = error = critical = exception = fatal = msg

    def close(self, timeout_s: float = 1.0) -> None:
        """Writes what is queued, for at most timeout_s."""
        try:
            self._lines.put(None, timeout=timeout_s)
        except queue.Full:
            return
        self._thread.join(timeout_s)

    def _write(self) -> None:
        while (line := self._lines.get()) is not None:
            try:
                self._stream.write(line + "\n")
                self._report_dropped()
                self._stream.flush()
            except (OSError, ValueError):
                self.dropped += 1

    def _report_dropped(self) -> None:
        dropped = self.dropped - self._reported_dropped
        if dropped:
            said = {"event": "log lines dropped", "level": "warning", "lines": dropped}
            self._stream.write(json.dumps(said) + "\n")
            self._reported_dropped += dropped


def configure(level: str, stream: TextIO | None = None) -> LogWriter:
    """Sets up structlog for the whole process. level: debug, info, warning or error."""
    writer = LogWriter(stream or journal_stream() or sys.stderr)
    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.format_exc_info,
            _printable,
            structlog.processors.JSONRenderer(ensure_ascii=False),
        ],
        wrapper_class=structlog.make_filtering_bound_logger(_LEVELS[level]),
        logger_factory=lambda *_: writer,
        cache_logger_on_first_use=False,
    )
    return writer


def _printable(_logger: object, _method: str, fields: structlog.typing.EventDict) -> structlog.typing.EventDict:
    """Makes printable what came from outside by an unforeseen way; only a traceback may have several lines."""
    traceback = fields.pop("exception", None)
    shown: structlog.typing.EventDict = printable_value(fields)
    return shown if traceback is None else {**shown, "exception": printable_lines(traceback)}


def get_log(**bound: Any) -> structlog.typing.FilteringBoundLogger:
    """Returns a logger with these fields bound."""
    log: structlog.typing.FilteringBoundLogger = structlog.get_logger(**bound)
    return log
