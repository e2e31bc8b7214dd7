"""Writes what the scanner twin sends into vivid's output node: `feed.py PORT NODE`, with the package's structures.

PORT is the virtio port that carries the sim: protocol from the host. While /run/cart-flip exists each picture is
mirrored left to right; while /run/cart-blank exists nothing is passed on. The last picture is repeated for no one:
vivid repeats it by itself.
"""

import fcntl
import mmap
import os
import select
import sys
from ctypes import c_int
from pathlib import Path

import numpy as np

sys.path.insert(0, next(str(path) for path in Path("/opt/probewatch/lib").glob("python3.*/site-packages")))
from drivers.sim import HEADER_BYTES, FrameHeader
from drivers.v4l2 import abi

BUF_TYPE_VIDEO_OUTPUT = 2
FLIP, BLANK = Path("/run/cart-flip"), Path("/run/cart-blank")


class OutputNode:
    """A V4L2 output, four mapped buffers."""

    def __init__(self, path: str) -> None:
        self.fd = os.open(path, os.O_RDWR | os.O_NONBLOCK)
        asked = abi.RequestBuffers(count=4, type=BUF_TYPE_VIDEO_OUTPUT, memory=abi.MEMORY_MMAP)
        fcntl.ioctl(self.fd, abi.REQBUFS, asked)
        self.maps, self.free, self.streaming = [], list(range(asked.count)), False
        for index in self.free:
            buffer = self._buffer(index)
            fcntl.ioctl(self.fd, abi.QUERYBUF, buffer)
            self.maps.append(mmap.mmap(self.fd, buffer.length, offset=buffer.offset))

    @staticmethod
    def _buffer(index: int) -> abi.Buffer:
        return abi.Buffer(index=index, type=BUF_TYPE_VIDEO_OUTPUT, memory=abi.MEMORY_MMAP, field=abi.FIELD_NONE)

    def write(self, data: bytes) -> None:
        """Queue one picture; waits for a free buffer."""
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


class Line:
    """The port's bytes as frames. After the far end has hung up in the middle of one, the next is found again."""

    def __init__(self, path: str) -> None:
        self.fd, self.data = os.open(path, os.O_RDONLY), bytearray()

    def frame(self) -> tuple[FrameHeader, bytes]:
        while True:
            if not self.fill(HEADER_BYTES):
                continue
            at = self.data.find(b"PWSV")
            del self.data[: at if at >= 0 else len(self.data) - 3]
            if at == 0:
                header = FrameHeader.parse(bytes(self.data[:HEADER_BYTES]))
                end = HEADER_BYTES + header.body_bytes
                if not self.fill(end):
                    continue
                body = bytes(self.data[HEADER_BYTES:end])
                del self.data[:end]
                return header, body

    def fill(self, count: int) -> bool:
        """False when the other end hung up: a port without it reads as empty, and half a frame is of no use."""
        while len(self.data) < count:
            more = os.read(self.fd, 1 << 17)
            if not more:
                self.data.clear()
                select.select([], [], [], 0.05)
                return False
            self.data += more
        return True


def main(port: str, node: str) -> None:
    line, output = Line(port), OutputNode(node)
    while True:
        header, body = line.frame()
        if BLANK.exists():
            continue
        if FLIP.exists():
            body = np.frombuffer(body, np.uint8).reshape(header.height_px, header.width_px)[:, ::-1].tobytes()
        output.write(body)


if __name__ == "__main__":
    main(*sys.argv[1:])
