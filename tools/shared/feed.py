"""Reads the service's feed, and turns its messages back into what the line took in and reported."""

import contextlib
import math
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from probewatch.appliance.service.control.rights import join_group
from probewatch.appliance.service.feed.message import HEAD_BYTES, FeedMessage, Hello, Refused, lengths, unpacked
from probewatch.appliance.service.feed.request import FeedRequest
from probewatch.appliance.service.host.unix_socket import connected, received_by
from probewatch.drivers.closable import Closable
from probewatch.drivers.errors import DeviceLost, ProbewatchError

_ANSWER_S = 5.0
"""Seconds for the service to answer a new client: it may first have to start the process that distributes the feed,
which takes .3 s on an idle computer. Longer hides a service that hangs."""
_READ_BYTES = 1 << 16
"""Bytes read from the kernel at once; a picture of 640 × 480 takes five reads. Not measured."""

_Read = TypeVar("_Read")


class Feed(Closable):
    """Represents a connection to the feed, which is open from construction on; close it, or leave the context.

    path: that of the feed's socket. software: version of the service. Raises DeviceLost where nothing answers or the
    client is refused, ProtocolError where something other than the feed answers.
    """

    def __init__(self, path: Path, request: FeedRequest | None = None) -> None:
        self._path = path
        self._received = bytearray()
        try:
            self._link = connected(path, _ANSWER_S)
        except OSError as error:
            raise self._gone(error) from None
        try:
            self._link.sendall((request or FeedRequest()).line())
            first = self._one(time.monotonic() + _ANSWER_S)
        except (OSError, ProbewatchError) as error:
            self._link.close()
            raise self._gone(error) if isinstance(error, OSError) else error from None
        assert isinstance(first, Hello)
        self.software = first.software

    def close(self) -> None:
        """Closes the connection. `next` raises DeviceLost in a thread that is waiting there."""
        with contextlib.suppress(OSError):
            self._link.shutdown(socket.SHUT_RDWR)
        self._link.close()

    def fileno(self) -> int:
        """Returns the descriptor for poll."""
        return self._link.fileno()

    def __iter__(self) -> Iterator[FeedMessage]:
        """Yields messages until the service ends the feed, which raises DeviceLost."""
        while True:
            yield self.wait()

    def wait(self) -> FeedMessage:
        """Returns the next message, however long it takes. Raises DeviceLost, ProtocolError."""
        message = self.next(None)
        assert message is not None
        return message

    def next(self, timeout_s: float | None) -> FeedMessage | None:
        """Returns the next message, None where none was complete in time. Raises DeviceLost, ProtocolError."""
        return self._in_time(self._one, timeout_s)

    def next_raw(self, timeout_s: float | None) -> tuple[bytes, bytes] | None:
        """Returns (header, pixels) of the next message, as received, to be stored and decoded by `unpacked` later; None
        where none was complete in time. Raises DeviceLost, ProtocolError.
        """
        return self._in_time(self._whole, timeout_s)

    def _in_time(self, read: Callable[[float], _Read], timeout_s: float | None) -> _Read | None:
        try:
            return read(_end_s(timeout_s))
        except TimeoutError:
            return None
        except OSError as error:
            raise self._gone(error) from None

    def _one(self, end_s: float) -> FeedMessage:
        message = unpacked(*self._whole(end_s))
        if isinstance(message, Refused):
            raise DeviceLost(f"the feed is refused: {message.why}", str(self._path))
        return message

    def _whole(self, end_s: float) -> tuple[bytes, bytes]:
        """Receives a whole message, and returns its header and pixels. end_s: deadline by time.monotonic. Raises
        OSError; after a TimeoutError it may be called again.
        """
        self._need(HEAD_BYTES, end_s)
        header, pixels = lengths(bytes(self._received[:HEAD_BYTES]))
        end = HEAD_BYTES + header + pixels
        self._need(end, end_s)
        view = bytes(self._received[HEAD_BYTES:end])
        del self._received[:end]
        return view[:header], view[header:]

    def _need(self, size: int, end_s: float) -> None:
        while len(self._received) < size:
            data = received_by(self._link, max(_READ_BYTES, size - len(self._received)), end_s)
            if not data:
                raise ConnectionResetError(104, "the service ended it")
            self._received += data

    def _gone(self, error: OSError) -> DeviceLost:
        if isinstance(error, PermissionError):
            return DeviceLost("your user may not read the feed", str(self._path), join_group(self._path))
        what = f"no service offers its feed ({error.strerror or error})"
        return DeviceLost(
            what, str(self._path), "See `probewatch status`; [feed] of its configuration says where it is"
        )


def _end_s(timeout_s: float | None) -> float:
    return math.inf if timeout_s is None else time.monotonic() + timeout_s
