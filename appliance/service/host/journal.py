"""Writes the log to the systemd journal: every field of a log line becomes a field of the journal entry.

Protocol: systemd's "Native Journal Protocol": one datagram an entry, NAME=value lines, or NAME, newline, length as u64
little-endian, value, newline. This allows searches such as `journalctl -u probewatch PROBEWATCH_STATE=halt`.
"""

import json
import os
import re
import socket
import sys
from typing import Any, TextIO

_SOCKET = "/run/systemd/journal/socket"
_PRIORITIES = {"debug": 7, "info": 6, "warning": 4, "error": 3, "critical": 2}
"""Severities of syslog(3), which the journal's PRIORITY uses."""
_SHOWN_ELSEWHERE = ("event", "level", "timestamp")


class JournalStream:
    """Takes the JSON lines of the log. Lines that the journal does not take go unchanged to the other stream."""

    def __init__(self, address: str, otherwise: TextIO) -> None:
        self._otherwise = otherwise
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.connect(address)

    def write(self, line: str) -> None:
        """Writes one line of the log."""
        try:
            self._socket.send(journal_entry(json.loads(line)))
        except (OSError, ValueError):
            self._otherwise.write(line)

    def close(self) -> None:
        """Closes the socket; the other stream stays open."""
        self._socket.close()

    def flush(self) -> None:
        """Flushes the other stream; entries of the journal are not held back."""
        self._otherwise.flush()


def journal_entry(fields: dict[str, Any]) -> bytes:
    """Returns a log line as one datagram. MESSAGE is for a person: the event and its fields in words."""
    shown = {name: _text(value) for name, value in fields.items() if name not in _SHOWN_ELSEWHERE}
    words = [str(fields.get("event", "")), *(f"{name}={value}" for name, value in shown.items())]
    entry = {
        "MESSAGE": " ".join(words),
        "PRIORITY": str(_PRIORITIES.get(str(fields.get("level")), 6)),
        "SYSLOG_IDENTIFIER": "probewatch",
        "PROBEWATCH_EVENT": str(fields.get("event", "")),
    }
    entry |= {f"PROBEWATCH_{re.sub('[^A-Z0-9]', '_', name.upper())}": value for name, value in shown.items()}
    return b"".join(_field(name, value.encode(errors="replace")) for name, value in entry.items())


def journal_stream(address: str = _SOCKET) -> JournalStream | None:
    """Returns the journal where this process's stderr is connected to it, else None."""
    try:
        state = os.fstat(sys.stderr.fileno())
        if os.environ.get("JOURNAL_STREAM") == f"{state.st_dev}:{state.st_ino}":
            return JournalStream(address, sys.stderr)
    except (OSError, ValueError):
        return None
    return None


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _field(name: str, value: bytes) -> bytes:
    if b"\n" not in value:
        return name.encode() + b"=" + value + b"\n"
    return name.encode() + b"\n" + len(value).to_bytes(8, "little") + value + b"\n"
