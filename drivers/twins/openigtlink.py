"""Simulates an OpenIGTLink server, such as PLUS, that passes on what a scanner and a tracker yield, or a simulated
world.

Pictures go out as IMAGE, poses as TRANSFORM; a pose without a matrix goes out with the last matrix that there was and
PLUS's word for why. GET_STATUS is answered.
"""

import math
import queue
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from threading import Event

import numpy as np

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.device_api import TrackerSource, VideoSource
from probewatch.drivers.errors import DeviceLost, ProtocolError
from probewatch.drivers.openigtlink.content import OK, Status, transform_content
from probewatch.drivers.openigtlink.image import Image
from probewatch.drivers.openigtlink.message import UTF_8, Message, encode, time_of
from probewatch.drivers.openigtlink.stream import MessageStream
from probewatch.drivers.samples import Frame, Matrix4, Pose, PoseStatus, Sample, Stamp
from probewatch.drivers.twins.events import Events
from probewatch.drivers.twins.fault_control import FaultControl
from probewatch.drivers.twins.faults import spoil_witness
from probewatch.drivers.twins.tcp_server import ListeningTwin, TcpServer

IMAGE_NAME, PROBE_NAME, WITNESS_NAME = "Image_Tracker", "ProbeToTracker", "WitnessToTracker"
"""Device names, in PLUS's manner."""

FAULTS = (
    "stall",
    "mute",
    "unplug",
    "reset",
    "bad-crc",
    "garbage",
    "split",
    "clock-jump",
    "untimed",
    "repeat",
    "complain",
    "identity",
    "left-out",
    "old-header",
    "bend-witness",
    "witness-missing",
)
"""Names of the server's faults:

stall: open connections, and nothing more is sent. mute: pictures and poses end, questions are answered. unplug:
connections end and new ones are refused. reset, clock-jump: at their beginning; a jump sets the sender's clock ahead by
an hour. bad-crc, garbage: in every message, or after it. split: segments of 37 bytes. untimed: time 0. repeat: the last
pose again and again. complain: STATUS says not ready. identity, left-out: what a server sends for a tool that is not
seen, in place of PLUS's words. old-header: version 1, without metadata. bend-witness, witness-missing: strike the
second body."""

_STATUS_WORDS = {
    PoseStatus.OK: "OK",
    PoseStatus.PARTIAL: "OUT_OF_VOLUME",
    PoseStatus.OUT_OF_VOLUME: "OUT_OF_VOLUME",
    PoseStatus.MISSING: "OUT_OF_VIEW",
    PoseStatus.STALE: "REQ_TIMEOUT",
    PoseStatus.DISABLED: "MISSING",
    PoseStatus.FAULT: "UNKNOWN",
    PoseStatus.NOT_UNDERSTOOD: "UNKNOWN",
}
"""PLUS's words for the state of a tool."""

_READ_S, _PAUSE_S = 0.1, 0.2
"""Seconds for which a source is waited for, and between two attempts to open one. Longer ends the twin later."""

_SEND_EVERY_NS = 30_000_000
"""Nanoseconds between two messages that the tracker is lost: the pace of PLUS's loop, 33 Hz or so."""

_BACKLOG_BYTES = 1 << 23
"""Bytes that are kept for a client that does not read: a second of pictures. At more it is dropped, or this process
would grow."""

_WAITING = 64
"""Samples that the sources may be ahead of the server, a second of poses: at more they wait for it."""

_IDLE_S = 0.02
"""Seconds: longest wait, after which faults are checked and samples taken."""

_SEGMENT_BYTES = 37
"""Bytes of a segment in fault "split": a prime, so that no message begins where a segment does for long."""

_JUMP_NS = 3_600_000_000_000
"""Nanoseconds of fault "clock-jump": an hour, as when daylight saving time is corrected by hand."""

_SEED = 53
"""Random seed of the garbage, so that it is the same every time."""

Opener = Callable[[], VideoSource | TrackerSource]


