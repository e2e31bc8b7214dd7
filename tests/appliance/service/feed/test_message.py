"""The feed's messages: what comes back is what went in, to the last bit, and garbage is told as garbage."""

import contextlib
import json
import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.limits import Limits
from probewatch.appliance.service.feed import message
from probewatch.appliance.service.feed.message import HEAD_BYTES, Judged, LineStarted, Lost, Taken, lengths, unpacked
from probewatch.appliance.service.feed.request import FeedRequest, request_of
from probewatch.appliance.types import Calibration, Check, Fault, Verdict, VerdictKind
from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp

ANY = st.floats(width=64)
NS = st.integers(-(2**62), 2**62)


def again(packed: bytes, pixels: bytes = b"") -> message.FeedMessage:
    header, length = lengths(packed[:HEAD_BYTES])
    assert (len(packed), length) == (HEAD_BYTES + header, len(pixels))
    return unpacked(packed[HEAD_BYTES:], pixels)


def bits(value: float) -> bytes:
    return struct.pack("d", value) if not math.isnan(value) else b"nan"


@given(st.lists(ANY, min_size=16, max_size=16), ANY, NS, NS, st.text(max_size=20))
def test_a_pose_comes_back_bit_for_bit(numbers, rms_mm, t_ns, err_ns, reason) -> None:
    matrix = np.array(numbers).reshape(4, 4)
    pose = Pose(Stamp(t_ns, err_ns), 7, matrix, rms_mm, PoseStatus.OK, reason, matrix.T)
    found = again(message.taken_pose(3, pose))
    assert isinstance(found, Taken)
    assert isinstance(found.sample, Pose)
    assert (found.step, found.sample.stamp, found.sample.sequence) == (3, pose.stamp, 7)
    assert [bits(one) for one in found.sample.matrix.ravel()] == [bits(one) for one in numbers]
    assert [bits(one) for one in found.sample.witness.T.ravel()] == [bits(one) for one in numbers]
    assert (bits(found.sample.rms_mm), found.sample.reason) == (bits(rms_mm), reason)


@pytest.mark.parametrize("status", [one for one in PoseStatus if one is not PoseStatus.OK])
def test_a_pose_that_is_none_says_which(status) -> None:
    found = again(message.taken_pose(1, Pose(Stamp(1, 2), 3, None, float("nan"), status, "why")))
    assert (found.sample.matrix, found.sample.status) == (None, status)


def test_a_picture_comes_back_with_its_size_before_it_was_reduced() -> None:
    image = np.random.default_rng(1).integers(0, 256, (5, 7), dtype=np.uint8)
    packed, pixels = message.taken_frame(9, Frame(Stamp(1, 2), 3, image), (14, 10), 2)
    found = again(packed, pixels)
    assert (found.step, found.reduced_by, found.sample.stamp, found.sample.sequence) == (9, 2, Stamp(1, 2), 3)
    assert np.array_equal(found.sample.image, image)


@given(st.lists(ANY, min_size=3, max_size=3), st.one_of(st.none(), NS), st.one_of(st.none(), NS))
def test_a_verdict_comes_back_bit_for_bit(numbers, shown_ns, verified_ns) -> None:
    check = Check("scale-lateral", Fault.SCALE, *numbers[:2], "%", numbers[2], VerdictKind.NOT_VERIFIED, shown_ns, 7)
    verdict = Verdict(5, VerdictKind.FAULT, (check, check), Fault.POLARITY, "gespiegelt: ±", verified_ns, shown_ns)
    found = again(message.judged(2, verdict))
    assert isinstance(found, Judged)
    assert repr(found.verdict) == repr(verdict)


