"""Damaged replies by the million: protocol errors only, and no pose that was not sent."""

import math
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.samples import Matrix4
from probewatch.drivers.trackers.ndi.bx import encode_bx
from probewatch.drivers.trackers.ndi.bx2 import encode_bx2
from probewatch.drivers.trackers.ndi.identity import ReplyKind
from probewatch.drivers.trackers.ndi.outlier_gate import OutlierGate, turn_rad
from probewatch.drivers.trackers.ndi.readings import dialect
from probewatch.drivers.trackers.ndi.replies import Transform
from probewatch.drivers.trackers.ndi.tx import encode_tx
from probewatch.drivers.trackers.ndi.wire import EXTENDED_START, reply_length
from probewatch.drivers.twins.ndi.measurement import measure
from probewatch.drivers.twins.ndi.tool_definitions import MARKERS_MM
from probewatch.drivers.twins.ndi.tracking_replies import bx2_frame, bx2_options, tracking_reply

PERIOD_NS = 16_666_667
LEAP_MM, LEAP_RAD = 2.5, math.radians(2.0)
"""What a pose may differ from the one sent and still pass for a hand's motion at 60 Hz."""

DETAILS = 0x180B


def hand(tool: str, t_s: float, number: int = 0) -> Matrix4:
    """Smooth motion of an ordinary hand."""
    matrix = np.eye(4)
    shift = 0.0 if tool == "probe" else 200.0
    matrix[:3, :3] = Rotation.from_rotvec([0.4 * math.sin(t_s), 0.2, 0.1 * math.cos(2 * t_s)]).as_matrix()
    matrix[:3, 3] = (40 * math.sin(t_s) + shift, 30 * math.cos(t_s), -1500 + 10 * math.sin(3 * t_s))
    return matrix


def replies(kind: ReplyKind, frame: int, detailed: bool) -> bytes:
    """What a device with two tools sends at a frame."""
    markers = np.array(MARKERS_MM)
    measured = {
        handle: (0, measure(hand, tool, markers, 0.2, frame / 60, frame, {}))
        for handle, tool in ((1, "probe"), (2, "reference"))
    }
    if kind is ReplyKind.BX2:
        wanted = bx2_options("--6d=tools --3d=all" if detailed else "--6d=tools")
        return encode_bx2((bx2_frame(measured, frame, frame * PERIOD_NS, (), wanted, magnetic=False),))
    options = DETAILS if detailed else 0x0801
    encode = encode_bx if kind is ReplyKind.BX else encode_tx
    return encode(tracking_reply(measured, frame, 0, options), options)


@dataclass
class Case:
    """One reply as it was sent. history: a watch that has seen the frames before it."""

    kind: ReplyKind
    detailed: bool
    data: bytes
    sent: dict[int, Transform]
    history: list[Transform]


def case(kind: ReplyKind, detailed: bool) -> Case:
    read = dialect(kind)
    transforms = []
    for frame in range(100, 104):
        reading = read.decode(replies(kind, frame, detailed), detailed).tools[1]
        assert reading.transform is not None
        transforms.append(reading.transform)
    data = replies(kind, 104, detailed)
    said = read.decode(data, detailed).tools
    sent = {handle: reading.transform for handle, reading in said.items() if reading.transform is not None}
    return Case(kind, detailed, data, sent, transforms)


CASES = [case(kind, detailed) for kind in ReplyKind for detailed in (False, True)]


def believed(case: Case, transform: Transform) -> bool:
    """Whether the driver would pass this pose on after the frames before it, without asking again."""
    watch = OutlierGate()
    for i, earlier in enumerate(case.history):
        watch.believes((100 + i) * PERIOD_NS, earlier)
    return watch.believes(104 * PERIOD_NS, transform)


