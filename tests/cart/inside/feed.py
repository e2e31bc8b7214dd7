"""Writes what the scanner twin sends into vivid's output node: `feed.py PORT NODE [WIDTH HEIGHT LEFT TOP SHRUNK]`.

PORT is the virtio port that carries the sim: protocol from the host. With WIDTH and HEIGHT of the whole screen the
picture stands at LEFT, TOP of a grey one, with SHRUNK × SHRUNK pixels averaged to one. While /run/cart-flip exists each
picture is mirrored left to right; while /run/cart-blank exists nothing is passed on. The last picture is repeated for
no one: vivid repeats it by itself.
"""

import os
import select
import sys
from pathlib import Path

import cv2
import numpy as np
from output_node import OutputNode

from drivers.sim import HEADER_BYTES, FrameHeader

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


def shown(picture: np.ndarray, screen: tuple[int, ...]) -> np.ndarray:
    """The picture alone, or in its place on the screen."""
    if not screen:
        return picture
    width, height, left, top, shrunk = screen
    picture = cv2.resize(picture, None, fx=1 / shrunk, fy=1 / shrunk, interpolation=cv2.INTER_AREA)
    whole = np.full((height, width), 40, np.uint8)
    whole[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return whole


def main(port: str, node: str, *screen: str) -> None:
    line, output = Line(port), OutputNode(node)
    while True:
        header, body = line.frame()
        if BLANK.exists():
            continue
        picture = np.frombuffer(body, np.uint8).reshape(header.height_px, header.width_px)
        if FLIP.exists():
            picture = picture[:, ::-1]
        output.write(shown(picture, tuple(map(int, screen))).tobytes())


if __name__ == "__main__":
    main(*sys.argv[1:])
