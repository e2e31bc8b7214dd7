"""What OpenIGTLink clients are told: never OK with an open contact, and an answer to everything that is a question."""

import json
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from probewatch.appliance.types import State
from probewatch.drivers.openigtlink.content import (
    NOT_FOUND,
    OK,
    TIMEOUT,
    UNKNOWN_INSTRUCTION,
    Command,
    Words,
    parse_command,
    parse_status,
    parse_transform,
    parse_types,
    parse_words,
)
from probewatch.drivers.openigtlink.message import HEADER_BYTES, Message, decode_body, encode, parse_header
from probewatch.tools.openigtlink.answers import TYPES, answer_to
from probewatch.tools.openigtlink.asked import USUAL_NAMES
from probewatch.tools.openigtlink.wording import fields_of, metadata_of, state_message, status_message, status_of
from probewatch.tools.shared.status_watch import Seen
from tests.support.example_status import MATRIX, OPEN, example_status
from tests.support.stopwatch import Stopwatch

UTC_NS = 1_700_000_000_000_000_000


def seen(**changes: Any) -> Seen:
    status = example_status(**changes)
    return Seen(status, status["t_ns"])


SILENT = Seen(None, 5_000_000_000, "no service answers (connection refused)")


def asked(message: Message, of: Seen) -> Message:
    """The answer, as it arrives."""
    reply = answer_to(message, of, UTC_NS, USUAL_NAMES)
    assert reply is not None
    data = encode(reply)
    return decode_body(parse_header(data[:HEADER_BYTES]), data[HEADER_BYTES:])


def test_ok_is_said_of_a_closed_contact_with_the_time_of_its_tick() -> None:
    of = seen()
    message = status_message(of, UTC_NS)
    assert parse_status(message.content).code == OK
    assert message.time_ns == of.t_ns + UTC_NS


taken = st.sampled_from([True, False, None])


@settings(max_examples=300)
@given(
    st.sampled_from([state.value for state in State] + ["a state of tomorrow"]), st.booleans(),
    st.lists(taken, max_size=3), st.sampled_from([None, "polarity"]),
)  # fmt: skip
def test_whatever_the_status_says_ok_means_closed(
    state: str, energised: bool, contacts: list[bool | None], fault: str | None
) -> None:
    outputs = [{"url": "x", "signal": "contact", "energised": one} for one in contacts]
    outputs.append({"url": "lamp", "signal": "green", "energised": True})
    of = seen(state=state, energised=energised, outputs=outputs, fault=fault)
    closed = energised and bool(contacts) and all(one is True for one in contacts)
    assert (status_of(of).code == OK) == closed
    assert fields_of(of)["contact_closed"] == closed
    assert (("ContactClosed", 106, "true") in metadata_of(of)) == closed


def test_an_open_contact_is_an_error_with_state_and_reason() -> None:
    found = status_of(seen(**OPEN))
    assert (found.code, found.error) == (10, "halt")
    assert found.text == "contact open: Do not use the navigation (polarity +1 axes)"


def test_a_silent_service_is_an_error_and_has_no_transform() -> None:
    found = parse_status(asked(Message("GET_STATUS", "", b""), SILENT).content)
    assert (found.code, found.error) == (TIMEOUT, "service silent")
    assert "connection refused" in found.text
    assert parse_status(asked(Message("GET_TRANS", "ImageToProbe", b""), SILENT).content).code == NOT_FOUND
    assert (
        json.loads(parse_words(asked(Message("GET_STRING", "", b""), SILENT).content).text)["contact_closed"] is False
    )


def test_the_string_holds_every_value_with_its_sigma() -> None:
    words = parse_words(state_message(seen(), UTC_NS).content)
    fields = json.loads(words.text)
    assert words.encoding == 3
    assert fields["checks"][0] == {
        "name": "scale-axial", "value": 0.4, "sigma": 0.1, "unit": "%", "limit": 5.0, "ratio": 0.08, "verdict": "OK",
        "shown_age_s": 2.5,
    }  # fmt: skip
    assert fields["reference"] == {"number": 3, "origin": "recalibration", "sha256": "ab" * 32}
    assert (fields["verification_age_s"], fields["state"]) == (2.5, "monitoring")


