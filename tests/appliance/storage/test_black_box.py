"""Black boxes: what comes back is what was put in, bit for bit, whatever becomes of the file's end."""

import io
import json
from dataclasses import replace
from itertools import pairwise
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType, IndexType, Writer

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.core.exact_fields import calibration_fields, calibration_of, verdict_fields
from probewatch.appliance.limits import Limits
from probewatch.appliance.storage.black_box import CHUNK_NS, SCHEMAS, BlackBox, BlackBoxWriter, series_of
from probewatch.appliance.storage.black_box_fields import Begun, Gap, Item, Made, Mark, State, fields_of, item_of
from probewatch.appliance.types import Calibration, Check, Fault, PointError, Rival, Verdict, VerdictKind
from probewatch.drivers.errors import RecordingError
from probewatch.drivers.recordings.mcap_file import MAGIC
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp
from tests.support.recordings import picture, turn

BEGUN = Begun(1, "probewatch 0", "2026-01-02T03:04:05+00:00", 5_000_000_000, "abc", 1, ("sim:x",), "kept")
REFERENCE = Calibration(
    np.eye(3), (1, -1), np.array([0.1, 1 / 3]), np.array([1.0, 1e-300, -0.0]), (7, 5), np.eye(8) / 3
)
CHECK = Check("latency", Fault.LATENCY, nan, inf, "ms", 60.0, VerdictKind.NOT_VERIFIED, 12)
VERDICT = Verdict(77, VerdictKind.FAULT, (CHECK, replace(CHECK, value=0.1 + 0.2)), Fault.LATENCY, "late", None)


def items(count: int, from_ns: int = 5_000_000_000, step_ns: int = 100_000_000) -> list[tuple[Item, int]]:
    """A picture, a pose and a verdict, ten times a second."""
    told: list[tuple[Item, int]] = [(Made(EstimatorSettings(1, REFERENCE, Limits(), 500), 0), from_ns)]
    for k in range(count):
        t_ns = from_ns + k * step_ns
        told += [
            (Frame(Stamp(t_ns, 500), k, picture(k)), t_ns),
            (
                Pose(Stamp(t_ns, 1), k, turn(0.1 * k, k / 3), nan, PoseStatus.OK, "", turn(0.2, k) if k % 2 else None),
                t_ns,
            ),
            (replace(VERDICT, t_ns=t_ns), t_ns),
        ]
    return told


def written(told: list[tuple[Item, int]], whole: bool = True) -> bytes:
    stream = io.BytesIO()
    writer = BlackBoxWriter(stream, BEGUN)
    for item, now_ns in told:
        writer.put(item, now_ns)
    if whole:
        writer.finish()
    return stream.getvalue()


def said(items: list[Item]) -> list[str]:
    """Every bit of them: JSON of Python floats is exact."""
    return [json.dumps(fields_of(item)) for item in items]


def read(path: Path, data: bytes) -> tuple[list[Item], list[str]]:
    path.write_bytes(data)
    box = BlackBox(path)
    return [told.item for told in box.items()], box.damage


def test_everything_comes_back_bit_for_bit_and_in_order(tmp_path: Path) -> None:
    told = items(25)
    told += [
        (Pose(Stamp(-3, 0), 9, None, inf, PoseStatus.MISSING, "ärmel"), 8_000_000_000),
        (State({"state": "halt", "t_ns": 3, "fault": None}), 8_000_000_000),
        (Gap("the disk was full", 3), 8_000_000_001),
        (Mark("alarm", "halt"), 8_000_000_002),
    ]
    found, damage = read(tmp_path / "a.mcap", written(told))
    wanted = [BEGUN, *(item for item, _ in told)]
    assert damage == []
    assert [type(one) for one in found] == [type(one) for one in wanted]
    assert said(found[:-4]) == said(wanted[:-4])
    assert found[-3:] == wanted[-3:]
    assert isinstance(found[-4], Pose)
    assert (found[-4].stamp, found[-4].rms_mm, found[-4].matrix) == (Stamp(-3, 0), inf, None)
    frames = [one for one in found if isinstance(one, Frame)]
    assert all(np.array_equal(frame.image, picture(k)) for k, frame in enumerate(frames))
    made = found[1]
    assert isinstance(made, Made)
    assert made.settings is not None
    assert made.settings.reference.offset_mm.tobytes() == REFERENCE.offset_mm.tobytes()


