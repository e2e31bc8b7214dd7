"""The RTC3D codec: published vectors, constants by hand, round trips, and bytes that nobody should accept."""

import math
import random
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.trackers.optotrak.rtc3d import (
    HEADER_BYTES,
    MAX_PACKET_BYTES,
    Body,
    ByteOrder,
    C3dFile,
    Component,
    ComponentType,
    DataFrame,
    Event,
    Force,
    Marker,
    NoData,
    Packet,
    PacketType,
    Text,
    command,
    decode_packet,
    encode_packet,
    packet_length,
)
from tests.support.vectors import vectors

TWO_BODIES = bytes.fromhex(
    "00000064 00000003 00000001 00000058 00000004 000004d2 00000000004c4b40 00000002"
    "3f350481 00000000 3f350481 00000000 c2f6e666 4287c7ae c4bb8000 3e800000" + "ffffffff" * 8
)
TWO_MARKERS_LITTLE = bytes.fromhex(
    "00000044 00000003 01000000 38000000 01000000 d2040000 404b4c0000000000 02000000"
    "0000c842 00004843 0000fac4 00c07944" + "ffffffff" * 3 + "00c07944"
)


def _described(item: object) -> object:
    """An item in the words of the vectors file."""
    if item is None or (isinstance(item, Marker) and item.position_mm is None):
        return "missing"
    if isinstance(item, Marker):
        return [*(item.position_mm or ()), 999 if item.reliability is None else item.reliability]
    assert isinstance(item, Body)
    return [*item.quaternion, *item.translation_mm, item.rms_mm]


@pytest.mark.parametrize("vector", vectors("rtc3d"))
def test_vectors_decode_to_their_fields_and_encode_to_their_bytes(vector: dict[str, Any]) -> None:
    data = bytes.fromhex(vector["hex"])
    order = ByteOrder.LITTLE if "little-endian" in vector["name"] else ByteOrder.BIG
    packet, expected = decode_packet(data, order), vector["decoded"]
    assert encode_packet(packet, order) == data
    if "components" not in expected:
        assert (len(data), data[7]) == (expected["size"], expected["type"])
        return
    assert isinstance(packet, DataFrame)
    for component, fields in zip(packet.components, expected["components"], strict=True):
        assert (component.kind, component.frame, component.time_us) == (
            fields["type"],
            fields["frame"],
            fields["time_us"],
        )
        for item, wanted in zip(component.items, fields["items"], strict=True):
            described = _described(item)
            assert described == (wanted if wanted == "missing" else pytest.approx(wanted, abs=1e-4))


def test_a_command_by_hand() -> None:
    data = bytes.fromhex("0000001f00000001") + b"SetByteOrder BigEndian\0"
    assert command("SetByteOrder BigEndian") == data
    assert decode_packet(data, ByteOrder.LITTLE) == Text(PacketType.COMMAND, "SetByteOrder BigEndian")


def test_the_nul_of_a_text_is_optional() -> None:
    data = bytes.fromhex("0000001300000001") + b"Version 1.0"
    packet = decode_packet(data, ByteOrder.BIG)
    assert packet == Text(PacketType.COMMAND, "Version 1.0", terminated=False)
    assert encode_packet(packet, ByteOrder.BIG) == data


def test_bodies_by_hand() -> None:
    packet = decode_packet(TWO_BODIES, ByteOrder.BIG)
    assert isinstance(packet, DataFrame)
    (bodies,) = packet.components
    assert (bodies.kind, bodies.frame, bodies.time_us) == (ComponentType.BODIES, 1234, 5_000_000)
    seen, missing = bodies.items
    assert isinstance(seen, Body)
    assert missing is None
    assert seen.rms_mm == 0.25
    turned = np.array([[0, 0, 1, -123.45], [0, 1, 0, 67.89], [-1, 0, 0, -1500], [0, 0, 0, 1]])
    np.testing.assert_allclose(seen.matrix(), turned, atol=1e-4)
    assert encode_packet(packet, ByteOrder.BIG) == TWO_BODIES


def test_little_endian_is_the_payload_alone() -> None:
    packet = decode_packet(TWO_MARKERS_LITTLE, ByteOrder.LITTLE)
    assert packet == DataFrame(
        (Component(ComponentType.MARKERS, 1234, 5_000_000, (Marker((100.0, 200.0, -2000.0)), Marker(None))),)
    )
    assert encode_packet(packet, ByteOrder.LITTLE) == TWO_MARKERS_LITTLE


@pytest.mark.parametrize("order", ByteOrder)
@pytest.mark.parametrize("data", [TWO_BODIES, TWO_MARKERS_LITTLE])
def test_the_other_byte_order_is_refused(order: ByteOrder, data: bytes) -> None:
    right = ByteOrder.BIG if data is TWO_BODIES else ByteOrder.LITTLE
    if order is not right:
        with pytest.raises(ProtocolError, match="order="):
            decode_packet(data, order)


