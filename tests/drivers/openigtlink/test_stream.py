"""Bytes as they come: cut anywhere, of kinds that nobody wants, damaged, hostile."""

import itertools
import random
import tracemalloc
from contextlib import suppress

import numpy as np
import pytest

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.openigtlink import content
from probewatch.drivers.openigtlink.image import grey_picture, parse_image
from probewatch.drivers.openigtlink.message import HEADER_BYTES, Header, Message, encode
from probewatch.drivers.openigtlink.stream import MessageStream
from probewatch.drivers.openigtlink.tracker import _readings
from tests.support.igtl import good_bytes, mutants, picture

QUICK, THOROUGH, SLOW = 2_000, 20_000, 1_000_000


def everything(_: Header) -> bool:
    return True


def taken(stream: MessageStream) -> list[Message]:
    found = []
    while (arrived := stream.take()) is not None:
        found.append(arrived.message)
    return found


def test_messages_are_whole_however_the_bytes_are_cut() -> None:
    wire, chance = b"".join(good_bytes()), random.Random(1)
    for longest in (1, 7, 57, 58, 59, 4000):
        stream, found, place = MessageStream(everything), [], 0
        while place < len(wire):
            size = chance.randint(1, longest)
            stream.add(wire[place : place + size], 0)
            found += taken(stream)
            place += size
        assert [encode(message) for message in found] == good_bytes()


def test_a_message_has_arrived_when_its_first_byte_has() -> None:
    data, stream = picture("Image", np.zeros((16, 16), np.uint8), 0), MessageStream(everything)
    stream.add(data[:1], 100)
    stream.add(data[1:] + data[:30], 200)
    stream.add(data[30:] + data, 300)
    arrivals = [stream.take() for _ in range(3)]
    assert [arrived.arrival_ns for arrived in arrivals if arrived] == [100, 200, 300]


def test_what_nobody_wants_is_counted_and_never_kept() -> None:
    stream = MessageStream(lambda header: header.kind == "STATUS")
    large, status = encode(Message("VIDEO", "Scanner", bytes(1 << 20))), encode(Message("STATUS", "", bytes(31)))
    tracemalloc.start()
    for _ in range(30):
        for place in range(0, len(large), 1 << 16):
            stream.add(large[place : place + (1 << 16)], 0)
    assert tracemalloc.get_traced_memory()[1] < 1 << 19
    tracemalloc.stop()
    stream.add(status, 0)
    assert [message.kind for message in taken(stream)] == ["STATUS"]
    assert (stream.skipped, stream.refused, stream.whole) == (30, 0, 31)


def test_a_damaged_message_is_refused_and_the_next_one_read() -> None:
    data = bytearray(good_bytes()[0])
    data[HEADER_BYTES + 3] ^= 1
    stream = MessageStream(everything, "igtl://cart:18944")
    stream.add(bytes(data) + good_bytes()[0], 0)
    with pytest.raises(ProtocolError, match="igtl://cart:18944: TRANSFORM 'StylusToReference' is damaged"):
        stream.take()
    assert len(taken(stream)) == 1
    assert stream.refused == 1


def test_a_header_that_cannot_be_followed_ends_the_stream_after_what_was_whole() -> None:
    stream = MessageStream(everything)
    stream.add(good_bytes()[0] + b"GET / HTTP/1.1\r\nHost: cart\r\nUser-Agent: something else entirely\r\n" * 2, 0)
    stream.require_sound()
    assert len(taken(stream)) == 1
    with pytest.raises(ProtocolError, match="header version 18245 is not known"):
        stream.require_sound()
    stream.add(bytes(1 << 20), 0)
    assert stream.take() is None


PARSERS = {
    "POSITION": content.parse_position,
    "STATUS": content.parse_status,
    "STRING": content.parse_words,
    "COMMAND": content.parse_command,
    "RTS_COMMAND": content.parse_command,
    "STT_TDATA": content.parse_start,
    "CAPABILITY": content.parse_types,
}


def use(message: Message) -> None:
    """As the drivers do. Raises ProtocolError, or ValueError for a picture that cannot be made grey."""
    if message.kind == "IMAGE":
        grey_picture(parse_image(message.content), (0.0, 255.0))
    elif message.kind in ("TRANSFORM", "TDATA", "QTDATA"):
        for reading in _readings(message).values():
            assert reading.matrix is None or np.isfinite(reading.matrix).all()
    elif message.kind in PARSERS:
        PARSERS[message.kind](message.content)


def flood(count: int, seed: int) -> tuple[int, int]:
    """(taken, refused) of so many mutated messages; every one is one or the other, or the stream ends there."""
    good = refused = 0
    for data in itertools.islice(mutants(seed), count):
        stream = MessageStream(everything)
        stream.add(data, 0)
        try:
            stream.require_sound()
            arrived = stream.take()
            if arrived is None:
                refused += 1
                continue
            use(arrived.message)
            good += 1
        except (ProtocolError, ValueError):
            refused += 1
    return good, refused


@pytest.mark.parametrize(
    "count",
    [
        QUICK,
        pytest.param(THOROUGH, marks=pytest.mark.thorough),
        pytest.param(SLOW, marks=pytest.mark.slow),
    ],
)
def test_mutated_messages_end_in_a_counted_refusal(count: int) -> None:
    good, refused = flood(count, seed=count)
    print(f"{count} mutated messages: {good} taken, {refused} refused")
    assert good + refused == count
    assert refused > 0.5 * count


def test_a_stream_of_mutated_messages_takes_no_memory() -> None:
    """As one connection would: what follows a damaged length is anything."""
    tracemalloc.start()
    for start in range(20):
        stream = MessageStream(everything)
        for data in itertools.islice(mutants(start), 100):
            stream.add(data, 0)
            with suppress(ProtocolError, ValueError):
                while (arrived := stream.take()) is not None:
                    use(arrived.message)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1 << 22
