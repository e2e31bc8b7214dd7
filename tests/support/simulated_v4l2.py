"""A capture driver that exists only as answers to requests, below drivers.video.v4l2.node."""

import errno
import mmap
import os
import time
from collections import deque
from collections.abc import Callable
from ctypes import Structure, c_int

import numpy as np

from probewatch.drivers.video.v4l2 import abi

_BYTES_A_PIXEL = {"YUYV": 2, "UYVY": 2, "RGB3": 3, "BGR3": 3, "MJPG": 0}
FLAGS = abi.BUF_FLAG_TIMESTAMP_MONOTONIC | abi.BUF_FLAG_TSTAMP_SRC_SOE


class Driver:
    """send() fills a queued buffer. formats, size_px, rate_hz, field, status, timings: what it answers; rates_hz: of
    formats that come less or more often. refuse: request → errno. asked: every request in order.
    """

    def __init__(self) -> None:
        self.formats, self.size_px, self.rate_hz = ["YUYV", "GREY"], (64, 48), 25.0
        self.rates_hz: dict[str, float] = {}
        self.field = abi.FIELD_NONE
        self.status, self.capabilities = 0, abi.CAP_VIDEO_CAPTURE | abi.CAP_STREAMING
        self.timings: abi.DvTimings | None = None
        self.current_timings = abi.DvTimings()
        self.refuse: dict[int, int] = {}
        self.asked: list[int] = []
        self.format = "YUYV"
        self.queued: deque[int] = deque()
        self.filled: deque[abi.Buffer] = deque()
        self.sequence = 0
        self.fd = os.memfd_create("v4l2")
        os.ftruncate(self.fd, 8 * self.room)
        self.memory = mmap.mmap(self.fd, 8 * self.room)

    room = 1 << 16

    def close(self) -> None:
        self.memory.close()

    def send(self, data: bytes, flags: int = FLAGS, skip: int = 0, t_ns: int | None = None) -> None:
        """One picture, after `skip` that nobody got."""
        index = self.queued.popleft()
        self.memory[index * self.room : index * self.room + len(data)] = data
        stamp_us = (time.monotonic_ns() if t_ns is None else t_ns) // 1000
        self.sequence += 1 + skip
        self.filled.append(
            abi.Buffer(
                index=index,
                bytesused=len(data),
                flags=flags,
                sequence=self.sequence,
                timestamp_s=stamp_us // 1_000_000,
                timestamp_us=stamp_us % 1_000_000,
            )
        )

    def ioctl(self, fd: int, request: int, argument: "Structure | c_int") -> None:
        self.asked.append(request)
        if request in self.refuse:
            raise OSError(self.refuse[request], os.strerror(self.refuse[request]))
        _ANSWERS.get(request, lambda driver, argument: None)(self, argument)


def _capability(driver: Driver, argument: abi.Capability) -> None:
    argument.card[:5] = b"Bench"
    argument.capabilities = driver.capabilities


def _enum_format(driver: Driver, argument: abi.FmtDesc) -> None:
    if argument.index >= len(driver.formats):
        raise OSError(errno.EINVAL, "")
    argument.pixelformat = abi.fourcc(driver.formats[argument.index])


def _set_format(driver: Driver, argument: abi.Format) -> None:
    asked = abi.fourcc_text(argument.pix.pixelformat)
    driver.format = asked if asked in driver.formats else driver.formats[0]
    argument.pix.pixelformat = abi.fourcc(driver.format)
    argument.pix.width, argument.pix.height = driver.size_px
    argument.pix.field = driver.field
    argument.pix.bytesperline = driver.size_px[0] * _BYTES_A_PIXEL.get(driver.format, 1)


def _rate(driver: Driver, argument: abi.StreamParm) -> None:
    argument.capability = abi.CAP_TIMEPERFRAME
    argument.numerator, argument.denominator = 1000, round(driver.rates_hz.get(driver.format, driver.rate_hz) * 1000)


def _input(driver: Driver, argument: abi.Input) -> None:
    argument.status = driver.status
    argument.capabilities = abi.IN_CAP_DV_TIMINGS if driver.timings is not None else 0


def _query_timings(driver: Driver, argument: abi.DvTimings) -> None:
    assert driver.timings is not None
    argument.width, argument.height = driver.timings.width, driver.timings.height
    argument.pixelclock = driver.timings.pixelclock


def _current_timings(driver: Driver, argument: abi.DvTimings) -> None:
    argument.width, argument.height = driver.current_timings.width, driver.current_timings.height
    argument.pixelclock = driver.current_timings.pixelclock


def _set_timings(driver: Driver, argument: abi.DvTimings) -> None:
    driver.current_timings = abi.DvTimings.from_buffer_copy(argument)


def _buffers(driver: Driver, argument: abi.RequestBuffers) -> None:
    driver.queued.clear()


def _describe_buffer(driver: Driver, argument: abi.Buffer) -> None:
    argument.length, argument.offset = driver.room, argument.index * driver.room


def _queue(driver: Driver, argument: abi.Buffer) -> None:
    driver.queued.append(argument.index)


def _dequeue(driver: Driver, argument: abi.Buffer) -> None:
    if not driver.filled:
        raise BlockingIOError(errno.EAGAIN, "")
    filled = driver.filled.popleft()
    for name in ("index", "bytesused", "flags", "sequence", "timestamp_s", "timestamp_us"):
        setattr(argument, name, getattr(filled, name))


_ANSWERS: dict[int, Callable[..., None]] = {
    abi.QUERYCAP: _capability,
    abi.ENUM_FMT: _enum_format,
    abi.S_FMT: _set_format,
    abi.G_PARM: _rate,
    abi.S_PARM: _rate,
    abi.ENUMINPUT: _input,
    abi.QUERY_DV_TIMINGS: _query_timings,
    abi.G_DV_TIMINGS: _current_timings,
    abi.S_DV_TIMINGS: _set_timings,
    abi.REQBUFS: _buffers,
    abi.QUERYBUF: _describe_buffer,
    abi.QBUF: _queue,
    abi.DQBUF: _dequeue,
}


def noise(width: int = 64, height: int = 48, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width), np.uint8)
