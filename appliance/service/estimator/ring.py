"""Passes samples through a ring in shared memory: one producer, one consumer; a full ring drops the OLDEST sample.

A sample lies in a memfd, and a notice of it goes through a pipe once the sample is whole. The pipe wakes the consumer,
and its lock orders the two processes' view of the memory on any processor. A producer that dies while it writes a
sample has given no notice of it. Neither end ever waits: when the pipe is full because nobody reads it, the producer
empties it.

The consumer copies a sample out and then reads the pipe again: the copy counts if the sample is still among the newest
`slots`. The memory has room for two more, so that another whole sample, with its notice, lies between the notice that
ends a copy's validity and the first byte written over it. Both objects are anonymous: nothing is left behind however
either side dies.
"""

import fcntl
import mmap
import os
import struct
import termios
from contextlib import suppress
from dataclasses import dataclass
from io import FileIO
from typing import NamedTuple

import numpy as np

from probewatch.drivers.closable import Closable
from probewatch.drivers.samples import Frame, Matrix4, Pose, PoseStatus, Sample, Stamp

_SPARE_SLOTS = 2
"""Slots that the consumer may not use: one that is being written, and one between it and the others; see the docstring
of this module.
"""
_NOTICE = struct.Struct("<QQ")
"""Number of a sample and bytes of its payload. A notice is far below PIPE_BUF, so that it is written whole or not at
all; its 16 bytes divide every size of a pipe.
"""
_READ_BYTES = 4096
"""Bytes requested in one read: 256 notices, of which one is usual. Less takes more calls after the consumer was away;
more costs memory at every read.
"""
_FRAME = struct.Struct("<cqqqII31x")
"""Header of a frame: 64 bytes, a cache line, so that the pixels begin at one."""
_POSE = struct.Struct("<cqqqdBB32d")
_STATUSES = tuple(PoseStatus)
_LONGEST_REASON = 200
"""Bytes of UTF-8; the rest of a longer reason is truncated. A reason is for people to read, and takes this room in
every slot.
"""


@dataclass(frozen=True, slots=True)
class Shape:
    """Describes the size of a ring. slots: samples that the ring holds. payload_bytes: the largest sample it takes."""

    slots: int
    payload_bytes: int

    @property
    def stride(self) -> int:
        """Returns the bytes from one sample to the next: whole cache lines."""
        return -(-self.payload_bytes // 64) * 64

    def start(self, index: int) -> int:
        """Returns the byte at which sample number `index` begins."""
        return index % (self.slots + _SPARE_SLOTS) * self.stride

    @property
    def size(self) -> int:
        """Returns the bytes of the memory."""
        return (self.slots + _SPARE_SLOTS) * self.stride


FRAMES = Shape(slots=16, payload_bytes=_FRAME.size + 2560 * 1600)
"""Shape of the ring of pictures. Untouched pages of a memfd take no memory, so small pictures cost what they fill."""
POSES = Shape(slots=256, payload_bytes=_POSE.size + _LONGEST_REASON)
"""Shape of the ring of poses. Both rings hold half a second: 16 pictures at 30 Hz, 256 poses at 500 Hz. An estimator
that is behind by more loses the oldest samples, which are counted; more slots would have it judge old ones.
"""


class RingFds(NamedTuple):
    """Holds what the peer needs: the memory, and both ends of the pipe."""

    memory: int
    reading: int
    writing: int


class _Notice(NamedTuple):
    number: int
    payload_bytes: int


class Ring(Closable):
    """Represents either end of the ring. The producer calls put, the consumer the rest. Give the peer `fds` and the
    same shape.

    A new consumer may follow a dead one on the same ring; the producer stays the same.
    """

    def __init__(self, shape: Shape, fds: RingFds | None = None) -> None:
        """Raises OSError, and then leaves open nothing that it has made."""
        self._shape = shape
        self.fds = _made(shape) if fds is None else fds
        try:
            self._memory = mmap.mmap(self.fds.memory, shape.size)
        except OSError:
            for fd in self.fds if fds is None else ():
                os.close(fd)
            raise
        self._reading = FileIO(self.fds.reading, "r")
        self._writing = FileIO(self.fds.writing, "w")
        self._written = 0
        self._notices: list[_Notice] = []
        self._next: int | None = None

    def close(self) -> None:
        """Releases the memory and the pipe; they are freed when the peer has gone too."""
        if not self._writing.closed:
            with suppress(BufferError):  # an abandoned thread is still in put; the memory goes with it
                self._memory.close()
            self._reading.close()
            self._writing.close()
            os.close(self.fds.memory)

    def fileno(self) -> int:
        """Returns the descriptor for poll: readable when a sample has been put."""
        return self.fds.reading

    @property
    def pending(self) -> bool:
        """Returns whether take() would return something that fileno() no longer signals."""
        return bool(self._notices)

    @property
    def backlog(self) -> int:
        """Returns the number of samples whose notices the consumer has not read yet; for the producer's side."""
        waiting = fcntl.ioctl(self._reading, termios.FIONREAD, bytes(4))
        return int.from_bytes(waiting, "little") // _NOTICE.size

    def put(self, sample: Sample) -> None:
        """Puts a sample; never blocks. Raises ValueError for a sample larger than a slot."""
        size = _size(sample)
        if size > self._shape.payload_bytes:
            raise ValueError(f"a sample of {size} bytes does not fit a slot of {self._shape.payload_bytes}")
        _pack_into(self._memory, self._shape.start(self._written), sample)
        self._notify(_NOTICE.pack(self._written, size))
        self._written += 1

    def take(self) -> tuple[list[Sample], int]:
        """Returns (samples in order, number of samples dropped before or between them). Never blocks."""
        self._listen()
        notices, self._notices = self._notices, []
        if not notices:
            return [], 0
        copies = [(notice.number, self._copy(notice)) for notice in notices[-self._shape.slots :]]
        self._listen()
        newest = (self._notices or notices)[-1].number
        samples = [_unpack(copy) for index, copy in copies if newest - index < self._shape.slots]
        first = notices[0].number if self._next is None else self._next
        self._next = notices[-1].number + 1
        return samples, self._next - first - len(samples)

    def discard(self) -> None:
        """Discards, uncounted, what has been put until now."""
        self._listen()
        if self._notices:
            self._next = self._notices[-1].number + 1
            self._notices = []

    def _notify(self, notice: bytes) -> None:
        if self._writing.write(notice) is None:
            while self._reading.read(_READ_BYTES):
                pass
            self._writing.write(notice)

    def _listen(self) -> None:
        while heard := self._reading.read(_READ_BYTES):
            self._notices += (_Notice(*numbers) for numbers in _NOTICE.iter_unpack(heard))

    def _copy(self, notice: _Notice) -> bytes:
        start = self._shape.start(notice.number)
        return self._memory[start : start + notice.payload_bytes]


def _made(shape: Shape) -> RingFds:
    """Makes the memory and the pipe. Raises OSError, and then leaves nothing open."""
    memory = os.memfd_create("probewatch-ring")
    try:
        os.ftruncate(memory, shape.size)
        return RingFds(memory, *os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC))
    except OSError:
        os.close(memory)
        raise


