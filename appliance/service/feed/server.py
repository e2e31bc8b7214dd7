"""Distributes what the estimator publishes to the clients of the feed's socket, each at its own pace. Never waits for
one.

A client that reads too slowly misses samples, which are counted and reported to it; one that does not read at all is
dropped. Nothing that a client does reaches the estimator, which learns only whether there is a subscription.
"""

import contextlib
import selectors
import socket
import struct
import time
from collections import Counter, deque
from dataclasses import dataclass, field

import numpy as np

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.service.estimator.ring import Ring
from probewatch.appliance.service.estimator.tap import (
    ALL_BUT_PICTURES,
    NOTHING,
    PICTURES,
    Begun,
    FeedCounts,
    Picture,
    Subscription,
    Taken,
    received,
)
from probewatch.appliance.service.feed import message
from probewatch.appliance.service.feed.request import LONGEST_LINE, FeedRequest, request_of
from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.samples import Frame, GreyImage, Pose

MOST_CLIENTS, _MOST_SILENT = 8, 8
"""Clients that listen, and those that have not asked yet. Each that listens may occupy MOST_UNSENT of memory."""
MOST_UNSENT = 1 << 24
"""Bytes that may wait for one client: 1.7 s of pictures of 640 × 480 at 30 Hz, or four of the largest. More takes
memory from the cart, eight times; less loses samples when the client's disk pauses.
"""
_SILENT_S, _ASLEEP_S = 5.0, 10.0
"""s, how long a client may take to ask, and how long it may read nothing of what waits for it. Less drops clients on a
busy computer; more keeps a place for no client.
"""
_NO_END = f"no whole line came within {_SILENT_S:g} s: a request ends with a line feed"
_IDLE_S = 30.0
"""s without any client after which this process ends and frees its memory; starting another takes 0.3 s."""
_SWEEP_S = 1.0
"""s between two checks for clients that do not read; one is dropped at most this late."""
_PACKETS, _SENT_BYTES = 32, 1 << 20
"""Packets of the estimator, and bytes to one client, in one turn: the others wait no longer. Fewer take more turns. Not
measured.
"""
_PAUSE_S = 0.05
"""s, the pause when a client waits but this process may open no more files: else it would try again and again."""

_Parts = tuple[bytes, ...]


@dataclass(slots=True, eq=False)
class _Client:
    """Represents a connected client.

    unsent: parts that wait, of which the first is sent up to `sent`. missed: samples to be reported as lost.
    """

    link: socket.socket
    uid: int
    since_s: float
    request: FeedRequest | None = None
    received: bytearray = field(default_factory=bytearray)
    unsent: deque[bytes] = field(default_factory=deque)
    unsent_bytes: int = 0
    sent: int = 0
    missed: int = 0
    pictures: int = 0
    knows_settings: bool = False
    watched: int = selectors.EVENT_READ

    def put(self, parts: _Parts) -> bool:
        """Queues all of it, or nothing if too much waits, and returns which. What was lost before is reported first."""
        size = sum(map(len, parts))
        if self.unsent and self.unsent_bytes + size > MOST_UNSENT:
            return False
        if self.missed:
            parts = (message.lost(self.missed), *parts)
            self.missed = 0
        if not self.unsent:
            self.since_s = time.monotonic()
        self.unsent.extend(parts)
        self.unsent_bytes += sum(map(len, parts))
        return True

    def flush(self) -> None:
        """Sends what the client takes now, up to a bound. Raises OSError when the client is gone."""
        left = _SENT_BYTES
        with contextlib.suppress(BlockingIOError):
            while self.unsent and left > 0:
                first = self.unsent[0]
                count = self.link.send(memoryview(first)[self.sent : self.sent + left])
                left -= count
                self.since_s = time.monotonic()
                self.sent += count
                if self.sent == len(first):
                    self.unsent.popleft()
                    self.unsent_bytes -= len(first)
                    self.sent = 0


