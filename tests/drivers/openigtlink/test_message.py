"""Header, extended header, metadata, check sum and every content against the reference library's bytes."""

import math
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from fastcrc import crc64
from hypothesis import given, settings
from hypothesis import strategies as st

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.openigtlink import content as c
from probewatch.drivers.openigtlink.image import Image, parse_image
from probewatch.drivers.openigtlink.message import (
    HEADER_BYTES,
    MOST_BODY_BYTES,
    US_ASCII,
    UTF_8,
    Message,
    decode_body,
    encode,
    parse_header,
    time_of,
)
from tests.support.igtl import damaged, header_of, vectors

Fields = dict[str, Any]


def decoded(data: bytes) -> Message:
    return decode_body(header_of(data), data[HEADER_BYTES:])


def near(values: object) -> Any:
    """Floats as the file prints them: nine digits of 32 bits."""
    return pytest.approx(np.asarray(values, np.float64), rel=1e-8, abs=1e-12)


def axes_and_origin(image: Image) -> np.ndarray:
    return np.array(image.matrix).reshape(4, 3).T


def wire_matrix(fields: Fields) -> tuple[float, ...]:
    """Unit axes times spacing, in 32 bits as the library multiplies."""
    matrix = np.array(fields["matrix_unit_axes_and_center"], np.float32)
    matrix[:3, :3] *= np.array(fields["spacing"], np.float32)
    return tuple(float(value) for value in matrix[:3].T.ravel())


def image_of(f: Fields) -> bytes:
    data, size, offset, part = (
        bytes.fromhex(f["data_hex"]),
        *map(tuple, (f["dimensions"], f["subvolume_offset"], f["subvolume_dimensions"])),
    )
    head = (f["scalar_type"], f["components"], f["endian"], f["coordinate"])
    return Image(size, data, *head, wire_matrix(f), offset, part).content


def turn_of(f: Fields) -> c.Turn:
    return c.Turn(tuple(f["position"]), tuple(f["quaternion_xyzw"]))


def position_of(f: Fields) -> bytes:
    return c.position_content(turn_of(f), {"position_only": 0, "quaternion3": 3, "all": 4}[f["pack_type"]])


def tools_of(f: Fields) -> bytes:
    return c.tools_content(tuple(c.Tool(e["name"], e["type"], np.array(e["matrix"])) for e in f["elements"]))


def turned_tools_of(f: Fields) -> bytes:
    return c.turned_tools_content(tuple(c.TurnedTool(e["name"], e["type"], turn_of(e)) for e in f["elements"]))


def nothing_of(f: Fields) -> bytes:
    return b""


CONTENTS = {
    "TRANSFORM": lambda f: c.transform_content(np.array(f["matrix"])),
    "POSITION": position_of,
    "STATUS": lambda f: c.Status(f["code"], f["subcode"], f["error_name"], f["message"]).content,
    "STRING": lambda f: c.Words(f["string"], f["encoding"]).content,
    "IMAGE": image_of,
    "TDATA": tools_of,
    "QTDATA": turned_tools_of,
    "GET_STATUS": nothing_of,
    "GET_TRANS": nothing_of,
    "GET_IMAGE": nothing_of,
    "STP_TDATA": nothing_of,
    "STT_TDATA": lambda f: c.StartTracking(f["resolution_ms"], f["coordinate_name"]).content,
    "RTS_TDATA": lambda f: bytes([f["status"]]),
    "CAPABILITY": lambda f: c.types_content(tuple(f["types"])),
    "COMMAND": lambda f: c.Command(f["command_id"], f["command_name"], f["content"], f["encoding"]).content,
    "RTS_COMMAND": lambda f: c.Command(f["command_id"], f["error_string"], f["content"], f["encoding"]).content,
}
"""The fields of a vector → our bytes."""


@pytest.mark.parametrize("vector", vectors())
def test_every_vector_is_encoded_byte_for_byte_from_its_fields(vector: Fields) -> None:
    seconds, fraction = vector["timestamp"]
    message = Message(
        vector["type"],
        vector["device_name"],
        CONTENTS[vector["type"]](vector["decoded"]),
        seconds << 32 | fraction,
        vector["header_version"],
        vector.get("message_id", 0),
        tuple((key, code, value) for key, code, value in vector.get("metadata", ())),
    )
    assert encode(message).hex() == vector["hex"]