@given(st.floats(), st.floats(), st.integers(0, 2**63 - 1), st.text(max_size=20))
def test_any_verdict_comes_back(value: float, sigma: float, t_ns: int, reason: str) -> None:
    check = replace(CHECK, value=value, sigma=sigma, shown_ns=t_ns, rested_ns=t_ns // 3)
    verdict = replace(VERDICT, t_ns=t_ns, checks=(check,), reason=reason)
    topic, fields = fields_of(verdict)
    back = item_of(topic, json.loads(json.dumps(fields)))
    assert isinstance(back, Verdict)
    assert json.dumps(verdict_fields(back)) == json.dumps(fields)
    assert back.checks[0].rested_ns == t_ns // 3


def test_a_check_of_a_file_from_before_rests_were_told_has_none() -> None:
    topic, fields = fields_of(replace(VERDICT, checks=(CHECK,)))
    del fields["checks"][0]["rested_ns"]
    back = item_of(topic, fields)
    assert isinstance(back, Verdict)
    assert back.checks[0].rested_ns == 0


def test_the_radius_of_the_face_comes_back_and_files_from_before_it_have_none() -> None:
    fields = calibration_fields(replace(REFERENCE, face_radius_mm=50.8))
    assert calibration_of(fields).face_radius_mm == 50.8
    assert calibration_of(calibration_fields(REFERENCE)).face_radius_mm is None
    del fields["face_radius_mm"]
    assert calibration_of(fields).face_radius_mm is None


@pytest.mark.thorough
def test_a_file_cut_at_any_byte_yields_all_but_the_last_second_and_says_so(tmp_path: Path) -> None:
    told = items(42)
    data, path = written(told), tmp_path / "cut.mcap"
    flushed = written(told, whole=False)
    wanted, ends = said([BEGUN, *(item for item, _ in told)]), list[int]()
    for cut in range(len(MAGIC), len(data), 29):
        path.write_bytes(data[:cut])
        try:
            box = BlackBox(path)
        except RecordingError:
            ends.append(0)
            continue
        found = list(box.items())
        assert box.damage, f"cut at {cut} of {len(data)} and nothing said"
        assert said([one.item for one in found]) == wanted[: len(found)]
        ends.append(len(found))
    assert ends == sorted(ends)
    assert ends[-1] == len(wanted)
    jumps = [told[b - 2][1] - told[max(a - 1, 0)][1] for a, b in pairwise(ends) if b > a > 0]
    assert max(jumps) <= CHUNK_NS
    assert len(flushed) < len(data)


def test_what_was_not_flushed_is_less_than_a_second(tmp_path: Path) -> None:
    """As after a power failure: whatever the last put returned, a second before it is in the file."""
    for count in range(11, 40):
        path = tmp_path / f"{count}.mcap"
        told = items(count)
        path.write_bytes(written(told, whole=False))
        last = [one.now_ns for one in BlackBox(path).items()][-1]
        assert told[-1][1] - last <= CHUNK_NS


@pytest.mark.thorough
def test_a_flipped_bit_is_told_wherever_it_is(tmp_path: Path) -> None:
    data, path = written(items(42)), tmp_path / "flipped.mcap"
    wanted = said([BEGUN, *(item for item, _ in items(42))])
    for at in range(len(MAGIC), len(data) - len(MAGIC), 67):
        spoiled = bytearray(data)
        spoiled[at] ^= 1 << (at % 8)
        path.write_bytes(spoiled)
        try:
            box = BlackBox(path)
            found = said([one.item for one in box.items()])
        except RecordingError:
            continue
        assert box.damage, f"bit flipped at byte {at} of {len(data)}, nothing said"
        assert {one for one in found if "/gap" not in one} <= set(wanted), "what is damaged is not handed on"


def test_one_damaged_second_does_not_take_the_others_with_it(tmp_path: Path) -> None:
    told = items(42)
    data = bytearray(written(told))
    first = data.index(b"\x28\xb5\x2f\xfd", len(data) // 3)  # a zstd frame in the middle
    data[first + 60] ^= 0xFF
    found, damage = read(tmp_path / "a.mcap", bytes(data))
    assert len(damage) >= 1
    assert len(found) >= len(told) - 40
    assert isinstance(found[-1], Verdict)


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (b"", "not an MCAP"),
        (b"NRRD0004\n", "not an MCAP"),
        (MAGIC, "not a black box"),
        (MAGIC + bytes(200), "not a black box"),
    ],
)
def test_what_is_no_black_box_is_refused(tmp_path: Path, data: bytes, what: str) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=what):
        BlackBox(path)