def test_the_string_tells_what_is_carried() -> None:
    told = {"max_age_s": 30.0, "shown": "carried", "carried": True}
    fields = json.loads(
        parse_words(state_message(seen(checks=[example_status()["checks"][0] | told]), UTC_NS).content).text
    )
    assert {key: fields["checks"][0][key] for key in told} == told


def test_a_string_that_would_not_fit_goes_without_its_checks() -> None:
    many = [example_status()["checks"][0] | {"name": "x" * 200} for _ in range(1000)]
    words = parse_words(state_message(seen(checks=many), UTC_NS).content)
    assert json.loads(words.text)["checks"] == []


def test_the_transform_is_the_calibration_in_force() -> None:
    reply = asked(Message("GET_TRANS", "ImageToProbe", b""), seen())
    assert (reply.kind, reply.device) == ("TRANSFORM", "ImageToProbe")
    np.testing.assert_allclose(parse_transform(reply.content), MATRIX, rtol=1e-6)


def test_the_estimate_stands_beside_the_calibration_in_force() -> None:
    """The one check of this status says .4 % of the axial scale; the middle of the picture stays where it was."""
    reply = asked(Message("GET_TRANS", "ImageToProbeEstimate", b"", version=2), seen())
    matrix, middle = parse_transform(reply.content), np.array([319.5, 239.5, 0, 1])
    assert matrix[1, 1] == pytest.approx(0.07 * 1.004, rel=1e-6)
    np.testing.assert_allclose(matrix[:3, [0, 2]], np.array(MATRIX)[:3, [0, 2]], rtol=1e-6)
    np.testing.assert_allclose(matrix @ middle, np.array(MATRIX) @ middle, atol=1e-4)
    assert reply.said("Measured") == "scale-axial"
    fields = json.loads(parse_words(state_message(seen(), UTC_NS).content).text)["estimate"]
    np.testing.assert_allclose(fields["image_to_probe"], matrix, rtol=1e-6)


@pytest.mark.parametrize("changes", [{"checks": []}, {"reference": None}])
def test_without_a_measurement_there_is_no_estimate(changes: dict[str, Any]) -> None:
    refused = parse_status(asked(Message("GET_TRANS", "ImageToProbeEstimate", b""), seen(**changes)).content)
    assert (refused.code, refused.text) == (NOT_FOUND, "motion shows no calibration")
    assert fields_of(seen(**changes))["estimate"] is None


@pytest.mark.parametrize("device", ["StylusToTracker", "Image"])
def test_another_transform_is_refused_in_words(device: str) -> None:
    status = parse_status(asked(Message("GET_TRANS", device, b""), seen()).content)
    assert (status.code, status.error) == (NOT_FOUND, "refused")
    assert "only ImageToProbe, ImageToProbeEstimate and ProbeToTracker" in status.text


def test_a_client_gets_the_header_version_that_it_speaks() -> None:
    old = asked(Message("GET_STATUS", "", b""), seen())
    new = asked(Message("GET_STATUS", "", b"", version=2, number=77), seen())
    assert (old.version, old.metadata) == (1, ())
    assert (new.version, new.number, new.said("State"), new.said("ContactClosed")) == (2, 77, "monitoring", "true")
    assert new.said("VerificationAgeS") == "2.500"


def test_capability_names_what_is_answered() -> None:
    assert parse_types(asked(Message("GET_CAPABIL", "", b""), seen()).content) == TYPES


@pytest.mark.parametrize("kind", ["GET_POINT", "GET_POLYDATA", "GET_TDATA", "GET_\x1b[2J"])
def test_what_is_not_known_is_refused_politely(kind: str) -> None:
    status = parse_status(asked(Message(kind, "Any", b""), seen()).content)
    assert status.code == UNKNOWN_INSTRUCTION
    assert "is not answered" in status.text
    assert status.text.isprintable()