def _size(sample: Sample) -> int:
    if isinstance(sample, Frame):
        return _FRAME.size + sample.image.size
    return _POSE.size + len(_reason(sample))


def _reason(pose: Pose) -> bytes:
    return pose.reason.encode()[:_LONGEST_REASON]


def _pack_into(memory: mmap.mmap, start: int, sample: Sample) -> None:
    stamp = sample.stamp
    if isinstance(sample, Frame):
        height, width = sample.image.shape
        _FRAME.pack_into(memory, start, b"F", stamp.t_ns, stamp.err_ns, sample.sequence, width, height)
        pixels = np.frombuffer(memory, np.uint8, width * height, start + _FRAME.size)
        pixels.reshape(height, width)[:] = sample.image
        return
    status, reason = _STATUSES.index(sample.status), _reason(sample)
    kinds = status, sample.witness is not None
    numbers = [*_sixteen(sample.matrix), *_sixteen(sample.witness)]
    _POSE.pack_into(memory, start, b"P", stamp.t_ns, stamp.err_ns, sample.sequence, sample.rms_mm, *kinds, *numbers)
    memory[start + _POSE.size : start + _POSE.size + len(reason)] = reason


def _sixteen(matrix: Matrix4 | None) -> list[float]:
    return [0.0] * 16 if matrix is None else matrix.ravel().tolist()


def _unpack(payload: bytes) -> Sample:
    if payload[:1] == b"F":
        _, t_ns, err_ns, sequence, width, height = _FRAME.unpack_from(payload)
        pixels = np.frombuffer(payload, np.uint8, width * height, _FRAME.size)
        return Frame(Stamp(t_ns, err_ns), sequence, pixels.reshape(height, width))
    _, t_ns, err_ns, sequence, rms_mm, status, witnessed, *numbers = _POSE.unpack_from(payload)
    matrices = np.array(numbers).reshape(2, 4, 4)
    matrix = matrices[0] if _STATUSES[status] is PoseStatus.OK else None
    witness = matrices[1] if witnessed else None
    reason = payload[_POSE.size :].decode(errors="replace")
    return Pose(Stamp(t_ns, err_ns), sequence, matrix, rms_mm, _STATUSES[status], reason, witness)