def test_a_later_format_is_refused_by_its_number(tmp_path: Path) -> None:
    path, stream = tmp_path / "x.mcap", io.BytesIO()
    BlackBoxWriter(stream, replace(BEGUN, format=2)).finish()
    path.write_bytes(stream.getvalue())
    with pytest.raises(RecordingError, match="format 2"):
        BlackBox(path)


_ORDER = fields_of(Made(EstimatorSettings(1, REFERENCE, Limits(), 500), 0))[1]["order"]


@pytest.mark.parametrize(
    ("topic", "change"),
    [
        ("/pose", {"matrix": [1.0] * 15}),
        ("/pose", {"matrix": None}),
        ("/pose", {"t_ns": 1.5}),
        ("/pose", {"status": "fine"}),
        ("/picture", {"data": "AAAA"}),
        ("/picture", {"width": 100_000}),
        ("/picture", {"width": 6}),
        ("/verdict", {"verdict": "MAYBE"}),
        ("/verdict", {"checks": [3]}),
        ("/pose", {"t_ns": 1 << 70}),
        ("/order", {"order": {}}),
        ("/order", {"step": None}),
        *(
            ("/order", {"order": {**_ORDER, "reference": {**_ORDER["reference"], name: value}}})
            for name, value in (
                ("rotation", [2.0, 0, 0, 0, 2.0, 0, 0, 0, 2.0]),
                ("rotation", ["nan"] * 9),
                ("scale_mm_per_px", [0.0, 0.1]),
                ("scale_mm_per_px", ["inf", 0.1]),
                ("offset_mm", [1.0]),
                ("polarity", [0, 1]),
                ("polarity", [1]),
                ("image_size_px", [0, 5]),
                ("covariance", ["nan"] * 64),
            )
        ),
    ],
)
def test_a_message_that_is_not_as_documented_is_refused(topic: str, change: dict[str, object]) -> None:
    told: dict[str, Item] = {fields_of(item)[0]: item for item, _ in items(1)}
    _, fields = fields_of(told[topic])
    with pytest.raises(ValueError, match=r"."):
        item_of(topic, {**fields, **change})


def test_the_schemas_name_every_field() -> None:
    told = [item for item, _ in items(1)] + [BEGUN, Gap("x"), Mark("alarm", "y")]
    for topic, fields in map(fields_of, told):
        assert set(fields) == set(SCHEMAS[topic]["properties"]), topic
    order = fields_of(items(1)[0][0])[1]["order"]
    schema = SCHEMAS["/order"]["properties"]["order"]["anyOf"][0]["properties"]
    assert set(order) == set(schema)
    assert set(order["reference"]) == set(schema["reference"]["properties"])
    assert set(fields_of(VERDICT)[1]["checks"][0]) == set(
        SCHEMAS["/verdict"]["properties"]["checks"]["items"]["properties"]
    )


def test_the_schema_of_an_order_allows_what_limits_are() -> None:
    schema = SCHEMAS["/order"]["properties"]["order"]["anyOf"][0]["properties"]["limits"]["properties"]
    kinds = {"string": str, "null": type(None), "object": dict, "number": float}
    for name, value in Limits(profile="fine").model_dump().items():
        assert isinstance(value, tuple(kinds[kind] for kind in schema[name]["type"])), name


def test_rivals_come_back() -> None:
    rivals = tuple(Rival(check, behind) for check, behind in zip(VERDICT.checks, (0.0, 2.5), strict=True))
    topic, fields = fields_of(replace(VERDICT, rivals=rivals))
    back = item_of(topic, fields)
    assert isinstance(back, Verdict)
    assert [rival.behind_nats for rival in back.rivals] == [0.0, 2.5]
    assert json.dumps(verdict_fields(back)) == json.dumps(fields)
    del fields["rivals"]
    older = item_of(topic, fields)
    assert isinstance(older, Verdict)
    assert older.rivals == (), "of a version that knew of none"
    with pytest.raises(ValueError, match="not as documented"):
        item_of(topic, {**fields, "rivals": [3]})