def _with_floats(*values: float | bytes, kind: int = 4, order: ByteOrder = ByteOrder.BIG) -> bytes:
    """A packet of one item; a value may be given as its four bytes."""
    item = b"".join(v if isinstance(v, bytes) else struct.pack(f"{order.value}f", v) for v in values)
    component = struct.pack(f"{order.value}IIIQI", 24 + len(item), kind, 1, 2, 1) + item
    payload = struct.pack(f"{order.value}I", 1) + component
    return struct.pack(">II", 8 + len(payload), 3) + payload


_SEEN = (1.0, 0.0, 0.0, 0.0, 10.0, 20.0, -1500.0, 0.2)
_MARKS = [b"\xff\xff\xff\xff", -3.697314e28, math.nan, math.inf, -math.inf, -3.1e28]


def _only_item(data: bytes) -> object:
    packet = decode_packet(data, ByteOrder.BIG)
    assert isinstance(packet, DataFrame)
    return packet.components[0].items[0]


@pytest.mark.parametrize("mark", _MARKS, ids=str)
def test_every_mark_of_a_missing_value_hides_the_whole_body(mark: float | bytes) -> None:
    assert _only_item(_with_floats(*_SEEN)) is not None
    for place in range(8):
        values: list[float | bytes] = list(_SEEN)
        values[place] = mark
        assert _only_item(_with_floats(*values)) is None


@pytest.mark.parametrize("mark", _MARKS, ids=str)
@pytest.mark.parametrize("place", range(3))
def test_every_mark_of_a_missing_value_hides_the_marker(mark: float | bytes, place: int) -> None:
    values: list[float | bytes] = [100.0, 200.0, -2000.0, 999.0]
    values[place] = mark
    assert _only_item(_with_floats(*values, kind=1)) == Marker(None)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ((1.002, 0, 0, 0, 0, 0, 0, 0.1), "quaternion has length 1.002"),
        ((0, 0, 0, 0, 0, 0, 0, 0.1), "quaternion has length 0"),
        ((1, 0, 0, 0, 0, 0, -2e6, 0.1), "kilometres away"),
        ((1, 0, 0, 0, 0, 0, 0, -0.1), "a fit that cannot be"),
    ],
)
def test_implausible_bodies_are_refused(values: tuple[float, ...], words: str) -> None:
    with pytest.raises(ProtocolError, match=words):
        decode_packet(_with_floats(*values), ByteOrder.BIG)


def test_an_implausible_marker_is_refused() -> None:
    with pytest.raises(ProtocolError, match="kilometres away"):
        decode_packet(_with_floats(3e6, 0, 0, 999, kind=1), ByteOrder.BIG)


def _changed(at: int, value: int, data: bytes = TWO_BODIES) -> bytes:
    return data[:at] + struct.pack(">I", value) + data[at + 4 :]


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "size does not fit"),
        (TWO_BODIES[:-1], "size does not fit"),
        (TWO_BODIES + b"\0", "size does not fit"),
        (_changed(0, 7), "no RTC3D packet has 7 bytes"),
        (_changed(0, MAX_PACKET_BYTES + 1), "no RTC3D packet has 50001 bytes"),
        (_changed(4, 6), "6 is not an RTC3D packet type"),
        (_changed(8, 6), "6 components"),
        (_changed(8, 2), "breaks off in its header"),
        (_changed(8, 0), "88 bytes follow"),
        (_changed(12, 56), "a component of 56 bytes with 2 items of 32"),
        (_changed(16, 6), "6 is not a component type"),
        (_changed(32, 3), "a component of 88 bytes with 3 items"),
        (struct.pack(">II", 10, 3) + b"\0\0", "without a count"),
        (struct.pack(">II", 9, 4) + b"\0", "without data carries data"),
        (struct.pack(">II", 12, 1) + b"a\0b\0", "a NUL inside"),
        (struct.pack(">II", 10, 0) + b"\xe4\xff", "not characters"),
    ],
)
def test_what_disagrees_is_refused(data: bytes, words: str) -> None:
    with pytest.raises(ProtocolError, match=words):
        decode_packet(data, ByteOrder.BIG)


def test_a_component_that_comes_twice_is_refused() -> None:
    one = decode_packet(TWO_BODIES, ByteOrder.BIG)
    assert isinstance(one, DataFrame)
    with pytest.raises(ProtocolError, match="twice"):
        decode_packet(encode_packet(DataFrame(one.components * 2), ByteOrder.BIG), ByteOrder.BIG)


def test_a_packet_beyond_every_reader_is_not_made() -> None:
    with pytest.raises(ProtocolError, match="50001 bytes"):
        encode_packet(C3dFile(bytes(MAX_PACKET_BYTES - HEADER_BYTES + 1)), ByteOrder.BIG)
    assert len(encode_packet(C3dFile(bytes(MAX_PACKET_BYTES - HEADER_BYTES)), ByteOrder.BIG)) == MAX_PACKET_BYTES


def test_length_is_known_from_the_header_on() -> None:
    assert [packet_length(TWO_BODIES[:n]) for n in (0, 7, 8, 50, 100)] == [None, None, 100, 100, 100]