@pytest.mark.parametrize("vector", vectors())
def test_every_vector_is_decoded_to_its_header_and_metadata_and_back(vector: Fields) -> None:
    data = bytes.fromhex(vector["hex"])
    header, message = header_of(data), decoded(data)
    assert (header.kind, header.device, header.version) == tuple(
        vector[key] for key in ("type", "device_name", "header_version")
    )
    assert (header.body_bytes, f"{header.crc:016x}") == (vector["body_size"], vector["body_crc64"])
    seconds, fraction = vector["timestamp"]
    assert abs(header.time_ns - (seconds * 10**9 + fraction * 1e9 / 2**32)) <= 256
    assert message.number == vector.get("message_id", 0)
    assert [list(entry) for entry in message.metadata] == vector.get("metadata", [])
    assert encode(message) == data


@pytest.mark.parametrize("vector", vectors("TRANSFORM", "TDATA"))
def test_matrices_have_their_rows(vector: Fields) -> None:
    data = decoded(bytes.fromhex(vector["hex"])).content
    if vector["type"] == "TRANSFORM":
        assert c.parse_transform(data) == near(vector["decoded"]["matrix"])
        return
    for tool, element in zip(c.parse_tools(data), vector["decoded"]["elements"], strict=True):
        assert (tool.name, tool.kind) == (element["name"], element["type"])
        assert tool.matrix == near(element["matrix"])


@pytest.mark.parametrize("vector", vectors("POSITION", "QTDATA"))
def test_quaternions_have_their_order(vector: Fields) -> None:
    data = decoded(bytes.fromhex(vector["hex"])).content
    if vector["type"] == "POSITION":
        found, elements = [c.parse_position(data)], [vector["decoded"]]
    else:
        found, elements = [one.turn for one in c.parse_turned_tools(data)], vector["decoded"]["elements"]
    for turn, element in zip(found, elements, strict=True):
        assert turn.position == near(element["position"])
        assert turn.quaternion == near(element["quaternion_xyzw"])


@pytest.mark.parametrize("vector", vectors("IMAGE"))
def test_pictures_have_their_kind_and_pixels(vector: Fields) -> None:
    image, fields = parse_image(decoded(bytes.fromhex(vector["hex"])).content), vector["decoded"]
    assert [image.components, image.scalar, image.order, image.coordinates] == [
        fields[key] for key in ("components", "scalar_type", "endian", "coordinate")
    ]
    assert [list(image.size), list(image.offset), list(image.part or ())] == [
        fields[key] for key in ("dimensions", "subvolume_offset", "subvolume_dimensions")
    ]
    assert image.data.hex() == fields["data_hex"]
    assert np.linalg.norm(axes_and_origin(image)[:, :3], axis=0) == pytest.approx(fields["spacing"], rel=1e-6)
    assert axes_and_origin(image)[:, 3] == near(np.array(fields["matrix_unit_axes_and_center"])[:3, 3])


@pytest.mark.parametrize("vector", vectors("STATUS", "STRING", "COMMAND", "RTS_COMMAND", "STT_TDATA", "CAPABILITY"))
def test_words_have_their_fields(vector: Fields) -> None:
    data, fields = decoded(bytes.fromhex(vector["hex"])).content, vector["decoded"]
    match vector["type"]:
        case "STATUS":
            found: object = c.parse_status(data)
            wanted: object = c.Status(*(fields[key] for key in ("code", "subcode", "error_name", "message")))
        case "STRING":
            found, wanted = c.parse_words(data), c.Words(fields["string"], fields["encoding"])
        case "STT_TDATA":
            found, wanted = c.parse_start(data), c.StartTracking(fields["resolution_ms"], fields["coordinate_name"])
        case "CAPABILITY":
            found, wanted = c.parse_types(data), tuple(fields["types"])
        case _:
            name = fields.get("command_name", fields.get("error_string"))
            found = c.parse_command(data)
            wanted = c.Command(fields["command_id"], name, fields["content"], fields["encoding"])
    assert found == wanted


@pytest.mark.parametrize("vector", damaged())
def test_what_is_damaged_is_refused(vector: Fields) -> None:
    data = bytes.fromhex(vector["hex"])
    with pytest.raises(ProtocolError):
        c.parse_transform(decoded(data).content)


