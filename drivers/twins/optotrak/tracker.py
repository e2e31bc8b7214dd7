"""Simulates an Optotrak behind a First Principles server (RTC3D)."""

import random
import socket
import struct
from contextlib import suppress
from dataclasses import replace
from math import floor
from threading import Event

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.trackers.optotrak.rtc3d import (
    HEADER_BYTES,
    ByteOrder,
    Component,
    ComponentType,
    DataFrame,
    NoData,
    Packet,
    PacketType,
    Text,
    decode_packet,
    encode_packet,
    packet_length,
)
from probewatch.drivers.twins.events import Events
from probewatch.drivers.twins.fault_control import FaultControl
from probewatch.drivers.twins.optotrak.first_principles import Device, Session
from probewatch.drivers.twins.tcp_server import ListeningTwin, TcpServer

FAULTS = (
    "bend-marker",
    "bend-witness",
    "slide-marker",
    "latency",
    "lose-tracker",
    "stale-tracker",
    "stale-number",
    "stale-time",
    "missing",
    "reference-missing",
    "witness-missing",
    "marker-drift",
    "frozen-pose",
    "no-data",
    "error",
    "events",
    "split",
    "dribble",
    "counter-jump",
    "wrong-size",
    "wrong-order",
    "bad-quaternion",
    "garbage",
    "reset",
    "unplug",
)
"""Names of the tracker's faults:

bend-witness, witness-missing: strike the bodies from the third on, which sit on the probe. lose-tracker: silence on
an open connection. stale-tracker: the same frame again and again; stale-number, stale-time: only its number, or
only its time, does not advance. frozen-pose: the same pose in new frames. marker-drift: a marker of the probe sits
elsewhere on its body, so the fit is poor. no-data: the server replies that there is nothing new. split: segments of
37 bytes. dribble: one byte in 50 ms. counter-jump, reset: at their beginning. unplug: connections end and new ones
are refused."""

_SEGMENT_BYTES, _SEGMENT_NS = 37, 1_000_000
"""Bytes and nanoseconds of fault "split": a prime, so that no field begins where a segment does for long; a millisecond
apart, so that they arrive one by one and the frame still within its period."""

_DRIBBLE_NS = 50_000_000
"""Nanoseconds between two bytes of fault "dribble", so that something always comes within the driver's timeout and
never a frame."""

_JUMP_FRAMES, _JUMP_US = 100_000, 1_000_000_000
"""Frames and microseconds: at 100 Hz both are 1000 s, far beyond any delay."""

_BACKLOG_BYTES = 1 << 20
"""Bytes that are kept for a client that does not read: half a minute of full frames at 100 Hz. More lets this process
grow; a client that reads again before it is full has lost nothing."""

_IDLE_NS = 20_000_000
"""Nanoseconds: longest wait, after which faults are checked. More shows them later, less wakes an idle twin more
often."""

_FIRST_ITEM = HEADER_BYTES + 4 + 24
"""Byte offset of the first item, RTC3D: behind the count of components, and size, type, frame, time and item count of
the first component."""


class _Client:
    """Represents one connection. session: what the client has asked for."""

    def __init__(self, line: socket.socket, session: Session) -> None:
        self.line, self.session = line, session
        self._received, self._waiting = bytearray(), bytearray()
        self._next_ns = 0

    def commands(self) -> list[Text]:
        """Returns the whole commands that have arrived. Raises ProtocolError, and OSError when the peer is gone."""
        data = self.line.recv(4096)
        if not data:
            raise ConnectionResetError
        self._received += data
        found: list[Text] = []
        while (length := packet_length(bytes(self._received[:HEADER_BYTES]))) and len(self._received) >= length:
            packet = decode_packet(bytes(self._received[:length]), self.session.order)
            del self._received[:length]
            if isinstance(packet, Text):
                found.append(packet)
        return found

    def put(self, data: bytes) -> None:
        """Queues data. Raises OSError when the peer leaves more than a megabyte waiting."""
        self._waiting += data
        if len(self._waiting) > _BACKLOG_BYTES:
            raise ConnectionAbortedError

    def flush(self, now_ns: int, segment_bytes: int, pause_ns: int) -> int:
        """Sends a segment when its time has come. Returns when to call again, ns. Raises OSError."""
        if self.session.ended and not self._waiting:
            raise ConnectionAbortedError
        if self._waiting and now_ns >= self._next_ns:
            with suppress(BlockingIOError):
                del self._waiting[: self.line.send(self._waiting[:segment_bytes])]
            self._next_ns = now_ns + pause_ns
        return max(self._next_ns, now_ns + _SEGMENT_NS) if self._waiting else now_ns + _IDLE_NS


