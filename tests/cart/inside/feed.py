"""Writes what the scanner twin sends into vivid's output node: `feed.py PORT NODE [WIDTH HEIGHT LEFT TOP SHRUNK]`.

PORT is the virtio port that carries the sim: protocol from the host. With WIDTH and HEIGHT of the whole screen the
picture stands at LEFT, TOP of a grey one, with SHRUNK × SHRUNK pixels averaged to one. While /run/cart-flip exists each
picture is mirrored left to right; while /run/cart-blank exists nothing is passed on. The last picture is repeated for
no one: vivid repeats it by itself.
"""

import os
import select
import sys
import time
from pathlib import Path

import cv2
import numpy as np
from output_node import OutputNode

from probewatch.drivers.video.sim import HEADER_BYTES, FrameHeader

FLIP, BLANK = Path("/run/cart-flip"), Path("/run/cart-blank")


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


class Screen:
    """The whole output of the scanner: the picture alone, or in its place on grey."""

    def __init__(self, width: int = 0, height: int = 0, left: int = 0, top: int = 0, shrunk: int = 1) -> None:
        self.grey = np.full((height, width), 40, np.uint8)
        self.left, self.top, self.scale = left, top, 1 / shrunk

    def show(self, picture: np.ndarray) -> np.ndarray:
        if not self.grey.size:
            return picture
        picture = cv2.resize(picture, None, fx=self.scale, fy=self.scale, interpolation=cv2.INTER_AREA)
        height, width = picture.shape
        self.grey[self.top : self.top + height, self.left : self.left + width] = picture
        return self.grey


def main(port: str, node: str, *place: str) -> None:
    line, output, screen = Line(port), OutputNode(node), Screen(*map(int, place))
    while True:
        header, body = line.frame()
        if BLANK.exists():
            continue
        picture = np.frombuffer(body, np.uint8).reshape(header.height_px, header.width_px)
        if FLIP.exists():
            picture = picture[:, ::-1]
        try:
            output.write(np.ascontiguousarray(screen.show(picture)).data)
        except OSError:
            output.close()
            output = reopened(node)


def reopened(node: str) -> OutputNode:
    """Disconnected, every node of vivid is gone until all of them are closed, the service's too."""
    while True:
        try:
            return OutputNode(node)
        except OSError:
            time.sleep(0.2)


if __name__ == "__main__":
    main(*sys.argv[1:])
