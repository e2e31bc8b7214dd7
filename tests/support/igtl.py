"""OpenIGTLink for tests: vectors of the reference library, mutations of them, a server that says what it is told."""

import json
import random
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from probewatch.drivers.openigtlink.content import transform_content
from probewatch.drivers.openigtlink.image import Image
from probewatch.drivers.openigtlink.message import HEADER_BYTES, Header, Message, encode, parse_header, time_of
from probewatch.drivers.samples import Matrix4

_FILE = Path(__file__).parents[1] / "data" / "openigtlink-vectors.json"
UTC_NS = 1_700_000_000_000_000_000


def vectors(*types: str) -> list[Any]:
    """Good vectors of these types, or all of them, as parameters of a test."""
    every = json.loads(_FILE.read_text())["vectors"]
    found = [pytest.param(one, id=one["name"]) for one in every if not types or one["type"] in types]
    assert found, f"{_FILE.name} has no vector of {' or '.join(types)}"
    return found


def damaged() -> list[Any]:
    """Vectors that are to be refused."""
    return [pytest.param(one, id=one["name"]) for one in json.loads(_FILE.read_text())["damaged"]]


def good_bytes() -> list[bytes]:
    return [bytes.fromhex(one["hex"]) for one in json.loads(_FILE.read_text())["vectors"]]


def mutants(seed: int) -> Iterator[bytes]:
    """Good messages with bytes changed, cut out, doubled or put elsewhere; half of them get a check sum that fits."""
    chance, good = random.Random(seed), good_bytes()
    while True:
        data = bytearray(chance.choice(good))
        for _ in range(chance.choice((1, 1, 2, 5))):
            _spoil(data, chance, good)
        yield _mended(bytes(data)) if chance.random() < 0.5 else bytes(data)


def _spoil(data: bytearray, chance: random.Random, good: list[bytes]) -> None:
    place = chance.randrange(len(data) + 1)
    match chance.randrange(6):
        case 0 if place < len(data):
            data[place] ^= 1 << chance.randrange(8)
        case 1 if place < len(data):
            data[place] = chance.choice((0, 1, 0x7F, 0x80, 0xFF))
        case 2:
            del data[place : place + chance.randrange(1, 40)]
        case 3:
            data[place:place] = chance.randbytes(chance.randrange(1, 40))
        case 4:
            data[place : place + 8] = chance.choice((b"\xff" * 8, b"\0" * 8, (1 << 40).to_bytes(8, "big")))
        case 5:
            other = chance.choice(good)
            data[place:place] = other[: chance.randrange(len(other))]


def _mended(data: bytes) -> bytes:
    """The same with a size and a check sum that fit what follows the header."""
    if len(data) < HEADER_BYTES:
        return data
    body = data[HEADER_BYTES:]
    crc = encode(Message("X", "", body))[50:HEADER_BYTES]
    return data[:42] + len(body).to_bytes(8, "big") + crc + body


def header_of(data: bytes) -> Header:
    return parse_header(data[:HEADER_BYTES])


def transform(name: str, matrix: Matrix4, t_ns: int, **more: Any) -> bytes:
    """A TRANSFORM; t_ns counts from UTC_NS, None for a sender that tells no time."""
    return encode(Message("TRANSFORM", name, transform_content(matrix), time_of(UTC_NS + t_ns), **more))


def picture(name: str, pixels: np.ndarray, t_ns: int, **more: Any) -> bytes:
    """An IMAGE of (rows, columns) or (rows, columns, components) uint8, or what `more` says of the pixels."""
    rows, columns, components = (*pixels.shape, 1)[:3]
    image = Image((columns, rows, 1), pixels.tobytes(), components=components, part=(columns, rows, 1), **more)
    return encode(Message("IMAGE", name, image.content, time_of(UTC_NS + t_ns)))


def turned(x_mm: float = 10.0, angle_deg: float = 30.0) -> Matrix4:
    """(4, 4): turned about z, at (x_mm, 20, -1600)."""
    matrix, angle = np.eye(4), np.radians(angle_deg)
    matrix[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    matrix[:3, 3] = x_mm, 20, -1600
    return matrix


class Server:
    """One client at a time; the test says what it hears."""

    def __init__(self) -> None:
        self._door = socket.create_server(("127.0.0.1", 0))
        self._door.settimeout(5)
        self.target = f"127.0.0.1:{self._door.getsockname()[1]}"
        self.line: socket.socket | None = None

    def accept(self) -> None:
        if self.line is not None:
            self.line.close()
        self.line, _ = self._door.accept()
        self.line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, *data: bytes) -> None:
        assert self.line is not None
        self.line.sendall(b"".join(data))

    def asked(self) -> list[str]:
        """Types of the messages that the client has sent."""
        assert self.line is not None
        self.line.settimeout(1)
        data, found = self.line.recv(65536), []
        while len(data) >= HEADER_BYTES:
            header = header_of(data)
            found.append(header.kind)
            data = data[HEADER_BYTES + header.body_bytes :]
        return found

    def close(self) -> None:
        self._door.close()
        if self.line is not None:
            self.line.close()


@contextmanager
def server() -> Iterator[Server]:
    one = Server()
    try:
        yield one
    finally:
        one.close()
