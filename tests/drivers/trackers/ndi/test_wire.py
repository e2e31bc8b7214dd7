"""Codecs of the NDI protocol: published vectors, round trips, and bytes that nobody should accept."""

import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.trackers.ndi import bx2
from probewatch.drivers.trackers.ndi.bx import decode_bx, encode_bx
from probewatch.drivers.trackers.ndi.replies import (
    ActiveStray,
    HandleState,
    ToolReply,
    TrackingReply,
    Transform,
)
from probewatch.drivers.trackers.ndi.tx import decode_tx, encode_tx
from probewatch.drivers.trackers.ndi.wire import (
    Command,
    RefusedError,
    crc16,
    decode_command,
    decode_stream,
    decode_text,
    encode_command,
    encode_container,
    encode_stream,
    encode_text,
    reply_length,
)
from tests.support.vectors import vectors

BX_ONE_TOOL = bytes.fromhex(
    "c4a52d003043010a018104353f000000008104353f0000000066e6f6c2aec787420080bbc46de7fb3d31000000341200000000bc9a"
)
BX_VALID_MISSING = bytes.fromhex(
    "c4a537003b23020a018104353f000000008104353f0000000066e6f6c2aec787420080bbc46de7fb3d3100000034120000"
    "0b0231000000341200000000e82c"
)
TX_ONE_TOOL = b"010A+07071+00000+07071+00000-012345+006789-150000+012300000003100001234\n0000D572\r"
BX2_MISSING = bytes.fromhex(
    "c4a534003bd30100010001003000000000000100000002000000351200 0080e14e6815cd5b0701000100"
    "0200100000000000010000000a000d01a41f"
)


def _options(vector: dict[str, Any]) -> int:
    return int(vector["for_command"].partition(":")[2], 16)


def test_crc_check_value() -> None:
    assert crc16(b"123456789") == 0xBB3D


@pytest.mark.parametrize(
    ("command", "line"),
    [
        (Command("INIT"), b"INIT:E3A5\r"),
        (Command("BX", "0801"), b"BX:080100EC\r"),
        (Command("COMM", "50000"), b"COMM:500000048\r"),
        (Command("PHRQ", "*********1****"), b"PHRQ:*********1****A4C1\r"),
        (Command("INIT", checked=False), b"INIT \r"),
    ],
)
def test_command_constants(command: Command, line: bytes) -> None:
    assert encode_command(command) == line
    assert decode_command(line) == command


@pytest.mark.parametrize(("text", "reply"), [("OKAY", b"OKAYA896\r"), ("RESET", b"RESETBE6F\r"), ("0A", b"0A30D4\r")])
def test_text_constants(text: str, reply: bytes) -> None:
    assert encode_text(text) == reply
    assert decode_text(reply) == text


def test_error_reply_carries_its_code_and_meaning() -> None:
    with pytest.raises(RefusedError, match="not possible in the present mode") as refusal:
        decode_bx(b"ERROR0C4E42\r", 0x0801)
    assert refusal.value.code == 0x0C


def test_bx_example() -> None:
    reply = decode_bx(BX_VALID_MISSING, 0x0801)
    probe, other = reply.tools
    assert (probe.handle, probe.state, probe.port_status, probe.frame) == (0x0A, HandleState.VALID, 0x31, 0x1234)
    assert probe.transform is not None
    assert probe.transform.quaternion == pytest.approx((0.7071, 0, 0.7071, 0), abs=1e-6)
    assert probe.transform.translation_mm == pytest.approx((-123.45, 67.89, -1500.0), abs=1e-4)
    assert (other.handle, other.state, other.transform, other.frame) == (0x0B, HandleState.MISSING, None, 0x1234)
    assert encode_bx(reply, 0x0801) == BX_VALID_MISSING


def test_tx_example() -> None:
    reply = decode_tx(TX_ONE_TOOL, 0x0001)
    transform = Transform((0.7071, 0.0, 0.7071, 0.0), (-123.45, 67.89, -1500.0), 0.123)
    assert reply.tools == (ToolReply(0x0A, HandleState.VALID, transform, 0x31, 0x1234),)
    assert encode_tx(reply, 0x0001) == TX_ONE_TOOL