@pytest.mark.parametrize(("kind", "reply"), [("STT_TDATA", "RTS_TDATA"), ("STP_QTDATA", "RTS_QTDATA")])
def test_streams_of_tracking_data_are_declined(kind: str, reply: str) -> None:
    found = asked(Message(kind, "Tracker", b""), seen())
    assert (found.kind, found.content) == (reply, b"\1")


@pytest.mark.parametrize("message", [
    Message("TRANSFORM", "ProbeToTracker", bytes(48)), Message("STATUS", "", bytes(31)), Message("IMAGE", "", b""),
    Message("STRING", "Note", Words("hello").content),
])  # fmt: skip
def test_data_are_no_question(message: Message) -> None:
    assert answer_to(message, seen(), UTC_NS, USUAL_NAMES) is None


def commanded(xml: str, of: Seen, **more: Any) -> tuple[ET.Element, Message]:
    """PLUS's newer way."""
    reply = asked(Message("COMMAND", "Slicer", Command(9, "Name", xml).content, version=2, **more), of)
    command = parse_command(reply.content)
    assert (reply.kind, command.number, command.name) == ("RTS_COMMAND", 9, "Name")
    return ET.fromstring(command.text), reply


def spoken(xml: str, of: Seen) -> ET.Element:
    """PLUS's older way."""
    reply = asked(Message("STRING", "CMD_12", Words(xml).content), of)
    assert (reply.kind, reply.device) == ("STRING", "ACK_12")
    return ET.fromstring(parse_words(reply.content).text)


def test_plus_commands_are_answered_in_both_ways() -> None:
    ask = '<Command Name="{}" TransformName="ImageToProbe"/>'
    for name in ("GetStatus", "GetTransform", "RequestDeviceIds"):
        new, reply = commanded(ask.format(name), seen(**OPEN))
        old = spoken(ask.format(name), seen(**OPEN))
        assert (new.get("Status"), old.get("Status"), reply.said("Status")) == ("SUCCESS",) * 3
        assert new.get("Name") == name
        message = new.get("Message", "")
        assert message
        match name:
            case "GetStatus":
                assert json.loads(message)["contact_closed"] is False
                assert json.loads(message)["status"].startswith("10 halt: contact open")
            case "GetTransform":
                assert np.array(message.split(), float).reshape(4, 4) == pytest.approx(np.array(MATRIX))
            case _:
                assert message == "Probewatch,ProbewatchState,ImageToProbe,ImageToProbeEstimate,Image,ProbeToTracker"


@pytest.mark.parametrize("xml", [
    '<Command Name="GetTransform" TransformName="StylusToTracker"/>',
    '<Command Name="StartRecording"/>', '<Command Name="GetTransform" TransformName="ProbeToTracker"/>', "<Command", "",
    '<!DOCTYPE x [<!ENTITY a "b">]><Command Name="GetStatus"/>', "<a>" * 100, "\udcff", '<Command Name="&quot;&lt;"/>',
])  # fmt: skip
def test_other_commands_fail_in_words_that_can_be_read(xml: str) -> None:
    new, reply = commanded(xml, seen())
    assert (new.get("Status"), reply.said("Status")) == ("FAIL", "FAIL")
    assert new.get("Error") == reply.said("Error") != ""
    assert spoken(xml, seen()).get("Status") == "FAIL"


@settings(max_examples=200, deadline=None)
@given(
    st.sampled_from(["COMMAND", "STRING", "GET_TRANS", "STT_TDATA"]), st.binary(max_size=200), st.sampled_from([1, 2])
)
def test_any_question_is_answered_or_refused(kind: str, content: bytes, version: int) -> None:
    watch = Stopwatch()
    reply = answer_to(Message(kind, "CMD_1", content, version=version), seen(), UTC_NS, USUAL_NAMES)
    assert reply is not None
    assert encode(reply)
    assert watch.spent_s() < 1