_mm = st.floats(-1e6, 1e6, width=32)
_triple_mm = st.tuples(_mm, _mm, _mm)
_u32, _u64 = st.integers(0, 2**32 - 1), st.integers(0, 2**64 - 1)


@st.composite
def _bodies(draw: st.DrawFn) -> Body:
    raw = draw(st.tuples(st.floats(0.1, 1), st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)))
    q0, qx, qy, qz = (float(np.float32(value / math.hypot(*raw))) for value in raw)
    return Body((q0, qx, qy, qz), draw(_triple_mm), draw(st.floats(0, 1e4, width=32)))


_reliability = st.none() | st.floats(0, 100, width=32)
_ITEMS = {
    ComponentType.MARKERS: st.builds(Marker, st.none() | _triple_mm, _reliability),
    ComponentType.ANALOG: st.none() | _mm,
    ComponentType.FORCE: st.none() | st.builds(Force, _triple_mm, _triple_mm),
    ComponentType.BODIES: st.none() | _bodies(),
    ComponentType.EVENTS: st.builds(Event, _u32, _u64, st.tuples(_u32, _u32, _u32)),
}


@st.composite
def _frames(draw: st.DrawFn) -> DataFrame:
    kinds = draw(st.lists(st.sampled_from(ComponentType), unique=True))
    return DataFrame(
        tuple(Component(k, draw(_u32), draw(_u64), tuple(draw(st.lists(_ITEMS[k], max_size=6)))) for k in kinds)
    )


_texts = st.builds(
    Text,
    st.sampled_from([PacketType.ERROR, PacketType.COMMAND, PacketType.XML]),
    st.text(st.characters(exclude_characters="\0", codec="utf-8")),
    st.booleans(),
)
_packets = st.one_of(_frames(), _texts, st.just(NoData()), st.builds(C3dFile, st.binary(max_size=100)))


def comes_back(packet: Packet, order: ByteOrder) -> None:
    data = encode_packet(packet, order)
    assert packet_length(data) == len(data)
    assert decode_packet(data, order) == packet


@settings(max_examples=40, deadline=None)
@given(_packets, st.sampled_from(ByteOrder))
def test_what_is_encoded_decodes_to_itself(packet: Packet, order: ByteOrder) -> None:
    comes_back(packet, order)


@pytest.mark.thorough
@settings(max_examples=300, deadline=None)
@given(_packets, st.sampled_from(ByteOrder))
def test_hundreds_of_encoded_packets_decode_to_themselves(packet: Packet, order: ByteOrder) -> None:
    comes_back(packet, order)


@settings(deadline=None)
@given(st.binary(max_size=200), st.sampled_from(ByteOrder))
def test_any_bytes_give_a_packet_or_a_protocol_error(data: bytes, order: ByteOrder) -> None:
    for candidate in (data, struct.pack(">II", HEADER_BYTES + len(data), 3) + data):
        try:
            decode_packet(candidate, order)
        except ProtocolError:
            continue


def _mutated(chance: random.Random, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 4))):
        at = chance.randrange(len(changed))
        match chance.randrange(5):
            case 0:
                changed[at] ^= 1 << chance.randrange(8)
            case 1:
                changed[at] = chance.randrange(256)
            case 2:
                del changed[at : at + chance.randrange(1, 9)]
            case 3:
                changed[at:at] = chance.randbytes(chance.randrange(1, 9))
            case 4:
                end = chance.randrange(len(changed))
                changed[at : at + 4] = changed[end : end + 4]
        if not changed:
            return b""
    return bytes(changed)


def _fuzz(rounds: int, seed: int) -> int:
    """Number of mutated packets that were taken; every body among them must be a pose that can be."""
    chance, taken = random.Random(seed), 0
    little = encode_packet(decode_packet(TWO_BODIES, ByteOrder.BIG), ByteOrder.LITTLE)
    samples = [(TWO_BODIES, ByteOrder.BIG), (little, ByteOrder.LITTLE), (TWO_MARKERS_LITTLE, ByteOrder.LITTLE)]
    for _ in range(rounds):
        original, order = chance.choice(samples)
        data = _mutated(chance, original)
        try:
            packet = decode_packet(data, order)
        except ProtocolError:
            continue
        taken += 1
        _require_plausible(packet)
        assert len(data) == len(original) or not isinstance(packet, DataFrame)
    return taken


def _require_plausible(packet: Packet) -> None:
    for component in packet.components if isinstance(packet, DataFrame) else ():
        for item in component.items:
            if isinstance(item, Body):
                matrix = item.matrix()
                np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-9)
                assert abs(math.hypot(*item.quaternion) - 1) <= 1e-3
                assert np.all(np.abs(matrix[:3, 3]) <= 1e6)
            if isinstance(item, Marker) and item.position_mm is not None:
                assert all(abs(value_mm) <= 1e6 for value_mm in item.position_mm)


def test_mutated_packets_give_protocol_errors_or_plausible_poses() -> None:
    assert 0 < _fuzz(5000, seed=1) < 4000


@pytest.mark.slow
def test_mutated_packets_at_length() -> None:
    assert _fuzz(300_000, seed=2) > 0