def test_bx2_missing_example() -> None:
    (frame,) = bx2.frames(bx2.decode_bx2(BX2_MISSING))
    (tool,) = frame.tools()
    assert (frame.number, frame.seconds, frame.nanoseconds) == (0x1235, 1750000000, 123456789)
    assert (tool.handle, tool.code, tool.transform) == (0x0A, 13, None)


def test_matrix_of_a_pose() -> None:
    matrix = Transform((0.7071, 0.0, 0.7071, 0.0), (1.0, 2.0, 3.0), 0.1).matrix()
    quarter_turn_about_y = [[0, 0, 1, 1], [0, 1, 0, 2], [-1, 0, 0, 3], [0, 0, 0, 1]]
    np.testing.assert_allclose(matrix, quarter_turn_about_y, atol=1e-9)


def test_quaternion_sign_does_not_change_the_pose() -> None:
    q = (0.5, -0.5, 0.5, 0.5)
    negative = (-0.5, 0.5, -0.5, -0.5)
    np.testing.assert_array_equal(Transform(q, (0, 0, 0), 0).matrix(), Transform(negative, (0, 0, 0), 0).matrix())


@pytest.mark.parametrize("vector", vectors("command-crc", "command-nocrc"))
def test_command_vector(vector: dict[str, Any]) -> None:
    line = bytes.fromhex(vector["hex"])
    command = decode_command(line)
    assert encode_command(command) == line
    decoded = vector["decoded"]
    if "command" in decoded:
        separator = ":" if command.checked else " "
        assert command.name + separator + command.arguments == decoded["command"]
    else:
        expected = f"{decoded['handle']:02X}{decoded['address']:04X}{decoded['data_hex'].upper()}"
        assert (command.name, command.arguments) == ("PVWR", expected)


@pytest.mark.parametrize("vector", vectors("text-reply"))
def test_text_vector(vector: dict[str, Any]) -> None:
    reply, decoded = bytes.fromhex(vector["hex"]), vector["decoded"]
    if decoded.get("text", "").startswith("ERROR"):
        with pytest.raises(RefusedError) as refusal:
            decode_text(reply)
        assert refusal.value.code == int(decoded["text"][5:], 16)
        assert encode_text(decoded["text"]) == reply
        return
    text = decode_text(reply)
    assert encode_text(text) == reply
    if "text" in decoded:
        assert text == decoded["text"]
    else:
        assert len(text) == decoded["len"]


def _assert_tool(tool: ToolReply, stated: dict[str, Any]) -> None:
    assert (tool.handle, tool.state.value) == (stated["h"], stated["state"])
    assert (tool.port_status, tool.frame) == (stated.get("port_status"), stated.get("frame"))
    if "q" in stated:
        assert tool.transform is not None
        assert tool.transform.quaternion == pytest.approx(stated["q"], abs=1e-6)
        assert tool.transform.translation_mm == pytest.approx(stated["t"], abs=1e-3)
        assert tool.transform.error == pytest.approx(stated["err"], abs=1e-6)
    else:
        assert tool.transform is None
    _assert_markers(tool, stated)


def _assert_markers(tool: ToolReply, stated: dict[str, Any]) -> None:
    listed = next((stated[k] for k in ("markers", "markers_listed", "markers_in_volume_listed") if k in stated), None)
    if listed is not None:
        assert tool.markers is not None
        positions = [position for position in tool.markers.positions_mm if position is not None]
        assert np.allclose(positions, listed, atol=1e-3) if listed else positions == []
        assert len(tool.markers.outside) == stated.get("marker_count", len(listed))
    if "tool_info" in stated:
        assert tool.information is not None
        assert tool.information.flags == stated["tool_info"]
        packed = int(stated["marker_info_hex"], 16)
        assert tool.information.markers == tuple(packed >> 4 * i & 15 for i in range(20))
    if "active_stray" in stated:
        assert tool.stray is not None
        position = stated["active_stray"].get("pos")
        assert tool.stray == ActiveStray(stated["active_stray"]["status"], tuple(position) if position else None)