class OptotrakTwin(ListeningTwin[_Client]):
    """Simulates a First Principles server. address: as `TcpServer` has it.

    faults: which of FAULTS are on, and when.
    """

    def __init__(self, address: tuple[str, int], clock: HostClock, device: Device, faults: FaultControl) -> None:
        self.device, self.faults = device, faults
        self._clock, self._events = clock, Events(clock)
        self._random = random.Random(0)
        self._active: frozenset[str] = frozenset()
        self._sent = -1
        self._held: int | None = None
        self._ready: tuple[int, frozenset[str], DataFrame] | None = None
        self._shift_frames, self._shift_us, self._begin_number = 0, 0, 0
        super().__init__(TcpServer(address, lambda line: _Client(line, Session(device)), self._events.note))

    def run(self, stop: Event) -> None:
        """Serves until stop is set."""
        while not stop.is_set():
            self._take_faults()
            self._measured(self._sent + 1)
            self._serve(min(self._next_frame_ns(), self._flush()))
            if self._number() > self._sent:
                self._stream(self._number())
                self._flush()

    def _number(self) -> int:
        return floor((self._clock.now_ns() - self._clock.origin_ns) / 1e9 * self.device.frame_hz)

    def _next_frame_ns(self) -> int:
        """Returns the time of the next frame plus a microsecond, so that rounding does not end the wait just before
        it.
        """
        return self._clock.origin_ns + round((self._sent + 1) / self.device.frame_hz * 1e9) + 1000

    def _reset(self) -> None:
        """Ends connections with RST; numbers and times start again."""
        self._begin_number = self._number()
        self._shift_frames = self._shift_us = 0
        self._server.reset()

    def _take_faults(self) -> None:
        """Applies what faults do at their beginning and their end."""
        active = self.faults.active((self._clock.now_ns() - self._clock.origin_ns) / 1e9)
        begun = active - self._active
        self._active = active
        if "counter-jump" in begun:
            self._shift_frames += _JUMP_FRAMES
            self._shift_us += _JUMP_US
        if "reset" in begun:
            self._reset()
        if "unplug" in active:
            self._server.unplug()
        else:
            self._server.listen()
        self._events.faults(active, self.faults.new_refusal())

    def _serve(self, wake_ns: int) -> None:
        """Waits for connections and commands until wake_ns."""
        wait_s = self._clock.real_s(max(wake_ns - self._clock.now_ns(), 0) / 1e9)
        for client in self._server.wait(wait_s, () if "lose-tracker" in self._active else self._server.clients):
            self._server.act(client, self._hear)

    def _hear(self, client: _Client) -> None:
        for request in client.commands():
            for packet in client.session.answer(request, lambda wanted: self._frame(wanted, self._number())):
                client.put(self._bytes(client, packet))

    def _stream(self, number: int) -> None:
        """Sends the latest frame to every client that is due one; frames for which this process was too late are left
        out.
        """
        previous, self._sent = self._sent, number

        def put(client: _Client) -> None:
            divisor = client.session.divisor
            if divisor and (turn := number - number % divisor) > previous:
                client.put(self._bytes(client, self._frame(client.session.wanted, turn)))

        self._server.act_for_all(put)

    def _frame(self, wanted: frozenset[ComponentType], number: int) -> Packet:
        active = self._active
        if "error" in active:
            return Text(PacketType.ERROR, "Error-System is not collecting")
        if "no-data" in active:
            return NoData()
        self._held = (number if self._held is None else self._held) if "stale-tracker" in active else None
        frame = self._measured(number if self._held is None else self._held)
        return DataFrame(tuple(self._renumbered(part) for part in frame.components if part.kind in wanted))

    def _measured(self, number: int) -> DataFrame:
        """Returns the frame of a number and keeps it, so that it is computed before its time and sent at its time."""
        if self._ready is None or self._ready[:2] != (number, self._active):
            self._ready = (number, self._active, self.device.frame(number, self._active))
        return self._ready[2]

    def _renumbered(self, component: Component) -> Component:
        """Returns the component with numbers and times since the last reset; a jump adds to them, and one of the two
        may not advance.
        """
        begin_us = round(self._begin_number / self.device.frame_hz * 1e6)
        number = 0 if "stale-number" in self._active else component.frame - self._begin_number
        time_us = 0 if "stale-time" in self._active else component.time_us - begin_us
        return replace(
            component,
            frame=max(number + self._shift_frames, 0) % (1 << 32),
            time_us=max(time_us + self._shift_us, 0),
        )

    def _bytes(self, client: _Client, packet: Packet) -> bytes:
        """Returns the packet as the faults leave it; only frames are spoiled."""
        order, active = client.session.order, self._active
        if not isinstance(packet, DataFrame):
            return encode_packet(packet, order)
        if "wrong-order" in active:
            order = next(other for other in ByteOrder if other is not order)
        data = bytearray(encode_packet(packet, order))
        if "wrong-size" in active:
            data[HEADER_BYTES + 7] ^= 0x04
        if "bad-quaternion" in active:
            data[_FIRST_ITEM : _FIRST_ITEM + 4] = struct.pack(f"{order.value}f", 2.0)
        if "garbage" in active:
            data += self._random.randbytes(64)
        return bytes(data)

    def _flush(self) -> int:
        """Sends what waits. Returns when to call again, ns."""
        now_ns = self._clock.now_ns()
        if "lose-tracker" in self._active:
            return now_ns + _IDLE_NS
        size, pause_ns = (1 << 16, 0)
        if "split" in self._active:
            size, pause_ns = _SEGMENT_BYTES, _SEGMENT_NS
        if "dribble" in self._active:
            size, pause_ns = 1, _DRIBBLE_NS
        times_ns = [now_ns + _IDLE_NS]
        self._server.act_for_all(lambda client: times_ns.append(client.flush(now_ns, size, pause_ns)))
        return min(times_ns)


def serve(address: tuple[str, int], clock: HostClock, device: Device, faults: FaultControl, stop: Event) -> None:
    """Prints when it is ready, then serves until stop is set. Raises ConfigurationError for a port in use."""
    # A parent that no longer reads the events must not see a traceback.
    with suppress(BrokenPipeError), OptotrakTwin(address, clock, device, faults) as twin:
        host, port = twin.address
        Events(clock).tell({"ready": True, "url": f"optotrak://{host}:{port}?body=1"})
        twin.run(stop)
