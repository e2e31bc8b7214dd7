"""The MetaImage sequence reader and writer, on files it wrote, on damaged files and on real ones."""

import tracemalloc
from contextlib import suppress
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from probewatch.drivers.errors import RecordingError
from probewatch.drivers.recordings.metaimage import read_metaimage
from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from probewatch.drivers.samples import PoseStatus
from tests.support.recordings import PERIOD_NS, SIZE_PX, START_NS, items, picture, plus_file, turn

ORIENTATIONS = [lateral + axial + third for lateral, axial, third in product("MU", "FN", ("", "A", "D"))]


@pytest.fixture
def raw(tmp_path):
    path = tmp_path / "raw.igs.mha"
    write_metaimage(path, items(), SIZE_PX, compressed=False)
    return path


def edit(path, old, new):
    data = path.read_bytes()
    assert old in data
    path.write_bytes(data.replace(old, new, 1))
    return path


@pytest.mark.parametrize("detached", [False, True])
@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_what_was_written_is_read(tmp_path, orientation, compressed, detached):
    path = tmp_path / ("a.mhd" if detached else "a.igs.mha")
    write_metaimage(path, items(), SIZE_PX, compressed=compressed, detached=detached, orientation=orientation)
    sequence = read_metaimage(path)
    assert sequence.size_px == (7, 5)
    assert [sequence.stamp_ns(index) for index in range(4)] == [START_NS + index * PERIOD_NS for index in range(4)]
    assert [sequence.sequence(index) for index in range(4)] == [100, 102, 104, 106]
    assert sequence.transform_names() == ["ProbeToTracker", "ReferenceToTracker"]
    pictures = list(sequence.pictures())
    assert len(pictures) == 4
    for index, image in enumerate(pictures):
        np.testing.assert_array_equal(image, picture(index))
        np.testing.assert_allclose(
            sequence.transform(index, "ProbeToTracker").matrix, turn(0.1 * index, 10.0 * index, 2)
        )


@pytest.mark.parametrize(
    ("orientation", "stored"),
    [("MFA", np.s_[:, :]), ("MN", np.s_[::-1, :]), ("UF", np.s_[:, ::-1]), ("UNA", np.s_[::-1, ::-1])],
)
def test_orientation_says_how_pixels_lie_in_the_file(tmp_path, orientation, stored):
    path = tmp_path / "a.igs.mha"
    write_metaimage(path, items(1), SIZE_PX, compressed=False, orientation=orientation)
    assert path.read_bytes().endswith(picture(0)[stored].tobytes())


def test_tracker_only_sequence_has_no_pictures(tmp_path):
    path = tmp_path / "poses.igs.mha"
    write_metaimage(path, [replace(item, image=None) for item in items()], None)
    sequence = read_metaimage(path)
    assert sequence.size_px is None
    assert list(sequence.pictures()) == []
    assert len(sequence.frames) == 4
    assert b"DimSize = 0 0 4" in path.read_bytes()


def test_order_of_keys_blanks_and_line_ends_do_not_matter(raw):
    header, data = raw.read_bytes().split(b"ElementDataFile = LOCAL\n")
    lines = sorted(header.decode().splitlines(), reverse=True)
    raw.write_bytes("".join(f"{line}   \r\n" for line in lines).encode() + b"ElementDataFile = LOCAL\r\n" + data)
    sequence = read_metaimage(raw)
    np.testing.assert_array_equal(next(iter(sequence.pictures())), picture(0))
    assert sequence.stamp_ns(3) == START_NS + 3 * PERIOD_NS


def test_fourth_dimension_of_one_plane_is_accepted(raw):
    edit(raw, b"DimSize = 7 5 4", b"DimSize = 7 5 1 4")
    assert read_metaimage(raw).size_px == (7, 5)


@pytest.mark.parametrize(
    ("text", "ns"),
    [
        ("1840749.750288", 1_840_749_750_288_000),
        ("1e3", 10**12),
        ("0", 0),
        ("1e-999999999", 0),
        ("1700000000.123456789", 1700000000123456789),
    ],
)
def test_stamps_are_exact_nanoseconds(raw, text, ns):
    edit(raw, b"Seq_Frame0000_Timestamp = 2588.141729000", f"Seq_Frame0000_Timestamp = {text}".encode())
    assert read_metaimage(raw).stamp_ns(0) == ns


@pytest.mark.parametrize("text", ["nan", "inf", "", "12 s", "1e999999999", "-1e999999999", "1e15"])
def test_a_stamp_that_is_no_time_is_refused(raw, text):
    edit(raw, b"Seq_Frame0000_Timestamp = 2588.141729000", f"Seq_Frame0000_Timestamp = {text}".encode())
    with pytest.raises(RecordingError, match="Seq_Frame0000_Timestamp"):
        read_metaimage(raw).stamp_ns(0)