def mutated(reply: bytes, draw: np.random.Generator) -> bytes:
    """One to four bytes changed, or a piece cut out, doubled, or replaced; always different from the reply."""
    data = bytearray(reply)
    kind, at = draw.integers(0, 4), int(draw.integers(0, len(data)))
    if kind == 0:
        del data[at : at + int(draw.integers(1, 9))]
    elif kind == 1:
        data[at:at] = data[at : at + int(draw.integers(1, 9))]
    else:
        for spot in {at, *draw.integers(0, len(data), int(kind))}:
            data[spot] ^= int(draw.integers(1, 256))
    return bytes(data)


def verdict(case: Case, data: bytes) -> str:
    """What becomes of damaged bytes; raises whatever is no protocol error, and for a wrong pose that is passed on."""
    try:
        if data.startswith(EXTENDED_START) or reply_length(data) != len(data):
            return "refused"
        seen = dialect(case.kind).decode(data, case.detailed).tools
    except ProtocolError:
        return "refused"
    reading = seen.get(1)
    if reading is None or not reading.usable or reading.transform is None:
        return "no pose"
    if reading.transform == case.sent[1]:
        return "damage elsewhere"
    if not believed(case, reading.transform):
        return "leap"
    off_mm = math.dist(reading.transform.translation_mm, case.sent[1].translation_mm)
    assert off_mm <= LEAP_MM, case
    assert turn_rad(reading.transform, case.sent[1]) <= LEAP_RAD, case
    return "within a hand's motion"


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.kind.name}{' detailed' * case.detailed}")
def test_undamaged_replies_are_believed(case: Case) -> None:
    assert believed(case, case.sent[1])
    assert dialect(case.kind).decode(case.data, case.detailed).tools[1].usable


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.kind.name}{' detailed' * case.detailed}")
def test_a_few_thousand_damaged_replies(case: Case) -> None:
    draw = np.random.default_rng(11)
    counts = Counter(verdict(case, mutated(case.data, draw)) for _ in range(700))
    assert counts["refused"] == 700


@pytest.mark.slow
def test_1_200_000_damaged_replies_give_protocol_errors_and_no_pose_that_leaps(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A check sum of 16 bits passes one damage in 65536. Of those that change the pose, the second look catches what a
    hand could not do; what is left differs by less than 2.5 mm and 2°, and is counted here.
    """
    draw = np.random.default_rng(7)
    counts: Counter[str] = Counter()
    for number in range(1_200_000):
        chosen = CASES[number % len(CASES)]
        counts[verdict(chosen, mutated(chosen.data, draw))] += 1
    with capsys.disabled():
        print("", dict(counts))
    passed = counts.total() - counts["refused"]
    assert passed <= 60
    assert counts["within a hand's motion"] <= 12


@pytest.mark.slow
def test_the_second_look_alone() -> None:
    """Poses damaged under a check sum that was made right: no leap is passed on, whatever the bytes say."""
    draw = np.random.default_rng(8)
    counts: Counter[str] = Counter()
    for _ in range(200_000):
        chosen = CASES[int(draw.integers(0, len(CASES)))]
        transform = _damaged(chosen.sent[1], draw)
        if transform is None:
            counts["refused"] += 1
        elif believed(chosen, transform):
            counts["passed"] += 1
            assert math.dist(transform.translation_mm, chosen.sent[1].translation_mm) <= LEAP_MM
            assert turn_rad(transform, chosen.sent[1]) <= LEAP_RAD
        else:
            counts["leap"] += 1
    assert counts["leap"] > 10_000


def _damaged(transform: Transform, draw: np.random.Generator) -> Transform | None:
    """One bit of one of the seven single-precision numbers flipped; None where the values alone give it away."""
    values = np.array([*transform.quaternion, *transform.translation_mm], np.float32)
    values.view(np.uint32)[draw.integers(0, 7)] ^= np.uint32(1) << np.uint32(draw.integers(0, 32))
    q0, qx, qy, qz, x, y, z = map(float, values)
    try:
        return replace(transform, quaternion=(q0, qx, qy, qz), translation_mm=(x, y, z))
    except ProtocolError:
        return None
