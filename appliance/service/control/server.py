"""Serves the control socket: JSON lines over a Unix socket, protocol version 1; docs/control.md lists the requests.

Request: {"v": 1, "do": NAME, …}. Reply: {"v": 1, "ok": true, …} or {"v": 1, "ok": false, "error": TEXT}.

The tick polls the server, which never blocks, takes at most one request of each client a tick, and drops a client that
sends too much or reads too slowly. Clients for which a tick has no time wait for the next one, the client that has
waited longest first.

A crowd of clients that connect and send nothing keeps no other client out: they take places only from each other, and
each client is read once it is accepted, before the next is. A client that has asked keeps its place until it has the
answer, and longer while no other client that asks needs the place, or a recalibration depends on it. A client that
sends the next request before it has the answer to the last is the first to leave after that. So each tick has eight
places or more for those that have waited longest, whatever the others ask, and a client that asks now and then keeps
its own. One descriptor is reserved for a person who asks what is wrong when all others have run out.
"""

import contextlib
import errno
import json
import os
import select
import socket
import struct
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from probewatch.appliance.service.control.starting import how_to_end
from probewatch.appliance.service.host.request_line import request_fields
from probewatch.appliance.service.host.unix_socket import NO_GROUP, listening, make_group
from probewatch.drivers.closable import Closable
from probewatch.drivers.errors import ConfigurationError, DeviceLost, ProbewatchError
from probewatch.drivers.files.lock import held_lock
from probewatch.drivers.printable import printable_value

VERSION = 1
_MOST_CLIENTS, _MOST_SILENT = 16, 16
"""Most clients at once: those that have asked, and those that have not. Each costs a descriptor and a few µs a tick."""

_LONGEST_LINE = 4096
"""Bytes of a request: a path may be as long. Each client may occupy as much of our memory without asking anything."""
_MOST_UNSENT = 1 << 18
"""Bytes that may wait for a client that does not read; beyond that it is dropped. More lets each client take as much
memory; less drops a client that reads late.
"""
_BACKLOG = 4096
"""Clients that the kernel queues, first come first served, until a tick has time for them. A client that finds no place
there competes with the crowd for the next one.
"""

_ACCEPTING_S, _ANSWERING_S = 0.01, 0.01
"""s, the longest time in a tick of 50 ms for accepting and for answering. Accepting a client that sends nothing takes
50 µs: 200 a tick, 4000 a second.
"""

Reply = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Peer:
    """Identifies the asking process as the kernel knows it. link: number of its connection; the server's first is 1."""

    pid: int
    uid: int
    link: int = 0


Answer = Callable[[str, dict[str, Any], Peer], Reply]
"""Takes (what to do, whole request, who asks) and returns the fields of the reply. Raises ControlRefused."""


class ControlRefused(ProbewatchError):  # noqa: N818  an answer, as the operator reads it
    """Signals that the service does not do what was asked."""

    exit_code = 75


@dataclass(slots=True, eq=False)
class _Client:
    """Represents a connected client. presses: the next request was there before the answer to the last one."""

    link: socket.socket
    who: Peer
    received: bytearray = field(default_factory=bytearray)
    unsent: bytearray = field(default_factory=bytearray)
    presses: bool = False

    @property
    def waits(self) -> bool:
        """Returns whether the client waits for an answer to a whole request."""
        return b"\n" in self.received


@dataclass(frozen=True, slots=True)
class Owner:
    """Describes who serves a socket, for the refusal where another one does. name: follows "another" in the refusal.
    remedy: how that one is ended. where: what gave the path; "" for the key of the configuration.
    """

    name: str
    remedy: str
    where: str = ""