def test_a_missing_stamp_is_refused(raw):
    edit(raw, b"Seq_Frame0002_Timestamp", b"Seq_Frame0002_Timestomp")
    with pytest.raises(RecordingError, match="Seq_Frame0002_Timestamp is missing"):
        read_metaimage(raw).stamp_ns(2)


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("ElementType = MET_UCHAR", "ElementType = MET_USHORT", "ElementType is 'MET_USHORT', not MET_UCHAR"),
        ("ElementType = MET_UCHAR", "Nothing = 1", "ElementType is ''"),
        ("ElementType = MET_UCHAR", "ElementType = MET_UCHAR\nElementNumberOfChannels = 2", "ElementNumberOfChannels"),
        ("BinaryData = True", "BinaryData = False", "BinaryData is 'False'"),
        ("Orientation = MFA", "Orientation = XX", "UltrasoundImageOrientation 'XX'"),
        ("Orientation = MFA", "Orientation = FM", "UltrasoundImageOrientation 'FM'"),
        ("UltrasoundImageOrientation = MFA", "Nothing = 1", "UltrasoundImageOrientation is missing"),
        ("DimSize = 7 5 4", "DimSize = 7 5", "DimSize '7 5'"),
        ("DimSize = 7 5 4", "DimSize = 7 5 3 4", "DimSize '7 5 3 4'"),
        ("DimSize = 7 5 4", "DimSize = 7 -5 4", "DimSize '7 -5 4'"),
        ("DimSize = 7 5 4", "DimSize = 7 five 4", "DimSize 'five'"),
        ("DimSize = 7 5 4", "DimSize = 999999 999999 4", "DimSize '999999 999999 4'"),
        ("DimSize = 7 5 4", "DimSize = 7 5 999999999999", "says 999999999999 frames"),
        ("DimSize = 7 5 4", "DimSize = 7 5 3", "says 3 frames, the header has fields of 4"),
        ("DimSize = 7 5 4", "DimSize = 7 6 4", "promises 168 bytes of pictures, raw.igs.mha has 140"),
        ("DimSize = 7 5 4", "DimSize = 7 4 4", "promises 112 bytes of pictures, raw.igs.mha has 140"),
        ("DimSize = 7 5 4", "Nothing = 1", "DimSize is missing"),
        ("NDims = 3", "no equals sign", "'no equals sign' is not 'key = value'"),
        ("NDims = 3", "NDims = " + 70_000 * "3", "is not 'key = value'"),
        ("ElementDataFile = LOCAL", "ElementDataFile = gone.raw", "gone.raw: cannot be read: No such file"),
        ("ElementDataFile = LOCAL", "ElementDataFile = LIST", "a file for each picture"),
        ("ElementDataFile = LOCAL", "ElementDataFile = slice%03d.raw 1 4 1", "a file for each picture"),
        ("DimSize = 7 5 4", "DimSize = 7 5 0", "holds no frames"),
        ("ObjectType = Image", "NRRD0004", "NRRD"),
    ],
)
def test_bad_headers_are_refused_with_key_and_value(raw, old, new, named):
    edit(raw, old.encode(), new.encode())
    with pytest.raises(RecordingError) as refusal:
        read_metaimage(raw)
    assert named in str(refusal.value)
    assert refusal.value.remedy
    assert "\n" not in str(refusal.value)


def test_stated_orientation_replaces_a_missing_one(raw):
    edit(raw, b"UltrasoundImageOrientation = MFA", b"Nothing = 1")
    image = next(iter(read_metaimage(raw, "UN").pictures()))
    np.testing.assert_array_equal(image, picture(0)[::-1, ::-1])


def test_a_missing_file_and_a_directory_are_refused(tmp_path):
    for path in (tmp_path / "none.igs.mha", tmp_path):
        with pytest.raises(RecordingError, match="cannot be read"):
            read_metaimage(path)


def test_damaged_zlib_data_are_refused(tmp_path):
    path = tmp_path / "a.igs.mha"
    write_metaimage(path, items(20, (40, 30)), (40, 30))
    data = bytearray(path.read_bytes())
    data[-3000] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(RecordingError, match="damaged"):
        list(read_metaimage(path).pictures())


def test_more_or_fewer_pictures_than_frames_are_refused(tmp_path):
    for height, complaint in ((4, "more or less picture data"), (6, "cut short")):
        path = tmp_path / "a.igs.mha"
        write_metaimage(path, items(), SIZE_PX)
        edit(path, b"DimSize = 7 5 4", f"DimSize = 7 {height} 4".encode())
        with pytest.raises(RecordingError, match=complaint):
            list(read_metaimage(path).pictures())


def read_everything(path):
    sequence = read_metaimage(path)
    for index in range(len(sequence.frames)):
        sequence.stamp_ns(index)
        sequence.sequence(index)
        for name in sequence.transform_names():
            reading = sequence.transform(index, name)
            assert (reading.matrix is not None) == (reading.status is PoseStatus.OK)
    return len(list(sequence.pictures()))


ON_ONE_FILE = settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@ON_ONE_FILE
@given(share=st.floats(0, 1, exclude_max=True), compressed=st.booleans())
def test_every_truncation_is_refused(tmp_path, share, compressed):
    path = tmp_path / "cut.igs.mha"
    write_metaimage(path, items(), SIZE_PX, compressed=compressed)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(RecordingError):
        read_everything(path)