def test_the_error_of_a_point_comes_back() -> None:
    for depth_mm, deep in ((None, None), (30.0, (0.1 + 0.2, 1 / 3))):
        point = PointError((1 / 7, 2 / 7), (1e-300, 0.3), depth_mm, deep, 12)
        topic, fields = fields_of(replace(VERDICT, point=point))
        back = item_of(topic, fields)
        assert isinstance(back, Verdict)
        assert back.point == point
        schema = SCHEMAS["/verdict"]["properties"]["point"]["anyOf"][0]
        assert set(fields["point"]) == set(schema["properties"])
    del fields["point"]
    older = item_of(topic, fields)
    assert isinstance(older, Verdict)
    assert older.point is None, "of a version that knew of none"


@pytest.mark.parametrize("change", [{"shown_ns": 1.5}, {"worst_mm": [1.0]}, {"median_mm": None}, {"depth_mm": []}])
def test_an_error_of_a_point_that_is_not_as_documented_is_refused(change: dict[str, object]) -> None:
    topic, fields = fields_of(replace(VERDICT, point=PointError((1.0, 2.0), (1.0, 2.0), None, None, 1)))
    with pytest.raises(ValueError, match=r"."):
        item_of(topic, {**fields, "point": fields["point"] | change})


def test_what_would_unpack_to_more_than_a_chunk_holds_is_left_out_unread(tmp_path: Path) -> None:
    """100 MB of one letter are 10 kB in the file."""
    told: list[tuple[Item, int]] = [*items(3), (Gap("x" * 100_000_000), 6_500_000_000), *items(3, 8_000_000_000)]
    data = written(told)
    assert len(data) < 200_000
    found, damage = read(tmp_path / "bomb.mcap", data)
    assert len(damage) == 1
    assert "is damaged" in damage[0]
    assert sum(isinstance(item, Frame) for item in found) == 6, "what lies around it is read"


def boxed(path: Path, *chunks: list[bytes]) -> BlackBox:
    """A file that begins as a black box; then chunks of such messages of /state."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=1 << 26, compression=CompressionType.ZSTD, index_types=IndexType.NONE)
    writer.start(library="hostile")
    schema = writer.register_schema("hostile", "jsonschema", b"{}")
    begun, state = (writer.register_channel(topic, "json", schema) for topic in ("/begun", "/state"))
    writer.add_message(begun, 0, json.dumps(fields_of(BEGUN)[1]).encode(), 0)
    for chunk in ([], *chunks):
        for data in chunk:
            writer.add_message(state, 0, data, 0)
        writer.flush()  # type: ignore[no-untyped-call]
    writer.finish()  # type: ignore[no-untyped-call]
    path.write_bytes(stream.getvalue())
    assert path.stat().st_size < 100_000
    return BlackBox(path)


def test_a_chunk_of_more_messages_than_a_second_has_is_left_out_as_one(tmp_path: Path) -> None:
    """18 kB of such chunks took .9 GB of memory and 40 s."""
    box = boxed(tmp_path / "a.mcap", [b""] * 200_000, [b"{}"])
    assert [type(told.item) for told in box.items()] == [Begun, Gap, State]
    assert len(box.damage) == 1


@pytest.mark.parametrize("data", [b'{"a":[' + b"0," * 200_000 + b"0]}", b'{"a":' + b"[" * 20_000], ids=["wide", "deep"])
def test_a_message_that_takes_memory_out_of_proportion_is_damage(tmp_path: Path, data: bytes) -> None:
    box = boxed(tmp_path / "a.mcap", [data], [b"{}"])
    assert [type(told.item) for told in box.items()] == [Begun, Gap, State]
    assert box.damage == ["a message of /state is not a JSON object"]


def test_a_file_that_is_damaged_all_over_is_not_read_to_its_end(tmp_path: Path) -> None:
    box = boxed(tmp_path / "a.mcap", *([b"["] * 600 for _ in range(5)))
    assert sum(isinstance(told.item, Gap) for told in box.items()) <= 1001
    assert len(box.damage) <= 1001
    assert "so much before it is damaged" in box.damage[-1]


def test_parts_of_any_numbers_are_one_recording_with_a_gap(tmp_path: Path) -> None:
    """Every number in between was counted up: two files of 1 kB took all memory."""
    boxes = []
    for part in (1, 1 << 60):
        stream = io.BytesIO()
        BlackBoxWriter(stream, replace(BEGUN, part=part)).finish()
        (path := tmp_path / f"{part}.mcap").write_bytes(stream.getvalue())
        boxes.append(BlackBox(path))
    (series,) = series_of(boxes)
    assert [type(told.item) for told in series.items()] == [Begun, Gap, Begun]
