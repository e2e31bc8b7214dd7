"""Serves OpenIGTLink to any number of clients up to a bound, none of which can hold up another, or the service."""

import selectors
import socket
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from threading import Event

from probewatch.drivers.closable import Closable
from probewatch.drivers.errors import ProtocolError, cannot_listen
from probewatch.drivers.openigtlink.client import FOLLOW_REMEDY
from probewatch.drivers.openigtlink.message import Header, Message, encode
from probewatch.drivers.openigtlink.stream import MessageStream
from probewatch.drivers.samples import Frame, Pose
from probewatch.tools.openigtlink.answers import answer_to
from probewatch.tools.openigtlink.asked import USUAL_NAMES, Asked, Names, nothing_comes
from probewatch.tools.openigtlink.passage import Passage, Wanted
from probewatch.tools.openigtlink.replies import damaged
from probewatch.tools.openigtlink.samples import sample_message
from probewatch.tools.openigtlink.wording import estimate_message, state_message, status_message, transform_message
from probewatch.tools.shared.called_host import endpoint_text
from probewatch.tools.shared.status_watch import Seen, StatusWatch

_MOST_CLIENTS = 32
"""Clients at once; to admit another one, a client that has started no stream is disconnected, else the new one is. Each
costs a descriptor, a buffer and some 0.1 ms in a round. Not measured."""

_SETTLED_S = 5.0
"""Seconds for which a client that has started no stream keeps its place though others wait for one. 3D Slicer starts
none either, and reconnects: less disconnects it sooner where many clients keep connecting, more keeps it waiting where
many stay connected.
"""

_MOST_UNSENT = 1 << 18
"""Bytes that wait for a client which asks and does not read; beyond that it is dropped. More takes memory, less drops
one that asks much at once: 60 whole answers."""

_ASLEEP_S = 10.0
"""Seconds for a client to take what was queued for it; then it is dropped. Less drops one that a busy computer has
stopped, more keeps a place for nobody."""

_LONGEST_BODY = 8192
"""Bytes of a question: a command and its metadata. Longer ones are passed over, as data that nobody asked for."""

_SEND_BUFFER = 1 << 15
"""Bytes that the kernel keeps for a client: a slow one finds old messages there, so that few are better. Less than a
round of messages, 5 kB, would never let one out whole."""

_MOST_VIEWERS = 8
"""Clients that are shown pictures at once, as many as the feed serves; the next one is refused in words. Each takes a
copy of 9 MB a second at 640 x 480 and 30 Hz."""

_VIEWER_BUFFER = 1 << 18
"""Bytes as _SEND_BUFFER, for a client that is shown pictures. The kernel doubles it, so that a picture of 640 x 480
leaves in one turn; a client that reads slowly finds the messages before it that much older."""

_STATE_EVERY_S = 1.0
"""Seconds between two STRING and TRANSFORM while nothing changes: a reader's pace. STATUS is sent in every round."""

_MOST_TOLD = 100
"""Lines of the journal about what clients send wrongly, since the start. More lets a network of strangers fill it; less
is silent about the next client. Not measured."""

_READ_BYTES, _QUESTIONS = 1 << 14, 8
"""Bytes taken from a client, and questions answered, in one turn, so that one that floods the server waits for the
others: an answer takes some 0.1 ms. Fewer take more turns for a client that asks everything at once."""