@pytest.mark.parametrize("vector", vectors("tx-reply", "bx-reply"))
def test_tracking_vector(vector: dict[str, Any]) -> None:
    decode, encode = (decode_tx, encode_tx) if vector["kind"] == "tx-reply" else (decode_bx, encode_bx)
    data, options, decoded = bytes.fromhex(vector["hex"]), _options(vector), vector["decoded"]
    reply = decode(data, options)
    assert reply.system_status == decoded["system_status"]
    assert len(reply.tools) == len(decoded["handles"])
    for tool, stated in zip(reply.tools, decoded["handles"], strict=True):
        _assert_tool(tool, stated)
    listed = decoded.get("strays", decoded.get("strays_listed"))
    if listed is not None:
        assert reply.strays is not None
        assert [list(p) for p in reply.strays.positions_mm if p is not None] == listed
    assert encode(reply, options) == data


@pytest.mark.parametrize("vector", vectors("bx-fault", "bx-error", "bx-trunc"))
def test_faulty_vector_is_refused(vector: dict[str, Any]) -> None:
    with pytest.raises(ProtocolError):
        decode_bx(bytes.fromhex(vector["hex"]), _options(vector))


def _stated_bx2(frame: bx2.FrameItem) -> dict[str, Any]:
    """A decoded frame in the words of the vectors file, as far as it has them."""
    said: dict[str, Any] = {"type": frame.type, "frame": frame.number, "s": frame.seconds, "ns": frame.nanoseconds}
    for component in frame.components:
        match component:
            case bx2.SixD():
                said["6d"] = [_stated_6d(tool) for tool in component.items]
            case bx2.ThreeD():
                said["3d"] = [{"h": t.handle, "markers": [_stated_3d(m) for m in t.markers]} for t in component.items]
            case bx2.OneD():
                said["1d"] = [{"h": b.handle, "buttons": list(b.pressed)} for b in component.items]
            case bx2.ErrorLists():
                said["3derr"] = [{"h": e.handle, "errors": [list(p) for p in e.errors_mm]} for e in component.items]
            case bx2.Alerts():
                said["alerts"] = [{"type": a.kind, "code": a.code} for a in component.items]
    return said


def _stated_6d(tool: bx2.Tool6D) -> dict[str, Any]:
    said: dict[str, Any] = {"h": tool.handle, "status": tool.status}
    if tool.transform is not None:
        said["q"] = pytest.approx(list(tool.transform.quaternion), abs=1e-6)
        said["t"] = pytest.approx(list(tool.transform.translation_mm), abs=1e-3)
        said["err"] = pytest.approx(tool.transform.error, abs=1e-6)
    return said


def _stated_3d(marker: bx2.Marker3D) -> dict[str, Any]:
    said: dict[str, Any] = {"i": marker.index, "status": marker.status}
    if marker.position_mm is not None:
        said["pos"] = list(marker.position_mm)
    return said


@pytest.mark.parametrize("vector", vectors("bx2-reply", "bx2-ext"))
def test_bx2_vector(vector: dict[str, Any]) -> None:
    data = bytes.fromhex(vector["hex"])
    components = bx2.decode_bx2(data)
    said = [_stated_bx2(frame) for frame in bx2.frames(components)]
    stated = vector["decoded"]["frames"]
    assert [{key: frame[key] for key in wanted} for frame, wanted in zip(said, stated, strict=True)] == stated
    assert bx2.encode_bx2(components, extended=vector["kind"] == "bx2-ext") == data


