"""A ring of samples in anonymous shared memory: one producer, one consumer, the OLDEST is dropped when it is full.

The memory is a memfd: it has no name, so nothing is left behind however either side dies. The producer never waits. The
consumer copies a slot out and keeps it only if the checksum, which covers the slot's index, agrees: a slot that was
overwritten meanwhile counts as dropped, on any processor's memory order.
"""

import mmap
import os
import struct
import zlib
from dataclasses import dataclass
from typing import Self

import numpy as np

from drivers.samples import Frame, Pose, PoseStatus, Sample, Stamp

_HEAD_BYTES = 64
"""A cache line, so that counting does not disturb the first slot."""
_WRITTEN, _READ = 0, 1
"""The two counters of the head: samples put by the producer; samples taken or dropped by the consumer."""
_SLOT = struct.Struct("<QII")
"""Index of the sample, bytes of its payload, CRC-32 of both."""
_FRAME = struct.Struct("<cqqqII")
_POSE = struct.Struct("<cqqqdB16d")
_STATUSES = tuple(PoseStatus)
_LONGEST_REASON = 200
"""Bytes of UTF-8; the rest of a longer reason is cut. It is for a person to read, and every slot takes as much."""


@dataclass(frozen=True, slots=True)
class Shape:
    """slots: how many samples the ring holds. payload_bytes: the largest sample it takes."""

    slots: int
    payload_bytes: int

    @property
    def stride(self) -> int:
        return -(-(_SLOT.size + self.payload_bytes) // 64) * 64

    @property
    def size(self) -> int:
        return _HEAD_BYTES + self.slots * self.stride


FRAMES = Shape(slots=16, payload_bytes=_FRAME.size + 2560 * 1600)
"""Untouched pages of a memfd take no memory, so small pictures pay only for what they fill."""
POSES = Shape(slots=256, payload_bytes=_POSE.size + _LONGEST_REASON)
"""Both hold half a second: 16 pictures at 30 Hz, 256 poses at 500 Hz. An estimator that is behind by more loses the
oldest, counted; more slots would have it judge what is old.
"""


class Ring:
    """Both ends of the ring; the producer calls put, the consumer take. Give the peer `fd` and the same shape."""

    def __init__(self, shape: Shape, fd: int | None = None) -> None:
        self._shape = shape
        self.fd = os.memfd_create("probewatch-ring") if fd is None else fd
        if fd is None:
            os.ftruncate(self.fd, shape.size)
        self._memory = mmap.mmap(self.fd, shape.size)
        self._counters = memoryview(self._memory)[:16].cast("Q")
        """A cast view stores eight bytes in one piece; struct.pack_into clears them first, which the peer would see."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the memory; it is freed when the peer has gone too."""
        if not self._memory.closed:
            self._counters.release()
            self._memory.close()
            os.close(self.fd)

    @property
    def written(self) -> int:
        """Samples put since the ring was made."""
        return self._counters[_WRITTEN]

    @property
    def backlog(self) -> int:
        """Samples put and neither taken nor dropped yet."""
        return self._counters[_WRITTEN] - self._counters[_READ]

    def put(self, sample: Sample) -> None:
        """Never blocks. Raises ValueError for a sample larger than a slot."""
        payload = _pack(sample)
        size = sum(len(part) for part in payload)
        if size > self._shape.payload_bytes:
            raise ValueError(f"a sample of {size} bytes does not fit a slot of {self._shape.payload_bytes}")
        index = self.written
        start = _HEAD_BYTES + (index % self._shape.slots) * self._shape.stride
        at = start + _SLOT.size
        checksum = zlib.crc32(index.to_bytes(8, "little"))
        for part in payload:
            self._memory[at : at + len(part)] = part
            checksum = zlib.crc32(part, checksum)
            at += len(part)
        _SLOT.pack_into(self._memory, start, index, size, checksum)
        self._counters[_WRITTEN] = index + 1

    def take(self) -> tuple[list[Sample], int]:
        """(samples in order, how many were dropped before or between them). Never blocks."""
        written, read = self._counters[_WRITTEN], self._counters[_READ]
        first = max(read, written - self._shape.slots)
        payloads = [self._copy(index) for index in range(first, written)]
        self._counters[_READ] = written
        samples = [_unpack(payload) for payload in payloads if payload is not None]
        return samples, written - read - len(samples)

    def _copy(self, index: int) -> bytes | None:
        start = _HEAD_BYTES + (index % self._shape.slots) * self._shape.stride
        found, size, checksum = _SLOT.unpack_from(self._memory, start)
        if found != index or size > self._shape.payload_bytes:
            return None
        payload = self._memory[start + _SLOT.size : start + _SLOT.size + size]
        whole = zlib.crc32(payload, zlib.crc32(index.to_bytes(8, "little"))) == checksum
        return payload if whole else None


def _pack(sample: Sample) -> tuple[bytes, ...]:
    stamp = sample.stamp
    if isinstance(sample, Frame):
        height, width = sample.image.shape
        head = _FRAME.pack(b"F", stamp.t_ns, stamp.err_ns, sample.sequence, width, height)
        return head, np.ascontiguousarray(sample.image, np.uint8).tobytes()
    numbers = [0.0] * 16 if sample.matrix is None else sample.matrix.ravel().tolist()
    status = _STATUSES.index(sample.status)
    head = _POSE.pack(b"P", stamp.t_ns, stamp.err_ns, sample.sequence, sample.rms_mm, status, *numbers)
    return head, sample.reason.encode()[:_LONGEST_REASON]


def _unpack(payload: bytes) -> Sample:
    if payload[:1] == b"F":
        _, t_ns, err_ns, sequence, width, height = _FRAME.unpack_from(payload)
        pixels = np.frombuffer(payload, np.uint8, width * height, _FRAME.size)
        return Frame(Stamp(t_ns, err_ns), sequence, pixels.reshape(height, width))
    _, t_ns, err_ns, sequence, rms_mm, status, *numbers = _POSE.unpack_from(payload)
    matrix = np.array(numbers).reshape(4, 4) if _STATUSES[status] is PoseStatus.OK else None
    reason = payload[_POSE.size :].decode(errors="replace")
    return Pose(Stamp(t_ns, err_ns), sequence, matrix, rms_mm, _STATUSES[status], reason)