@ON_ONE_FILE
@given(
    where=st.floats(0, 1, exclude_max=True),
    length=st.integers(0, 40),
    patch=st.one_of(st.binary(max_size=20), st.text(" 0123456789-+.eEnaif=\n", max_size=20).map(str.encode)),
)
def test_no_mutation_escapes_as_another_error(raw, where, length, patch):
    data = raw.read_bytes()
    at = int(where * len(data))
    mutated = raw.with_name("mutated.igs.mha")
    mutated.write_bytes(data[:at] + patch + data[at + length :])
    with suppress(RecordingError):
        assert read_everything(mutated) >= 0


def test_reading_holds_one_picture_at_a_time(tmp_path):
    size_px = (400, 300)
    path = tmp_path / "long.igs.mha"
    write_metaimage(path, (item for item in items(40, size_px)), size_px)
    tracemalloc.start()
    try:
        for _ in read_metaimage(path).pictures():
            pass
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 1_500_000 < 40 * 400 * 300


def test_a_failed_write_leaves_the_old_file(raw):
    before = raw.read_bytes()

    def breaking():
        yield items()[0]
        raise RuntimeError("disk full, say")

    with pytest.raises(RuntimeError):
        write_metaimage(raw, breaking(), SIZE_PX)
    with pytest.raises(ValueError, match="image is"):
        write_metaimage(raw, items(1, (6, 5)), SIZE_PX)
    assert raw.read_bytes() == before
    assert [path.name for path in Path(raw.parent).iterdir()] == [raw.name]


@pytest.mark.parametrize(
    ("name", "count", "size_px", "first_ns", "last_ns"),
    [
        ("fCal_Test_Validation_3NWires_fCal2.0", 103, (820, 616), 2_588_141_729_000, 2_596_109_214_000),
        ("NwirePhantomFreehand", 97, (820, 616), 345_627_957_000, 355_783_014_000),
        ("WaterTankBottomTranslationVideoBuffer", 201, (820, 616), 7_417_731_300_000, 7_435_148_643_000),
        ("WaterTankBottomTranslationTrackerBuffer-trimmed", 801, None, 7_415_679_586_000, 7_436_385_229_000),
        ("TimestampFilteringTest", 500, None, 1_840_749_750_288_000, 1_840_781_950_475_000),
    ],
)
def test_real_recordings(name, count, size_px, first_ns, last_ns):
    sequence = read_metaimage(plus_file(f"{name}.igs.mha"))
    assert (len(sequence.frames), sequence.size_px) == (count, size_px)
    assert (sequence.stamp_ns(0), sequence.stamp_ns(count - 1)) == (first_ns, last_ns)
    shapes = {image.shape for image in sequence.pictures()}
    assert shapes == (set() if size_px is None else {(616, 820)})


def test_real_pictures_are_upright():
    """An MFA recording of nine wires: one echo lies low and right of the middle, none at its mirror places."""
    first = next(iter(read_metaimage(plus_file("fCal_Test_Validation_3NWires_fCal2.0.igs.mha")).pictures()))
    assert first[445:470, 510:545].max() > 200
    assert max(flip[445:470, 510:545].max() for flip in (first[::-1], first[:, ::-1], first[::-1, ::-1])) < 20


@pytest.mark.parametrize(
    ("name", "head", "kind", "way"),
    [
        ("scan.bag", b"#ROSBAG V2.0\n", "a ROS bag", "while PLUS records"),
        ("scan.mcap", b"\x89MCAP0\r\n", "a black box or a ROS bag", "probewatch replay"),
        ("scan.dcm", bytes(128) + b"DICM", "a DICOM file", "record pictures and poses"),
        ("device.xml", b"<PlusConfiguration>", "an XML file", "--calibration"),
        ("scan.zip", b"PK\x03\x04", "a ZIP archive", "Unpack"),
        ("scan.mnc", b"CDF\x01", "a NetCDF or MINC file", "as a PLUS sequence"),
        ("scan.mpg", b"\0\0\1\xba", "an MPEG film", "Convert it"),
        ("scan.tfm", b"#Insight Transform File V1.0\n", "a transform of ITK", "calibration import"),
        ("scan.igs.mha", b"version https://git-lfs.github.com/spec/v1\n", "a pointer of Git LFS", "git lfs pull"),
        ("scan.igs.mha", b"<!DOCTYPE html>\n", "a web page", "download has failed"),
        ("scan.igs.mha", bytes(10), "of a kind that is not known", "Give a PLUS"),
    ],
)
def test_a_recording_of_another_program_is_named_with_the_way_to_go(
    tmp_path: Path, name: str, head: bytes, kind: str, way: str
) -> None:
    path = tmp_path / name
    path.write_bytes(head + bytes(1000))
    with pytest.raises(RecordingError) as refusal:
        read_metaimage(path)
    assert refusal.value.what.startswith(f"is {kind}")
    assert way in refusal.value.remedy
    assert refusal.value.exit_code == 65