@pytest.mark.parametrize("vector", vectors("stream"))
def test_stream_vector(vector: dict[str, Any]) -> None:
    data, decoded = bytes.fromhex(vector["hex"]), vector["decoded"]
    identity, reply = decode_stream(data)
    assert identity == decoded["stream_id"]
    assert [f.number for f in bx2.frames(bx2.decode_bx2(reply))] == [f["frame"] for f in decoded["frames"]]
    assert encode_stream(identity, reply) == data


finite = st.floats(-9999, 9999, width=32)
positions = st.tuples(finite, finite, finite)


def _decode_all(data: bytes) -> int:
    """Every decoder in turn on the same bytes; returns how many accepted them. Anything but ProtocolError escapes."""
    decoders = [decode_command, decode_text, decode_stream, bx2.decode_bx2, reply_length]
    accepted = 0
    for options in (0x0001, 0x0801, 0x180F):
        decoders += [lambda d, o=options: decode_bx(d, o), lambda d, o=options: decode_tx(d, o)]
    for decode in decoders:
        try:
            decode(data)  # type: ignore[operator]
            accepted += decode is not reply_length
        except ProtocolError:
            pass
    return accepted


@given(st.binary(max_size=300))
@settings(max_examples=150, deadline=None)
def test_random_bytes_give_only_protocol_errors(data: bytes) -> None:
    _decode_all(data)
    _decode_all(encode_container(data))
    _decode_all(encode_container(data, extended=True))
    _decode_all(encode_text(data.replace(b"\r", b"").decode("latin-1")))


@given(st.sampled_from([BX_ONE_TOOL, BX_VALID_MISSING, TX_ONE_TOOL, BX2_MISSING]), st.data())
@settings(max_examples=300, deadline=None)
def test_mutated_replies_are_refused(reply: bytes, data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(reply) - 1))
    flip = data.draw(st.integers(1, 255))
    mutated = reply[:at] + bytes([reply[at] ^ flip]) + reply[at + 1 :]
    assert _decode_all(mutated) == 0, "one wrong byte lies within a 16-bit CRC's reach"


@given(st.sampled_from([BX_ONE_TOOL, TX_ONE_TOOL, BX2_MISSING]), st.data())
def test_truncated_replies_are_refused(reply: bytes, data: st.DataObject) -> None:
    assert _decode_all(reply[: data.draw(st.integers(0, len(reply) - 1))]) == 0


@pytest.mark.parametrize(
    "values",
    [
        (float("nan"), 0, 0, 0, 0, 0, 0, 0),
        (1, 0, 0, 0, float("inf"), 0, 0, 0),
        (1, 0, 0, 0, -3.697314e28, 0, 0, 0),
        (1.01, 0, 0, 0, 0, 0, 0, 0),
        (0, 0, 0, 0, 0, 0, 0, 0),
    ],
)
def test_impossible_pose_under_a_right_crc_is_refused(values: tuple[float, ...]) -> None:
    body = b"\x01\x0a\x01" + struct.pack("<8f", *values) + struct.pack("<IIH", 0x31, 7, 0)
    with pytest.raises(ProtocolError, match="a pose"):
        decode_bx(encode_container(body), 0x0801)


def test_a_handle_listed_twice_is_refused() -> None:
    tool = ToolReply(3, HandleState.MISSING, None, 0x31, 9)
    with pytest.raises(ProtocolError, match="listed twice"):
        decode_bx(encode_bx(TrackingReply((tool, tool)), 0x0801), 0x0801)


def test_binary_reply_with_carriage_returns_is_read_by_length() -> None:
    tool = ToolReply(0x0D, HandleState.MISSING, None, 0x31, 0x0D0D0D0D)
    data = encode_bx(TrackingReply((tool,)), 0x0801)
    assert reply_length(data + b"junk") == len(data)
    assert decode_bx(data, 0x0801).tools == (tool,)


def test_length_is_unknown_until_the_header_is_whole() -> None:
    lengths = [reply_length(BX_ONE_TOOL[:n]) for n in range(len(BX_ONE_TOOL) + 1)]
    assert lengths == [None] * 6 + [len(BX_ONE_TOOL)] * (len(BX_ONE_TOOL) - 5)