class _Client:
    """Holds one connection. version: that of the headers which the client understands: 1 until it has shown a later
    one. asked: its requests for pictures and poses. damage: questions that came damaged, until they are answered. due:
    whether a round has passed it over. trouble: the reason it was last given why none of them come. spoke_s: when it
    last asked, or connected.
    """

    def __init__(self, line: socket.socket, address: str, asked: Asked) -> None:
        self.line, self.version, self.number, self.asked = line, 1, 0, asked
        self.due, self.trouble, self._picture_bytes = False, "", 0
        self.address, self.came_s = address, time.monotonic()
        self.spoke_s = self.came_s
        self.unsent = bytearray()
        self.damage: list[tuple[Header, ProtocolError]] = []
        self.stream = MessageStream(_is_question)
        self.moved_s = time.monotonic()
        self.sent: tuple[object, ...] = ()
        self.sent_s = 0.0

    def hear(self) -> list[Message]:
        """Returns the questions that have come. Raises OSError if the client is gone, ProtocolError for bad bytes."""
        if not self.stream.waiting:
            data = self.line.recv(_READ_BYTES)
            if not data:
                raise ConnectionResetError
            self.stream.add(data, 0)
        found: list[Message] = []
        while len(found) + len(self.damage) < _QUESTIONS and self._take(found):
            pass
        self.stream.require_sound()
        return found

    def _take(self, found: list[Message]) -> bool:
        """Takes the next whole message. Returns False where there is none."""
        try:
            arrived = self.stream.take()
        except ProtocolError as error:
            assert self.stream.damaged is not None
            self.damage.append((self.stream.damaged, error))
            return True
        if arrived is None:
            return False
        self.version = max(self.version, min(arrived.message.version, 2))
        found.append(arrived.message)
        self.spoke_s = time.monotonic()
        return True

    def put(self, message: Message) -> None:
        """Queues a message. Raises OSError for a client that does not read."""
        if not self.unsent:
            self.moved_s = time.monotonic()
        self.unsent += encode(message)
        if len(self.unsent) > _MOST_UNSENT + self._picture_bytes:
            raise ConnectionAbortedError

    def put_sample(self, kind: str, data: bytes) -> None:
        """Queues a sample; drops it where too much waits already, a picture where anything does."""
        if len(self.unsent) > (0 if kind == "IMAGE" else _MOST_UNSENT):
            return
        if kind == "IMAGE" and not self._picture_bytes:
            self.line.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _VIEWER_BUFFER)
        self._picture_bytes = len(data) if kind == "IMAGE" else self._picture_bytes
        if not self.unsent:
            self.moved_s = time.monotonic()
        self.unsent += data
        self.asked.given(kind)

    def flush(self) -> None:
        """Sends what is queued. Raises OSError, also for a client that has taken nothing for too long."""
        with suppress(BlockingIOError):
            while self.unsent:
                del self.unsent[: self.line.send(self.unsent)]
                self.moved_s = time.monotonic()
        if self.unsent and time.monotonic() - self.moved_s > _ASLEEP_S:
            raise ConnectionAbortedError