@pytest.mark.parametrize("covariance", [None, np.random.default_rng(2).normal(size=(8, 8))])
def test_an_order_comes_back_bit_for_bit(covariance) -> None:
    rotation, scale = np.random.default_rng(3).normal(size=(3, 3)), np.array([0.1 + 0.2, 1 / 3])
    reference = Calibration(
        rotation, (1, -1), scale, np.array([-0.0, 1e-300, 5.0]), (640, 480), covariance, (True,) * 7 + (False,), True
    )
    settings = EstimatorSettings(4, reference, Limits(rotation_deg=0.7), 123)
    found = again(message.line_started(settings, 17))
    assert isinstance(found, LineStarted)
    assert (found.step, found.settings.generation) == (17, 4)
    assert (found.settings.limits, found.settings.stale_ns) == (settings.limits, 123)
    for name in ("rotation", "scale_mm_per_px", "offset_mm", "covariance"):
        one, other = getattr(found.settings.reference, name), getattr(reference, name)
        assert (one is None and other is None) or one.tobytes() == other.tobytes(), name
    for name in ("polarity", "image_size_px", "observed", "simulated"):
        assert getattr(found.settings.reference, name) == getattr(reference, name)
    assert again(message.line_started(None, 0)) == LineStarted(None, 0)


def test_what_was_lost_is_a_number() -> None:
    assert again(message.lost(12)) == Lost(12)


@given(st.binary(max_size=60), st.binary(max_size=20))
def test_garbage_is_told_as_garbage(header, pixels) -> None:
    with pytest.raises(ProtocolError, match="not a message of the feed"):
        unpacked(header, pixels)


@given(st.recursive(st.none() | st.booleans() | ANY | st.text(), st.lists, max_leaves=5), st.data())
def test_a_field_of_another_kind_is_told_as_garbage_or_taken(value, data) -> None:
    """It raises nothing else."""
    texts = [
        message.taken_pose(3, Pose(Stamp(1, 2), 3, np.eye(4), 0.5, PoseStatus.OK)),
        message.taken_frame(3, Frame(Stamp(1, 2), 3, np.zeros((2, 2), np.uint8)), (2, 2), 1)[0],
        message.judged(3, Verdict(5, VerdictKind.OK, ())),
        message.hello("1"),
    ]
    fields = json.loads(data.draw(st.sampled_from(texts))[HEAD_BYTES:])
    fields[data.draw(st.sampled_from(sorted(fields)))] = value
    with contextlib.suppress(ProtocolError):
        unpacked(json.dumps(fields).encode(), b"1234")


@pytest.mark.parametrize("head", [(0, 0), (1, 0), (1 << 19, 0), (20, 1 << 27)])
def test_lengths_that_no_message_has_are_refused(head) -> None:
    with pytest.raises(ProtocolError, match="which no message has"):
        lengths(struct.pack(">II", *head))


def test_a_request_comes_back() -> None:
    request = FeedRequest(False, 3, 320)
    assert request_of(request.line()) == request
    assert request_of(b'{"v": 1}') == FeedRequest()


def test_a_field_that_means_nothing_is_told_in_the_first_word() -> None:
    asked = request_of(b'{"v": 1, "evry": 3, "pictures": false, "most-px\\u001b": 32}')
    assert (asked.every, asked.pictures, asked.most_px) == (1, False, None)
    said = json.loads(message.hello("1", asked.ignored)[HEAD_BYTES:])
    assert said["ignored"] == ["evry", "most-px\ufffd"]
    assert "ignored" not in json.loads(
        message.hello("1", request_of(FeedRequest(False, 3).line()).ignored)[HEAD_BYTES:]
    )
    many = json.dumps({"v": 1, **{f"{number}" * 90: 0 for number in range(99)}}).encode()
    assert len(json.dumps(request_of(many).ignored)) < 400, "a client cannot have itself told any amount"


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (b"", "not JSON"),
        (b"[" * 5000, "not JSON"),
        (b"[]", "v = 1"),
        (b'{"v": 2}', "version 1 is spoken here, and the request says v = 2"),
        (b'{"v": true}', "says v = True"),
        (b'{"v": 1, "every": NaN}', "not JSON: it has no NaN"),
        (b'{"v": 1, "pictures": false, "pictures": true}', "the field 'pictures' is given twice"),
        (b'{"v": 1, "every": 0}', "every"),
        (b'{"v": 1, "every": true}', "every"),
        (b'{"v": 1, "pictures": 1}', "pictures"),
        (b'{"v": 1, "most_px": 3}', "most_px"),
        (b'{"v": 1, "most_px": "\x1b"}', "not JSON"),
    ],
)
def test_a_request_that_cannot_be_meant_is_refused_in_words(line, says) -> None:
    with pytest.raises(ProtocolError, match=says):
        request_of(line)
