"""Runs a capture: mapped buffers, waiting with a deadline, events of the signal."""

import errno
import mmap
import select
import time
from collections.abc import Callable
from contextlib import suppress
from ctypes import c_int
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.video.v4l2 import abi
from probewatch.drivers.video.v4l2.negotiation import current_input, require_signal
from probewatch.drivers.video.v4l2.node import Node

_BUFFERS, _LEAST_BUFFERS = 4, 2
"""Buffers that are requested, and that suffice: one to be filled while another is read. Each more lets this host be
away for one picture longer (four: 0.1 s at 30 Hz), takes memory, and then passes on an older picture.
"""


_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Filled:
    """Holds the content of one buffer. See abi.Buffer for the numbers; arrival_ns: CLOCK_MONOTONIC of its dequeuing.

    data: (n,) uint8, the buffer itself: the driver overwrites it as soon as it has the buffer back.
    """

    flags: int
    sequence: int
    t_ns: int
    arrival_ns: int
    data: NDArray[np.uint8]


class Stream:
    """Holds a running stream. Leaving the context stops it and frees its buffers. Raises DeviceLost."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._maps: list[mmap.mmap] = []
        self._poll = select.poll()
        self._poll.register(node.fd, select.POLLIN | select.POLLPRI)
        try:
            self._start()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Closes the stream, also after the device has gone: a refusal no longer matters."""
        with suppress(OSError):
            self._node.ask(abi.STREAMOFF, c_int(abi.BUF_TYPE_VIDEO_CAPTURE))
        for one in self._maps:
            with suppress(BufferError):  # an error being raised still refers to the picture; it is freed with the error
                one.close()
        with suppress(OSError):
            self._node.ask(abi.REQBUFS, _request_buffers(0))

    def take(self, timeout_s: float, use: Callable[[Filled], _T | None]) -> _T | None:
        """Returns the first result other than None of `use` on the next buffers; None when there was none within
        timeout_s.

        `use` must keep nothing of the buffer: the driver gets it back afterwards. Raises DeviceLost, also when the
        signal changes.
        """
        end_s = time.monotonic() + timeout_s
        while True:
            ready = self._poll.poll(max(0.0, end_s - time.monotonic()) * 1e3)
            if not ready:
                return None
            self._look_at(ready[0][1])
            made = self._use_next(use)
            if made is not None or time.monotonic() >= end_s:
                return made

    def _start(self) -> None:
        source = abi.EventSubscription(type=abi.EVENT_SOURCE_CHANGE, id=current_input(self._node))
        for subscription in (source, abi.EventSubscription(type=abi.EVENT_EOS)):
            self._node.allows(abi.SUBSCRIBE_EVENT, subscription)
        wanted = _request_buffers(_BUFFERS)
        self._node.must(abi.REQBUFS, wanted, "gives no buffers")
        if wanted.count < _LEAST_BUFFERS:
            raise DeviceLost("gives too few buffers", self._node.where, "Plug the grabber in again")
        for index in range(wanted.count):
            buffer = _buffer(index)
            self._node.must(abi.QUERYBUF, buffer, "does not describe its buffers")
            self._maps.append(mmap.mmap(self._node.fd, buffer.length, offset=buffer.offset))
            self._node.must(abi.QBUF, _buffer(index), "does not take its buffers")
        self._node.must(abi.STREAMON, c_int(abi.BUF_TYPE_VIDEO_CAPTURE), "does not start to stream")

    def _look_at(self, happened: int) -> None:
        if happened & select.POLLPRI:
            self._hear_event()
        if happened & (select.POLLERR | select.POLLHUP | select.POLLNVAL) and not happened & select.POLLIN:
            number = errno.ENODEV if happened & (select.POLLHUP | select.POLLNVAL) else errno.EIO
            self._require_present(number)

    def _hear_event(self) -> None:
        event = abi.Event()
        if not self._node.allows(abi.DQEVENT, event):
            return
        if event.type == abi.EVENT_SOURCE_CHANGE:
            require_signal(self._node)
            remedy = "If it goes on, check the cable from the scanner"
            raise DeviceLost("the video signal was interrupted", self._node.where, remedy)
        if event.type == abi.EVENT_EOS:
            raise DeviceLost("the video stream has ended", self._node.where, "Check that the scanner is switched on")

    def _require_present(self, number: int) -> None:
        """Raises DeviceLost for an error without a buffer: unplugged, or broken until the device is reopened."""
        self._node.must(abi.QUERYCAP, abi.Capability(), "does not answer")
        raise self._node.lost(OSError(number, "broken off"), "stream broken off")

    def _use_next(self, use: Callable[[Filled], _T | None]) -> _T | None:
        buffer = _buffer(0)
        try:
            self._node.ask(abi.DQBUF, buffer)
        except BlockingIOError:
            return None
        except OSError as error:
            raise self._node.lost(error, "hands out no picture") from error
        arrival_ns = time.monotonic_ns()
        numbers = (buffer.flags, buffer.sequence, buffer.t_ns, arrival_ns)
        made = use(Filled(*numbers, np.frombuffer(self._maps[buffer.index], np.uint8)[: buffer.bytesused]))
        self._node.must(abi.QBUF, _buffer(buffer.index), "does not take a buffer back")
        return made


def _buffer(index: int) -> abi.Buffer:
    return abi.Buffer(index=index, type=abi.BUF_TYPE_VIDEO_CAPTURE, memory=abi.MEMORY_MMAP)


def _request_buffers(count: int) -> abi.RequestBuffers:
    return abi.RequestBuffers(count=count, type=abi.BUF_TYPE_VIDEO_CAPTURE, memory=abi.MEMORY_MMAP)
