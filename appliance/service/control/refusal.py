"""Records why no service answers: the service leaves the reason beside its control socket, for those who may use that
socket.

The journal holds the same, but only administrators and the group systemd-journal may read it.
"""

import contextlib
import json
import os
import tomllib
from datetime import UTC, datetime
from pathlib import Path

from probewatch.appliance.configuration.config import Control
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.atomic_file import replacing

_SUFFIX = ".refusal"
_MOST_BYTES = 16_000
"""Bytes. A refusal is a few lines; a larger file was not written by the service, and is truncated."""


def leave(config_file: Path, error: ConfigurationError) -> None:
    """Writes the error for the clients that ask. When that fails, only the log has it."""
    utc = datetime.now(UTC).isoformat(timespec="seconds")
    said = {"utc": utc, "what": error.what, "where": error.where, "remedy": error.remedy}
    with contextlib.suppress(OSError), replacing(_place(_socket_of(config_file))) as stream:
        os.fchmod(stream.fileno(), 0o640)
        stream.write(json.dumps(said).encode())


def withdraw(socket: Path) -> None:
    """Removes the refusal, because a service runs here."""
    with contextlib.suppress(OSError):
        _place(socket).unlink()


def why_silent(socket: Path) -> ConfigurationError | None:
    """Returns the error that the last service that could not monitor left beside this socket; None without one."""
    try:
        with _place(socket).open("rb") as stream:
            said = json.loads(stream.read(_MOST_BYTES))
        utc, what, where, remedy = (str(said[name]) for name in ("utc", "what", "where", "remedy"))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return ConfigurationError(f"the service does not watch, since {utc}: {what}", where, remedy)


def _socket_of(config_file: Path) -> Path:
    """Returns the path at which people will ask: [control] socket, if the file can be read; else the usual one."""
    try:
        return Path(str(tomllib.loads(config_file.read_text(encoding="utf-8"))["control"]["socket"]))
    except (OSError, ValueError, RecursionError, KeyError, TypeError):
        return Control().socket


def _place(socket: Path) -> Path:
    return socket.with_name(socket.name + _SUFFIX)