class FeedServer:
    """Serves the clients of the feed until there has been none for some time.

    listener: of the feed's socket. packets, frames, subscription: of the tap. without_pictures: users who are shown no
    pictures.
    """

    def __init__(
        self,
        listener: socket.socket,
        packets: socket.socket,
        frames: Ring,
        subscription: Subscription,
        without_pictures: frozenset[int],
        software: str,
    ) -> None:
        self._listener, self._packets, self._frames, self._subscription = listener, packets, frames, subscription
        self._without_pictures, self._software = without_pictures, software
        self._clients: list[_Client] = []
        self._pictures: deque[Frame] = deque()
        self._settings: EstimatorSettings | None = None
        self._next: int | None = None
        self._lost = self._dropped = 0
        self._stopping = False
        self._selector = selectors.DefaultSelector()
        for source in (listener, packets):
            source.setblocking(False)
            self._selector.register(source, selectors.EVENT_READ)

    def run(self) -> None:
        """Serves until there has been no client for some time."""
        alone_s = time.monotonic()
        sweep_s = 0.0
        self._note()
        while not self._stopping and time.monotonic() - alone_s < _IDLE_S:
            for key, events in self._selector.select(_SWEEP_S):
                self._turn(key, events)
            now_s = time.monotonic()
            if self._clients:
                alone_s = now_s
            if now_s - sweep_s >= _SWEEP_S:
                sweep_s = now_s
                self._sweep(now_s)

    def stop(self) -> None:
        """Makes run() return within a second; may be called from any thread."""
        self._stopping = True

    def close(self) -> None:
        """Drops all clients."""
        for client in tuple(self._clients):
            self._drop(client)
        self._selector.close()

    def _turn(self, key: selectors.SelectorKey, events: int) -> None:
        if key.fileobj is self._listener:
            self._accept()
        elif key.fileobj is self._packets:
            self._hear()
        elif key.data in self._clients:
            if events & selectors.EVENT_READ:
                self._listen_to(key.data)
            else:
                self._flush(key.data)

    def _accept(self) -> None:
        try:
            link, _ = self._listener.accept()
        except BlockingIOError:
            return
        except OSError:
            time.sleep(_PAUSE_S)
            return
        link.setblocking(False)
        client = _Client(link, _uid(link), time.monotonic())
        silent = [one for one in self._clients if one.request is None]
        if len(silent) >= _MOST_SILENT:
            self._send_away(silent[0])
        self._clients.append(client)
        self._selector.register(link, selectors.EVENT_READ, client)
        self._listen_to(client)

    def _listen_to(self, client: _Client) -> None:
        """Reads the client's only line; a client that sends more, or ends, is dropped."""
        try:
            said = client.link.recv(LONGEST_LINE)
        except BlockingIOError:
            return
        except OSError:
            said = b""
        if not said and client.received and client.request is None:
            self._refuse(client, _NO_END)
            return
        if not said or client.request is not None:
            self._drop(client)
            return
        client.received += said
        line, newline, rest = bytes(client.received).partition(b"\n")
        if newline or len(line) > LONGEST_LINE:
            self._begin(client, line, rest)

    def _begin(self, client: _Client, line: bytes, rest: bytes) -> None:
        try:
            if len(line) > LONGEST_LINE:
                raise ProtocolError(f"a request has at most {LONGEST_LINE} bytes")
            if rest:
                raise ProtocolError("one line is asked, and nothing after it")
            request = request_of(line)
            if request.pictures and client.uid in self._without_pictures:
                raise ProtocolError("your user is shown no pictures ([control] viewers); ask with pictures = false")
            self._make_room(client.uid)
        except ProtocolError as error:
            self._refuse(client, str(error))
            return
        client.request = request
        self._note()
        client.put((message.hello(self._software, request.ignored),))
        self._flush(client)

    def _make_room(self, uid: int) -> None:
        """Frees a place. Raises ProtocolError when all places are taken and no user has two more than this one."""
        listening = [one for one in self._clients if one.request is not None]
        if len(listening) < MOST_CLIENTS:
            return
        held = Counter(one.uid for one in listening)
        greedy, places = held.most_common(1)[0]
        if places < held[uid] + 2:
            raise ProtocolError(f"{len(listening)} clients listen already. End one of them")
        self._send_away(next(one for one in reversed(listening) if one.uid == greedy))

    def _hear(self) -> None:
        for _ in range(_PACKETS):
            packet = received(self._packets)
            if packet is None:
                return
            if isinstance(packet, Begun):
                self._settings, self._next = packet.settings, packet.step
                for client in self._clients:
                    client.knows_settings = False
            elif self._next is not None:
                self._send_to_clients(packet, gap=packet.step - self._next)
                self._next = packet.step + 1

    def _send_to_clients(self, taken: Taken, gap: int) -> None:
        frame = self._frame(taken.sample) if isinstance(taken.sample, Picture) else None
        verdicts = tuple(message.judged(taken.step, verdict) for verdict in taken.verdicts)
        made: dict[int | None, _Parts] = {}
        for client in tuple(self._clients):
            request = client.request
            if request is None:
                continue
            if client.knows_settings:
                self._miss(client, gap)
            self._introduce(client, taken.step)
            parts: _Parts | None
            if isinstance(taken.sample, Pose):
                parts = made.setdefault(None, (message.taken_pose(taken.step, taken.sample),))
            elif not request.pictures or client.pictures % request.every:
                parts = ()
            elif frame is None:
                parts = None
            else:
                key = request.most_px or 0
                parts = made[key] if key in made else made.setdefault(key, _picture(taken.step, frame, request.most_px))
            client.pictures += isinstance(taken.sample, Picture)
            self._put(client, parts, verdicts)

    def _put(self, client: _Client, parts: _Parts | None, verdicts: _Parts) -> None:
        """Queues a sample. parts: None for a picture that was overwritten before it could be read."""
        whole = verdicts if parts is None else (*parts, *verdicts)
        if parts is None or (whole and not client.put(whole)):
            self._miss(client, 1)
        self._flush(client)

    def _miss(self, client: _Client, samples: int) -> None:
        client.missed += samples
        self._lost += samples

    def _introduce(self, client: _Client, step: int) -> None:
        """Sends the settings, in the queue like a sample: when there is no room for them, they are sent later."""
        if not client.knows_settings and client.put((message.line_started(self._settings, step),)):
            client.knows_settings = True

    def _frame(self, picture: Picture) -> Frame | None:
        """Returns the picture's frame from the ring, None when it was not put there or has been overwritten."""
        if not picture.there:
            return None
        wanted = picture.stamp, picture.sequence
        if not self._pictures:
            self._pictures.extend(frame for frame in self._frames.take()[0] if isinstance(frame, Frame))
        known = [(frame.stamp, frame.sequence) for frame in self._pictures]
        if wanted not in known:
            self._pictures.extend(frame for frame in self._frames.take()[0] if isinstance(frame, Frame))
            known = [(frame.stamp, frame.sequence) for frame in self._pictures]
        if wanted not in known:
            return None
        for _ in range(known.index(wanted)):
            self._pictures.popleft()
        return self._pictures.popleft()

    def _flush(self, client: _Client) -> None:
        try:
            client.flush()
        except OSError:
            self._drop(client)
            return
        watched = selectors.EVENT_READ | (selectors.EVENT_WRITE if client.unsent else 0)
        if watched != client.watched:
            client.watched = watched
            self._selector.modify(client.link, watched, client)

    def _sweep(self, now_s: float) -> None:
        for client in tuple(self._clients):
            silent = client.request is None and now_s - client.since_s > _SILENT_S
            asleep = client.unsent and now_s - client.since_s > _ASLEEP_S
            if silent:
                self._refuse(client, _NO_END)
            elif asleep:
                self._send_away(client)
            elif client.missed and client.put(()):
                self._flush(client)
        self._note()

    def _refuse(self, client: _Client, why: str) -> None:
        with contextlib.suppress(OSError):
            client.link.send(message.refused(why))
        self._send_away(client)

    def _send_away(self, client: _Client) -> None:
        self._dropped += 1
        self._drop(client)

    def _drop(self, client: _Client) -> None:
        self._selector.unregister(client.link)
        client.link.close()
        self._clients.remove(client)
        self._note()

    def _note(self) -> None:
        """Publishes what is wanted now, and the counts of the feed."""
        listening = [client.request for client in self._clients if client.request is not None]
        if not listening:
            self._pictures.clear()
        wanted = PICTURES if any(one.pictures for one in listening) else ALL_BUT_PICTURES
        self._subscription.want(wanted if listening else NOTHING)
        self._subscription.count(FeedCounts(len(listening), self._lost, self._dropped))


def _uid(link: socket.socket) -> int:
    _pid, uid, _gid = struct.unpack("3i", link.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i")))
    return int(uid)


def _picture(step: int, frame: Frame, most_px: int | None) -> _Parts:
    height, width = frame.image.shape
    by = 1 if most_px is None else min(-(-max(height, width) // most_px), height, width)
    small = frame if by == 1 else Frame(frame.stamp, frame.sequence, reduced(frame.image, by))
    return message.taken_frame(step, small, (width, height), by)


def reduced(image: GreyImage, by: int) -> GreyImage:
    """Returns (height // by, width // by): the mean of each whole block of by × by pixels.

    by: at most the shorter side.
    """
    height, width = image.shape[0] // by, image.shape[1] // by
    blocks = image[: height * by, : width * by].reshape(height, by, width, by)
    return np.asarray(blocks.mean(axis=(1, 3)), np.uint8)
