"""vivid's output node, written to by its four mapped buffers."""

import fcntl
import mmap
import os
import select
from ctypes import c_int

from probewatch.drivers.video.v4l2 import abi

BUF_TYPE_VIDEO_OUTPUT = 2


class OutputNode:
    """The size and format are those that are set already."""

    def __init__(self, path: str) -> None:
        self.fd = os.open(path, os.O_RDWR | os.O_NONBLOCK)
        asked = abi.RequestBuffers(count=4, type=BUF_TYPE_VIDEO_OUTPUT, memory=abi.MEMORY_MMAP)
        fcntl.ioctl(self.fd, abi.REQBUFS, asked)
        self.maps: list[mmap.mmap] = []
        self.free, self.streaming = list(range(asked.count)), False
        for index in self.free:
            buffer = self._buffer(index)
            fcntl.ioctl(self.fd, abi.QUERYBUF, buffer)
            self.maps.append(mmap.mmap(self.fd, buffer.length, offset=buffer.offset))

    def close(self) -> None:
        """vivid is plugged in again when the last of its users has closed it."""
        for memory in self.maps:
            memory.close()
        os.close(self.fd)

    @staticmethod
    def _buffer(index: int) -> abi.Buffer:
        return abi.Buffer(index=index, type=BUF_TYPE_VIDEO_OUTPUT, memory=abi.MEMORY_MMAP, field=abi.FIELD_NONE)

    def write(self, data: bytes | memoryview) -> None:
        """Queue one picture; waits for a free buffer."""
        data = memoryview(data).cast("B")
        while not self.free:
            select.select([], [self.fd], [])
            done = self._buffer(0)
            try:
                fcntl.ioctl(self.fd, abi.DQBUF, done)
            except BlockingIOError:
                continue
            self.free.append(done.index)
        index = self.free.pop(0)
        self.maps[index][: len(data)] = data
        buffer = self._buffer(index)
        buffer.bytesused = len(data)
        fcntl.ioctl(self.fd, abi.QBUF, buffer)
        if not self.streaming:
            fcntl.ioctl(self.fd, abi.STREAMON, c_int(BUF_TYPE_VIDEO_OUTPUT))
            self.streaming = True