class ControlServer(Closable):
    """Holds the socket at `path`, mode 0660, of `group` if one is named, and of `users`, by id. A lock beside it, which
    only its owner may open, keeps a second service out. owner: None for the service.

    Raises DeviceLost when another service runs, ConfigurationError when the socket cannot be made there.
    """

    def __init__(self, path: Path, group: str = "", users: Iterable[int] = (), owner: Owner | None = None) -> None:
        self._path, self._group, self._users = path, group, users
        self._owner = owner or Owner("probewatch service", f"Stop it first: {how_to_end(path)}")
        self._silent: dict[_Client, None] = {}
        self._clients: list[_Client] = []
        self._lock_fd = self._locked()
        self._listener = self._listen()
        self._spare: int | None = os.dup(self._lock_fd)
        self._links = 0
        self._kept: int | None = None
        self.dropped_clients = 0

    def close(self) -> None:
        """Drops all clients and removes the socket. See Closable."""
        for client in (*self._silent, *self._clients):
            self._drop(client)
        self._listener.close()
        if self._spare is not None:
            os.close(self._spare)
        self._path.unlink(missing_ok=True)
        os.close(self._lock_fd)

    def poll(self, answer: Answer, kept: int | None = None) -> None:
        """Serves the requests that are there now. kept: number of a connection that keeps its place."""
        self._kept = kept
        self._keep_spare()
        for client in tuple(self._silent):
            self._hear(client)
        end_s = time.monotonic() + _ACCEPTING_S
        while self._accept() and time.monotonic() < end_s:
            pass
        end_s = time.monotonic() + _ANSWERING_S
        for client in tuple(self._clients):
            self._serve(client, answer)
            if time.monotonic() >= end_s:
                return

    def is_open(self, link: int) -> bool:
        """Returns whether that connection was open at the last poll."""
        return any(client.who.link == link for client in (*self._clients, *self._silent))

    def _listen(self) -> socket.socket:
        try:
            return listening(self._path, self._group, _BACKLOG, self._users)
        except LookupError:
            where = self._owner.where or f"[control] group = '{self._group}'"
            raise ConfigurationError(NO_GROUP, where, make_group(self._group)) from None
        except OSError as error:
            raise self._unusable(error) from None

    def _locked(self) -> int:
        lock = self._path.with_name(self._path.name + ".lock")
        try:
            return held_lock(lock)
        except BlockingIOError:
            what, where = f"another {self._owner.name} is running here", self._owner.where or str(self._path)
            raise DeviceLost(what, where, self._owner.remedy) from None
        except OSError as error:
            raise self._unusable(error) from None

    def _unusable(self, error: OSError) -> ConfigurationError:
        where = self._owner.where or f"[control] socket = '{self._path}'"
        remedy = "Create its folder, or choose another path"
        return ConfigurationError(f"cannot be made ({error.strerror})", where, remedy)

    def _accept(self) -> bool:
        """Accepts the next client of the queue and reads what it has sent; False when there is none, or no place."""
        if self._full() is None or (link := self._next_link()) is None:
            return False
        link.setblocking(False)
        self._links += 1
        client = _Client(link, _who(link, self._links))
        self._silent[client] = None
        self._hear(client)
        if len(self._silent) > _MOST_SILENT:
            self._push_out(next(iter(self._silent)))
        return True

    def _hear(self, client: _Client) -> None:
        """Reads from a client; one that has asked gets a place among those that are answered once there is one."""
        try:
            self._read(client)
        except OSError:
            self._drop(client)
            return
        if client.waits and (least_missed := self._full()) is not None:
            for other in least_missed:
                self._push_out(other)
            del self._silent[client]
            self._clients.append(client)

    def _full(self) -> list[_Client] | None:
        """Returns the client that leaves to make room for one more, [] when a place is free, None when no client leaves
        and the new one waits.

        A client that presses leaves first; then, as long as the clients that wait for no answer hold more than half of
        the places, one of these: of the user who has the most connections, the one that connected last. So a client
        that stays keeps its place while others come, ask, and no longer need theirs.
        """
        if len(self._clients) < _MOST_CLIENTS:
            return []
        others = [client for client in self._clients if client.who.link != self._kept]
        idle = [client for client in others if not client.waits]
        leaving = [client for client in others if client.presses] + (idle if len(idle) > _MOST_CLIENTS // 2 else [])
        held = Counter(client.who.uid for client in self._clients)
        first = max(leaving, key=lambda one: (one.presses, held[one.who.uid], one.who.link), default=None)
        return None if first is None else [first]

    def _push_out(self, client: _Client) -> None:
        self._drop(client)
        self.dropped_clients += 1

    def _next_link(self) -> socket.socket | None:
        try:
            return self._listener.accept()[0]
        except OSError as error:
            # Without a descriptor, accept() fails even where nobody waits: then the reserved one stays.
            if error.errno not in (errno.EMFILE, errno.ENFILE) or self._spare is None or not self._awaited():
                return None
            os.close(self._spare)
            self._spare = None
            return self._next_link()

    def _awaited(self) -> bool:
        queue = select.poll()
        queue.register(self._listener, select.POLLIN)
        return bool(queue.poll(0))

    def _serve(self, client: _Client, answer: Answer) -> None:
        try:
            self._read(client)
            line, newline, rest = bytes(client.received).partition(b"\n")
            if newline:
                client.received = bytearray(rest)
                client.presses = client.waits
                self._clients.remove(client)
                self._clients.append(client)
                client.unsent += _line(_reply(line, answer, client.who))
            self._write(client)
        except OSError:
            self._drop(client)

    def _read(self, client: _Client) -> None:
        if len(client.received) <= _LONGEST_LINE:
            with contextlib.suppress(BlockingIOError):
                received = client.link.recv(_LONGEST_LINE)
                if not received and not client.waits:
                    raise ConnectionResetError
                client.received += received
        if len(client.received) > _LONGEST_LINE and not client.waits:
            raise ConnectionAbortedError

    def _write(self, client: _Client) -> None:
        if len(client.unsent) > _MOST_UNSENT:
            raise ConnectionAbortedError
        if client.unsent:
            with contextlib.suppress(BlockingIOError):
                del client.unsent[: client.link.send(client.unsent)]

    def _drop(self, client: _Client) -> None:
        if client in self._silent:
            del self._silent[client]
        else:
            self._clients.remove(client)
        if self._spare is None:
            # In one step: a device that is being opened again takes a number that is free for a moment.
            self._spare = os.dup2(self._lock_fd, client.link.detach(), inheritable=False)
        else:
            client.link.close()

    def _keep_spare(self) -> None:
        """Opens the reserved descriptor again, if need be later: a device that was being opened may have taken it while
        a client was accepted.
        """
        if self._spare is None:
            with contextlib.suppress(OSError):
                self._spare = os.dup(self._lock_fd)


def _line(reply: Reply) -> bytes:
    """Returns the reply as a line, and makes printable what came from a device or a client by a way that does not."""
    return json.dumps(printable_value(reply), ensure_ascii=False).encode() + b"\n"


def _who(link: socket.socket, number: int) -> Peer:
    pid, uid, _gid = struct.unpack("3i", link.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i")))
    return Peer(pid, uid, number)


def _reply(line: bytes, answer: Answer, who: Peer) -> Reply:
    try:
        if len(line) > _LONGEST_LINE:
            raise ControlRefused(f"a request has at most {_LONGEST_LINE} bytes")
        try:
            request = request_fields(line, VERSION)
        except ValueError as error:
            raise ControlRefused(str(error)) from None
        do = request.get("do")
        if not isinstance(do, str):
            raise ControlRefused('"do" must name a request, such as "status"')
        return {"v": VERSION, "ok": True, **answer(do, request, who)}
    except ProbewatchError as error:
        return {"v": VERSION, "ok": False, "error": str(error)}