def test_the_check_sum_is_that_of_ecma_182() -> None:
    """Check value by the catalogue of CRC algorithms (CRC-64/ECMA-182)."""
    assert crc64.ecma_182(b"123456789") == 0x6C40DF5F0B497347


def test_a_time_survives_to_the_nanosecond() -> None:
    for utc_ns in (0, 1, 999_999_999, 1_700_000_000_123_456_789, (1 << 32) * 10**9 - 1):
        assert Message("X", "", b"", time_of(utc_ns)).time_ns == utc_ns


def test_a_name_that_is_too_long_is_refused_when_it_is_sent() -> None:
    with pytest.raises(ValueError, match="more than 20 bytes"):
        encode(Message("TRANSFORM", "ABCDEFGHIJKLMNOPQRSTU", b""))


@pytest.mark.parametrize(
    ("parse", "element_bytes", "kind"), [(c.parse_tools, 70, "TDATA"), (c.parse_turned_tools, 50, "QTDATA")]
)
def test_more_tools_than_any_tracker_has_are_refused_unread(parse: Any, element_bytes: int, kind: str) -> None:
    """64 MiB of them took 16 s."""
    assert len(parse(bytes(1000 * element_bytes))) == 1000
    with pytest.raises(ProtocolError, match=f"{kind} has 1001 tools, more than 1000"):
        parse(bytes(1001 * element_bytes))


def test_a_body_of_gigabytes_is_refused_by_its_header() -> None:
    data = bytearray(encode(Message("IMAGE", "", b"")))
    data[42:50] = (MOST_BODY_BYTES + 1).to_bytes(8, "big")
    with pytest.raises(ProtocolError, match="announces 67108865 bytes"):
        parse_header(bytes(data))


@pytest.mark.parametrize(
    ("body", "what"),
    [
        (b"", "unpack"),
        (bytes.fromhex("000b0002000000000000000000"), "do not hold"),
        (bytes.fromhex("000c00ff0000000000000000"), "do not hold"),
        (bytes.fromhex("000c0002ffffffff000000000000"), "do not hold"),
        (bytes.fromhex("000c000200000000000000000001"), "cannot announce 1"),
        (bytes.fromhex("000c000a00000001000000000001000400030000000061"), "not 4"),
        (bytes.fromhex("000c000a000000090000000000010004000300000001616263643132333435"), "not 5"),
    ],
)
def test_parts_that_contradict_each_other_are_refused(body: bytes, what: str) -> None:
    data = encode(Message("TRANSFORM", "Probe", body))
    with pytest.raises(ProtocolError, match=what):
        decoded(b"\x00\x02" + data[2:])


names = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=6).filter(
    lambda s: len(s.encode()) < 21
)
entries = st.tuples(st.text(max_size=8), st.sampled_from((US_ASCII, UTF_8)), st.text(max_size=30))


@settings(max_examples=200, deadline=None)
@given(
    names, names.filter(lambda s: len(s.encode()) < 13), st.binary(max_size=200), st.lists(entries, max_size=4),
    st.sampled_from((1, 2, 3)), st.integers(0, 2**32 - 1), st.integers(0, 2**64 - 1),
)  # fmt: skip
def test_what_is_encoded_is_decoded_to_the_same(
    device: str, kind: str, content: bytes, metadata: list[tuple[str, int, str]], version: int, number: int, time: int
) -> None:
    extended = (number, tuple(metadata)) if version > 1 else (0, ())
    message = Message(kind, device, content, time, version, *extended)
    assert decoded(encode(message)) == message


PARSERS = (
    c.parse_transform, c.parse_tools, c.parse_turned_tools, c.parse_position, c.parse_status, c.parse_words,
    c.parse_command, c.parse_start, c.parse_types, parse_image,
)  # fmt: skip


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(PARSERS), st.binary(max_size=300))
def test_any_bytes_are_parsed_or_refused(parser: Any, content: bytes) -> None:
    with suppress(ProtocolError):
        parser(content)


def test_a_quaternion_of_three_parts_longer_than_one_gets_no_fourth() -> None:
    turn = c.parse_position(c.position_content(c.Turn((1, 2, 3), (1.0, 1.0, 0.0, 0.0)), 3))
    assert turn.quaternion == (1.0, 1.0, 0.0, 0.0)
    assert not math.isnan(turn.quaternion[3])