class StateServer(Closable):
    """Listens from construction until the context is left. address: (host, port), the port chosen if 0 was given.

    every_s: the time between two rounds. passage: the source of pictures and poses, which are sent under names to
    clients that ask, or, where unasked, to every client. turned_away, dropped: numbers of clients that found no place
    or had to leave it, and of clients that did not read, disconnected or sent what is not OpenIGTLink. damaged: the
    number of questions that came damaged. say: writes to the journal, once for each address and kind of damage.
    """

    def __init__(
        self,
        address: tuple[str, int],
        watch: StatusWatch,
        every_s: float,
        passage: Passage,
        names: Names = USUAL_NAMES,
        unasked: bool = False,
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Raises ConfigurationError where nobody can listen."""
        self._watch, self._every_s, self._passage, self._names = watch, every_s, passage, names
        self._unasked = frozenset({"IMAGE", "TRANSFORM"}) if unasked else frozenset[str]()
        self._clients: list[_Client] = []
        self.turned_away = self.dropped = self.damaged = 0
        self._say, self._told = say, set[tuple[str, str]]()
        try:
            self._door = socket.create_server(address, family=socket.AF_INET6 if ":" in address[0] else socket.AF_INET)
        except (OSError, UnicodeError) as error:
            remedy = "Choose another --port, or end what listens there"
            raise cannot_listen(error, endpoint_text(*address), remedy) from None
        self._door.setblocking(False)
        self.address: tuple[str, int] = self._door.getsockname()[:2]

    def close(self) -> None:
        """Closes the listening socket and every connection."""
        self._door.close()
        for client in self._clients:
            client.line.close()

    def run(self, stop: Event) -> None:
        """Serves until stop is set."""
        next_s = time.monotonic()
        while not stop.is_set():
            self._serve(max(0.0, next_s - time.monotonic()))
            self._hand_on()
            if time.monotonic() >= next_s:
                next_s = time.monotonic() + self._every_s
                self._round()
            kinds = frozenset[str]().union(*(client.asked.kinds for client in self._clients))
            self._passage.want(Wanted("IMAGE" in kinds, "TRANSFORM" in kinds))

    def _round(self) -> None:
        """Sends STATUS to every client, the rest to those to which it is new. A client that has not taken the last
        round is passed over.
        """
        seen, utc_ns = self._watch.seen(), _utc_ns()
        for client in tuple(self._clients):
            self._for_client(client, lambda client: self._send_state(client, seen, utc_ns))

    def _send_state(self, client: _Client, seen: Seen, utc_ns: int) -> None:
        client.due = bool(client.unsent)
        if not client.unsent:
            client.number = (client.number + 1) % (1 << 32)
            client.put(status_message(seen, utc_ns, client.version, client.number))
            if client.sent != (news := _news(seen)) or time.monotonic() - client.sent_s >= _STATE_EVERY_S:
                client.sent, client.sent_s = news, time.monotonic()
                client.put(state_message(seen, utc_ns, client.version, client.number))
                for made in (transform_message, estimate_message):
                    if (transform := made(seen, utc_ns, client.version, client.number)) is not None:
                        client.put(transform)
            self._complain(client)
        client.flush()

    def _complain(self, client: _Client) -> None:
        """Reports pictures and poses that the client has asked for and that do not come."""
        trouble = self._passage.trouble
        late = client.asked.overdue(time.monotonic())
        if client.asked.streams and trouble and trouble != client.trouble:
            late = (self._names.image, *late)
        client.trouble = trouble
        for device in dict.fromkeys(late):
            client.put(nothing_comes(device, trouble, client.version))

    def _hand_on(self) -> None:
        """Sends new samples to the clients that asked for them. One that has not taken the last picture is left out."""
        for sample in self._passage.take():
            self._show_all(sample)

    def _show_all(self, sample: Frame | Pose) -> None:
        kind, made = "IMAGE" if isinstance(sample, Frame) else "TRANSFORM", dict[int, bytes]()
        for client in tuple(self._clients):
            if kind in client.asked.kinds:
                self._for_client(client, lambda client: self._show(client, kind, sample, made))

    def _show(self, client: _Client, kind: str, sample: Frame | Pose, made: dict[int, bytes]) -> None:
        """Sends a sample to one client, after the state if that waits. made: the sample as sent, by header version."""
        client.flush()
        seen, utc_ns = self._watch.seen(), _utc_ns()
        if client.due and not client.unsent:
            self._send_state(client, seen, utc_ns)
        if client.version not in made:
            simulated = seen.status is not None and bool(seen.status["simulated"])
            made[client.version] = encode(sample_message(sample, self._names, utc_ns, client.version, simulated))
        client.put_sample(kind, made[client.version])
        client.flush()

    def _serve(self, wait_s: float) -> None:
        with selectors.DefaultSelector() as ready:
            ready.register(self._door, selectors.EVENT_READ)
            ready.register(self._passage, selectors.EVENT_READ, self._passage)
            for client in self._clients:
                events = selectors.EVENT_READ | (selectors.EVENT_WRITE if client.unsent else 0)
                ready.register(client.line, events, client)
            asking = [client for client in self._clients if client.stream.waiting]
            found = ready.select(0 if asking else wait_s)
        for client in asking:
            self._for_client(client, self._answer)
        for key, events in found:
            if key.data is self._passage:
                continue
            if key.data is None:
                self._accept()
            elif key.data not in self._clients or key.data in asking:
                continue
            elif events & selectors.EVENT_READ:
                self._for_client(key.data, self._answer)
            else:
                self._for_client(key.data, _Client.flush)

    def _accept(self) -> None:
        with suppress(OSError):
            line, (address, *_) = self._door.accept()
            if len(self._clients) >= _MOST_CLIENTS:
                self.turned_away += 1
                if not self._make_room(address):
                    line.close()
                    return
            line.setblocking(False)
            line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            line.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
            streams = self._unasked if self._viewers() < _MOST_VIEWERS else self._unasked - {"IMAGE"}
            self._clients.append(_Client(line, address, Asked(self._names, streams)))
            self._watch.want(len(self._clients))

    def _make_room(self, address: str) -> bool:
        """Disconnects a client and returns whether there was one to disconnect: one that has started no stream, of the
        address from which most are connected, the one that has been quiet longest. Where there is none of that kind, it
        takes one of an address from which two more are connected than from that of the client that waits.
        """
        held = Counter(one.address for one in self._clients)
        settled_s = time.monotonic() - _SETTLED_S
        settled = [one for one in self._clients if not one.asked.started and one.came_s <= settled_s]
        others = [one for one in self._clients if held[one.address] >= held[address] + 2]
        if not (settled or others):
            return False
        leaves = max(settled or others, key=lambda one: (held[one.address], not one.asked.started, -one.spoke_s))
        leaves.line.close()
        self._clients.remove(leaves)
        return True

    def _answer(self, client: _Client) -> None:
        with suppress(BlockingIOError):
            for question in client.hear():
                if (reply := self._reply(client, question)) is not None:
                    client.put(reply)
        for header, error in client.damage:
            self.damaged += 1
            client.put(damaged(header, error))
            self._tell(client, error, "sends questions that come damaged", FOLLOW_REMEDY)
        client.damage.clear()
        client.flush()

    def _tell(self, client: _Client, error: ProtocolError, words: str, remedy: str) -> None:
        """Reports damage once for each address and kind: a client that keeps reconnecting does not fill the journal."""
        if len(self._told) < _MOST_TOLD and (client.address, words) not in self._told:
            self._told.add((client.address, words))
            self._say(f"the client {client.address} {words}: {error.what}. {remedy}")

    def _reply(self, client: _Client, question: Message) -> Message | None:
        if not client.asked.concerns(question):
            return answer_to(question, self._watch.seen(), _utc_ns(), self._names)
        has_place = "IMAGE" in client.asked.kinds or self._viewers() < _MOST_VIEWERS
        return client.asked.answer(question, has_place, time.monotonic())

    def _viewers(self) -> int:
        return sum("IMAGE" in client.asked.kinds for client in self._clients)

    def _for_client(self, client: _Client, act: Callable[[_Client], object]) -> None:
        try:
            act(client)
        except (OSError, ProtocolError) as error:
            if isinstance(error, ProtocolError):
                self._tell(client, error, "was sent away, as it sends no OpenIGTLink", "End or mend that client")
            self.dropped += 1
            client.line.close()
            self._clients.remove(client)
            self._watch.want(len(self._clients))


def _is_question(header: Header) -> bool:
    asks = header.kind.startswith(("GET_", "STT_", "STP_")) or header.kind in ("COMMAND", "STRING")
    return asks and header.body_bytes <= _LONGEST_BODY


def _news(seen: Seen) -> tuple[object, ...]:
    """Returns the part of the status of which a change is sent at once."""
    status = seen.status
    if status is None:
        return (None,)
    reference = status["reference"]
    return status["state"], status["energised"], status["reason"], None if reference is None else reference["sha256"]


def _utc_ns() -> int:
    """Returns nanoseconds since 1970 UTC at CLOCK_MONOTONIC 0, by the clock of the computer now."""
    return time.time_ns() - time.monotonic_ns()