class _Client:
    """Represents one connection. version: that of the last header which the client sent, 1 before that."""

    def __init__(self, line: socket.socket) -> None:
        self.line, self.version = line, 1
        self.unsent = bytearray()
        self.stream = MessageStream(lambda header: header.kind == "GET_STATUS")

    def hear(self) -> list[Message]:
        """Returns the questions that have arrived. Raises OSError when the peer is gone, and ProtocolError."""
        data = self.line.recv(4096)
        if not data:
            raise ConnectionResetError
        self.stream.add(data, 0)
        self.stream.require_sound()
        found = []
        while (arrived := self.stream.take()) is not None:
            found.append(arrived.message)
            self.version = min(arrived.message.version, 2)
        return found

    def put(self, data: bytes) -> None:
        """Queues data. Raises OSError for a client that does not read."""
        self.unsent += data
        if len(self.unsent) > _BACKLOG_BYTES:
            raise ConnectionAbortedError

    def flush(self, most_bytes: int) -> None:
        """Sends what is queued, at most most_bytes at a time. Raises OSError."""
        with suppress(BlockingIOError):
            while self.unsent:
                del self.unsent[: self.line.send(self.unsent[:most_bytes])]


class IgtlTwin(ListeningTwin[_Client]):
    """Simulates an OpenIGTLink server. address: as `TcpServer` has it.

    sources: how to open what is passed on, each opened again when it is lost. faults: which of FAULTS are on, and when.
    """

    def __init__(
        self, address: tuple[str, int], clock: HostClock, sources: tuple[Opener, ...], faults: FaultControl
    ) -> None:
        self.faults = faults
        self._clock, self._sources, self._events = clock, sources, Events(clock)
        self._utc_ns = time.time_ns() - clock.now_ns()
        self._samples: queue.Queue[Sample] = queue.Queue(_WAITING)
        self._active: frozenset[str] = frozenset()
        self._last: tuple[Matrix4, int] = (np.eye(4), 0)
        self._number = 0
        self._tracker_is_lost = False
        self._sent_ns = 0
        self._random = np.random.default_rng(_SEED)
        super().__init__(TcpServer(address, _Client, self._events.note))

    def run(self, stop: Event) -> None:
        """Serves until stop is set."""
        threads = [threading.Thread(target=self._draw, args=(opener, stop)) for opener in self._sources]
        for thread in threads:
            thread.start()
        while not stop.is_set():
            self._take_faults()
            self._serve()
            self._hand_on()
        for thread in threads:
            thread.join()

    def _draw(self, opener: Opener, stop: Event) -> None:
        """Feeds one source into the queue; a lost one is opened again, and until then a tracker's tool is not
        available.
        """
        tracks = False
        while not stop.is_set():
            with suppress(DeviceLost, ProtocolError), opener() as source:
                while not stop.is_set():
                    sample = source.read(_READ_S)
                    while sample is not None and not stop.is_set() and not self._queued(sample):
                        pass
                    if isinstance(sample, Pose):
                        tracks, self._tracker_is_lost = True, False
            self._tracker_is_lost = self._tracker_is_lost or tracks
            stop.wait(_PAUSE_S)

    def _queued(self, sample: Sample) -> bool:
        try:
            self._samples.put(sample, timeout=_READ_S)
        except queue.Full:
            return False
        return True

    def _take_faults(self) -> None:
        """Applies what faults do at their beginning and their end."""
        active = self.faults.active((self._clock.now_ns() - self._clock.origin_ns) / 1e9)
        begun, changed = active - self._active, active != self._active
        self._active = active
        if "clock-jump" in begun:
            self._utc_ns += _JUMP_NS
        if "reset" in begun:
            self._server.reset()
        if "complain" in begun:
            self._complain(Status(13, 0, "", "the simulated tracker warms up"))
        elif changed and "complain" not in active:
            self._complain(Status(OK))
        if "unplug" in active:
            self._server.unplug()
        else:
            self._server.listen()
        self._events.faults(active, self.faults.new_refusal())

    def _complain(self, status: Status) -> None:
        self._to_all(lambda client: self._message(client, "STATUS", "Tracker", status.content, self._clock.now_ns()))

    def _serve(self) -> None:
        """Serves connections, questions, and what still waits to be sent, until a sample waits."""
        wait_s = 0.0 if not self._samples.empty() else self._clock.real_s(_IDLE_S) / 10
        heard = () if "stall" in self._active else tuple(self._server.clients)
        for client in self._server.wait(wait_s, heard, lambda client: bool(client.unsent)):
            self._server.act(client, self._answer)

    def _answer(self, client: _Client) -> None:
        with suppress(BlockingIOError):
            for question in client.hear():
                well = Status(13, 0, "", "the simulated tracker warms up") if "complain" in self._active else Status(OK)
                client.put(self._message(client, "STATUS", question.device, well.content, self._clock.now_ns()))
        client.flush(_SEGMENT_BYTES if "split" in self._active else 1 << 20)

    def _hand_on(self) -> None:
        now_ns = self._clock.now_ns()
        if self._tracker_is_lost and now_ns - self._sent_ns > _SEND_EVERY_NS and not self._active & {"mute", "stall"}:
            self._sent_ns = now_ns
            self._send_pose(Pose(Stamp(now_ns, 0), 0, None, math.nan, PoseStatus.DISABLED, "the tracker is lost"))
        with suppress(queue.Empty):
            for _ in range(_WAITING):
                sample = self._samples.get_nowait()
                if self._active & {"mute", "stall"}:
                    continue
                if isinstance(sample, Frame):
                    self._show(sample)
                else:
                    self._send_pose(sample)

    def _show(self, frame: Frame) -> None:
        rows, columns = frame.image.shape
        content = Image((columns, rows, 1), frame.image.tobytes()).content
        self._to_all(lambda client: self._message(client, "IMAGE", IMAGE_NAME, content, frame.stamp.t_ns))

    def _send_pose(self, pose: Pose) -> None:
        if pose.matrix is not None and "repeat" not in self._active:
            self._last = pose.matrix, pose.stamp.t_ns
        if pose.matrix is None and "left-out" in self._active:
            return
        matrix, t_ns = self._last if "repeat" in self._active else (self._last[0], pose.stamp.t_ns)
        if pose.matrix is None and "identity" in self._active:
            matrix = np.eye(4)
        status = "" if "identity" in self._active else _STATUS_WORDS[pose.status]
        content = transform_content(matrix)
        self._to_all(lambda client: self._message(client, "TRANSFORM", PROBE_NAME, content, t_ns, status))
        if "witness-missing" not in self._active and pose.witness is not None:
            second = transform_content(spoil_witness(pose.witness, self._active))
            self._to_all(lambda client: self._message(client, "TRANSFORM", WITNESS_NAME, second, t_ns, "OK"))

    def _to_all(self, made: Callable[[_Client], bytes]) -> None:
        most_bytes = _SEGMENT_BYTES if "split" in self._active else 1 << 20
        self._server.act_for_all(lambda client: client.put(made(client)))
        self._server.act_for_all(lambda client: client.flush(most_bytes))

    def _message(self, client: _Client, kind: str, device: str, content: bytes, t_ns: int, tool: str = "") -> bytes:
        """Encodes a message for a client. t_ns: time by the host's clock, which goes out as UTC."""
        version = 1 if "old-header" in self._active else client.version
        utc = 0 if "untimed" in self._active else time_of(t_ns + self._utc_ns)
        self._number += 1
        metadata = (("TransformStatus", UTF_8, tool),) if tool and version > 1 else ()
        extended = (self._number % (1 << 32), metadata) if version > 1 else (0, ())
        data = bytearray(encode(Message(kind, device, content, utc, version, *extended)))
        if "bad-crc" in self._active:
            data[-1] ^= 1
        if "garbage" in self._active:
            data += self._random.bytes(64)
        return bytes(data)
