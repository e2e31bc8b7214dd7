"""Writes and reads byte logs: everything that crosses a line, with direction and time, as text for a person and for a
replay.

The first line of every connection is `# probewatch byte log 1 URL`. Each further line is one entry of three fields,
separated by one space: seconds of the host's CLOCK_MONOTONIC with six decimals; `>` host to device, `<` device to host,
or `!` for a remark; the bytes in hexadecimal, or the words of the remark. Entries are in the order of time.

A log is appended to. When FILE has reached half the limit, it becomes FILE.1 and a new FILE begins, so that the latest
bytes are always there and the disk is never filled.
"""

import os
import re
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TextIO

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.closable import Closable
from probewatch.drivers.errors import ConfigurationError, RecordingError
from probewatch.drivers.files.markup import SAVE_AS_UTF_8, NotUtf8Error, text_of
from probewatch.drivers.files.regular_file import open_regular, reading, refuse_irregular
from probewatch.drivers.printable import LONGEST_TEXT, printable

HEADING = "# probewatch byte log 1"
LIMIT_BYTES = 64 << 20
"""Size of both files of a log. A 60 Hz Polaris with one tool fills about 10 kB a second, so that the last 55 minutes
are always there, judged by the length of its lines; more takes more of the cart's disk.
"""

_ENTRY = re.compile(r"(\d+\.\d{6}) ([><!]) (.*)")


class Direction(Enum):
    """Enumerates the directions of an entry; NOTE is a remark of the driver, such as a change of the line speed."""

    SENT = ">"
    RECEIVED = "<"
    NOTE = "!"


@dataclass(frozen=True, slots=True)
class Entry:
    """Holds one entry of a log. t_ns: CLOCK_MONOTONIC directly after the bytes were read, or before they were written.
    data: the bytes; for a NOTE its words in UTF-8.
    """

    t_ns: int
    direction: Direction
    data: bytes


class ByteLog(Closable):
    """Writes one log. A disk that fails ends the log, never the tracking; `failed` is then true."""

    def __init__(self, path: Path, url: str, clock: HostClock, limit_bytes: int = LIMIT_BYTES) -> None:
        """Opens the log. Raises ConfigurationError when the file cannot be written."""
        self.failed = False
        self._path, self._clock, self._limit_bytes = path, clock, limit_bytes
        try:
            self._stream = self._opened()
            self._stream.write(f"{HEADING} {url}\n")
        except OSError as error:
            remedy = "Name a file in a folder that this user may write to"
            raise ConfigurationError(f"the byte log cannot be written ({error.strerror})", str(path), remedy) from None

    def sent(self, data: bytes) -> None:
        """Records bytes that are about to be written."""
        self._note(Direction.SENT, data.hex())

    def received(self, data: bytes) -> None:
        """Records bytes that have just been read."""
        self._note(Direction.RECEIVED, data.hex())

    def remark(self, words: str) -> None:
        """Records what happened to the line itself, as one line of text."""
        self._note(Direction.NOTE, printable(words.replace("\n", " "), LONGEST_TEXT))

    def close(self) -> None:
        """Ends the log; calling it again does nothing."""
        self._stream.close()

    def _note(self, direction: Direction, text: str) -> None:
        if self.failed:
            return
        try:
            self._stream.write(f"{self._clock.now_ns() / 1e9:.6f} {direction.value} {text}\n")
            if self._stream.tell() > self._limit_bytes // 2:
                self._turn_over()
        except OSError:
            self.failed = True

    def _turn_over(self) -> None:
        self._stream.close()
        older = self._path.with_name(f"{self._path.name}.1")
        refuse_irregular(older)
        self._path.replace(older)
        self._stream = self._opened()
        self._stream.write(f"{HEADING} continued\n")

    def _opened(self) -> TextIO:
        descriptor = open_regular(self._path, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        return os.fdopen(descriptor, "a", encoding="utf-8", buffering=1)


def read_log(path: Path) -> tuple[Entry, ...]:
    """Returns the entries of a log. Raises RecordingError that names a damaged line."""
    try:
        with reading(path) as stream:
            lines = text_of(stream.read()).splitlines()
    except OSError as error:
        raise RecordingError(f"the byte log cannot be read ({error})", str(path), "Check the path") from None
    except NotUtf8Error as error:
        raise RecordingError(str(error), str(path), SAVE_AS_UTF_8) from None
    if not lines or not lines[0].startswith(HEADING):
        raise RecordingError("this is not a byte log", str(path), f"Its first line must begin with '{HEADING}'")
    return tuple(_entry(path, number, line) for number, line in enumerate(lines, 1) if not line.startswith(HEADING))


def _entry(path: Path, number: int, line: str) -> Entry:
    match = _ENTRY.fullmatch(line)
    try:
        if match is None:
            raise ValueError("not seconds, direction and bytes")
        direction = Direction(match[2])
        data = match[3].encode() if direction is Direction.NOTE else bytes.fromhex(match[3])
    except ValueError as error:
        raise RecordingError(f"line {number} is damaged: {error}", str(path), "Cut the log off before it") from None
    return Entry(round(float(match[1]) * 1e9), direction, data)
