"""Sequences as other programs write them: names of fields, numbers of frames, colours, times of an axis."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk  # noqa: N813  as its documentation does

from probewatch.drivers.errors import RecordingError
from probewatch.drivers.recordings.keys import IMAGE_STATUS, NAMES, ORIENTATION, known
from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from probewatch.drivers.recordings.nrrd import write_nrrd
from probewatch.drivers.recordings.replay import open_recording
from probewatch.drivers.recordings.sequence import read_sequence
from probewatch.drivers.samples import PoseStatus
from tests.support.recordings import SIZE_PX, items, picture


@pytest.mark.parametrize("field", NAMES)
def test_each_name_of_a_field_is_read(field: str) -> None:
    for name in NAMES[field]:
        assert known({name: "x", "Timestamp": "1"}, Path("a")) == {field: "x", "Timestamp": "1"}
    assert known(dict.fromkeys(NAMES[field], "x"), Path("a")) == {field: "x"}
    one, other = NAMES[field]
    with pytest.raises(RecordingError, match=f"a: says {one} 'MF' and {other} 'UN', which contradict one another"):
        known({one: "MF", other: "UN"}, Path("a"))


CONTRADICTIONS = [
    (".igs.nrrd", "ultrasound image orientation:=MFA", "ultrasound image orientation:=UNA", "image orientation 'UNA'"),
    (".igs.nrrd", "Frame0002_Status:=INVALID", "Frame0002_Status:=OK", "Seq_Frame0002_Status 'OK'"),
    (".igs.nrrd", "dimension: 4", "dimension: 4\ntype: ushort", "type 'uchar' and type 'ushort'"),
    (".igs.nrrd", "dimension: 4", "dimension: 4\ndata file: a.raw\ndatafile: b.raw", "datafile 'b.raw'"),
    (".igs.nrrd", "dimension: 4", "dimension: 4\nbyteskip: 3\nbyte skip: 4", "byteskip '3'"),
    (".igs.nrrd", "dimension: 4", "dimension: 4\nline skip: 0\nlineskip: 4", "lineskip '4'"),
    (".igs.mha", "NDims = 3", "NDims = 3\nDimSize = 1 2 3", "DimSize '1 2 3'"),
    (".igs.mha", "Seq_Frame0001_Timestamp", "Seq_Frame0002_Timestamp = 7\nSeq_Frame0001_Timestamp", "_Timestamp '7'"),
]


@pytest.mark.parametrize(("suffix", "old", "new", "said"), CONTRADICTIONS)
def test_a_header_that_contradicts_itself_is_refused(
    tmp_path: Path, suffix: str, old: str, new: str, said: str
) -> None:
    """The reader used to take one of two orientations, and the last value of a doubled key, without a remark."""
    path = written(tmp_path / f"scan{suffix}", (old, new))
    with pytest.raises(RecordingError, match="which contradict one another") as told:
        read_sequence(path)
    assert said in told.value.what


def test_an_orientation_that_is_named_overrules_two_that_contradict_one_another(tmp_path: Path) -> None:
    new = "ultrasound image orientation:=UNA"
    path = written(tmp_path / "scan.igs.nrrd", ("ultrasound image orientation:=MFA", new))
    assert read_sequence(path, "MF").orientation == "MF"


def test_an_orientation_with_and_without_the_third_letter_is_the_same(tmp_path: Path) -> None:
    new = "ultrasound image orientation:=mf"
    path = written(tmp_path / "scan.igs.nrrd", ("ultrasound image orientation:=MFA", new))
    assert read_sequence(path).orientation == "MF"


@pytest.mark.parametrize(
    "name", ["Ultrasound Image Orientation", "ultrasound_image_orientation", "ULTRASOUNDIMAGEORIENTATION"]
)
@pytest.mark.parametrize("suffix", [".igs.mha", ".igs.nrrd"])
def test_capitals_and_blanks_of_a_name_make_no_difference(tmp_path: Path, name: str, suffix: str) -> None:
    key = "ultrasound image orientation:=" if suffix == ".igs.nrrd" else f"{ORIENTATION} = "
    path = written(tmp_path / f"scan{suffix}", (key, key.replace(key.rstrip(" :="), name)))
    path.write_bytes(path.read_bytes().replace(f"{ORIENTATION}:=MFA\n".encode(), b""))
    np.testing.assert_array_equal(next(read_sequence(path).pictures()), picture(0))


def written(path: Path, *changes: tuple[str, str]) -> Path:
    """Four frames, the third without a picture; then every old text is a new one."""
    four = [replace(item, image=None) if k == 2 else item for k, item in enumerate(items())]
    (write_nrrd if path.suffix == ".nrrd" else write_metaimage)(path, four, SIZE_PX)
    data = path.read_bytes()
    for old, new in changes:
        assert old.encode() in data
        data = data.replace(old.encode(), new.encode())
    path.write_bytes(data)
    return path


def test_what_plus_marks_as_invalid_in_nrrd_is_no_picture(tmp_path: Path) -> None:
    """`Seq_Frame0002_Status` of vtkPlusSequenceIO, and no other word for it."""
    path = written(tmp_path / "scan.igs.nrrd", ("_ImageStatus", "_Somebodys"))
    assert [read_sequence(path).image_ok(k) for k in range(4)] == [True, True, False, True]


def test_what_we_export_as_nrrd_has_the_keys_of_plus(tmp_path: Path) -> None:
    header = written(tmp_path / "scan.igs.nrrd").read_bytes().partition(b"\n\n")[0].decode()
    for line in ("ultrasound image orientation:=MFA", "Seq_Frame0002_Status:=INVALID", f"{ORIENTATION}:=MFA"):
        assert line in header.splitlines()
    assert f"Seq_Frame0002_{IMAGE_STATUS}:=INVALID" in header


def test_the_orientation_of_plus_in_nrrd_turns_the_picture(tmp_path: Path) -> None:
    path = written(tmp_path / "scan.igs.nrrd", (f"{ORIENTATION}:=MFA\n", ""), ("orientation:=MFA", "orientation:=MNA"))
    np.testing.assert_array_equal(next(read_sequence(path).pictures()), picture(0)[::-1])


def test_a_pressed_button_of_a_tool_is_no_bad_pose(tmp_path: Path) -> None:
    """PLUS's word for it, which the live driver takes as well."""
    word = ("ProbeToTrackerTransformStatus = OK", "ProbeToTrackerTransformStatus = SWITCH1_IS_ON")
    reading = read_sequence(written(tmp_path / "scan.igs.mha", word)).transform(0, "ProbeToTracker")
    assert (reading.status, reading.matrix is None) == (PoseStatus.OK, False)


@pytest.mark.parametrize("suffix", [".igs.mha", ".igs.nrrd"])
def test_frames_may_be_numbered_from_one(tmp_path: Path, suffix: str) -> None:
    by_one = [(f"Seq_Frame{k:04d}", f"Seq_Frame{k + 1:04d}") for k in (3, 2, 1, 0)]
    path = written(tmp_path / f"scan{suffix}", *by_one)
    assert [read_sequence(path).stamp_ns(k) for k in range(4)] == [item.t_ns for item in items()]
    by_six = [(f"Seq_Frame{k + 1:04d}", f"Seq_Frame{k + 7:04d}") for k in (3, 2, 1, 0)]
    with pytest.raises(RecordingError, match="numbers its 4 frames from 7 to 10"):
        read_sequence(written(tmp_path / f"seven{suffix}", *by_one, *by_six))


@pytest.mark.parametrize("suffix", [".igs.mha", ".igs.nrrd"])
def test_a_frame_that_is_left_out_is_named(tmp_path: Path, suffix: str) -> None:
    """By a script that keeps every second frame, or that forgot one."""
    by_two = [(f"Seq_Frame{k:04d}", f"Seq_Frame{2 * k:04d}") for k in (3, 2, 1)]
    with pytest.raises(RecordingError, match=r"numbers its 4 frames from 0 to 6, without 1. Number them one after"):
        read_sequence(written(tmp_path / f"two{suffix}", *by_two))
    with pytest.raises(RecordingError, match=r"fields of 3, numbered 0 to 3, none of frame 2. Give that frame"):
        read_sequence(written(tmp_path / f"forgot{suffix}", ("Seq_Frame0002", "Other")))


def test_a_time_with_a_decimal_comma_is_told_as_that(tmp_path: Path) -> None:
    path = written(tmp_path / "scan.igs.mha", ("Timestamp = 2588.", "Timestamp = 2588,"))
    with pytest.raises(
        RecordingError, match=r"'2588,141729000' is not a time in seconds. Write it with a decimal point"
    ):
        read_sequence(path).stamp_ns(0)


def test_capitals_of_a_field_of_nrrd_make_no_difference(tmp_path: Path) -> None:
    """As its definition says of fields, and not of keys."""
    fields = [(f"\n{name}: ", f"\n{name.upper()}: ") for name in ("type", "sizes", "kinds", "encoding")]
    path = written(tmp_path / "scan.nrrd", *fields)
    np.testing.assert_array_equal(next(read_sequence(path).pictures()), picture(0))


@pytest.mark.parametrize("skipped", [3, -1])
def test_what_stands_before_the_pictures_of_another_file_is_skipped(tmp_path: Path, skipped: int) -> None:
    """HeaderSize of MetaImage, byte skip of NRRD; -1: the pictures end with the file."""
    write_metaimage(tmp_path / "scan.mhd", items(), SIZE_PX, compressed=False, detached=True)
    for place, line, said in (
        ("scan.mhd", f"HeaderSize = {skipped}\n", "Correct DimSize, or say by HeaderSize how many bytes stand before"),
        ("scan.nhdr", f"byte skip: {skipped}\n", "Correct sizes, or say by byte skip how many bytes stand before"),
    ):
        raw = tmp_path / "scan.raw"
        raw.write_bytes(b"own" + b"".join(picture(k).tobytes() for k in range(4)))
        if place == "scan.mhd":
            text = (tmp_path / place).read_text().replace("ElementDataFile", f"{line}ElementDataFile")
        else:
            head = (
                f"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 7 5 4\nkinds: domain domain list\nencoding: raw\n{line}"
            )
            text = f"{head}data file: scan.raw\naxis 2 index values:=0 1 2 3\n"
        (tmp_path / place).write_text(text)
        np.testing.assert_array_equal(
            list(read_sequence(tmp_path / place, "MF").pictures()), [picture(k) for k in range(4)]
        )

        (tmp_path / place).write_text(text.replace(f" {skipped}\n", " 0\n"))
        with pytest.raises(RecordingError, match=said):
            read_sequence(tmp_path / place, "MF")


@pytest.mark.parametrize(
    ("path", "old", "new", "told"),
    [
        (
            "scan.igs.nrrd",
            "encoding: gzip",
            "byte skip: 3\nencoding: gzip",
            "byte skip is 3, which is read of pictures in",
        ),
        ("scan.igs.nrrd", "encoding: gzip", "line skip: 2\nencoding: gzip", "line skip is not 0"),
        ("scan.igs.mha", "ElementDataFile", "HeaderSize = 3\nElementDataFile", "HeaderSize is 3, which is read of"),
    ],
)
def test_what_is_to_be_skipped_and_is_not_is_refused(tmp_path: Path, path: str, old: str, new: str, told: str) -> None:
    with pytest.raises(RecordingError, match=told):
        read_sequence(written(tmp_path / path, (old, new)))


@pytest.mark.parametrize("colours", [1, 3])
def test_a_volume_or_a_picture_in_nrrd_is_said_to_be_one(tmp_path: Path, colours: int) -> None:
    """As SimpleITK writes it; a CT has another type as well, which is not what is wrong with it."""
    for shape, kind, told in (
        ((6, 5, 7), np.uint8, "volume"),
        ((6, 5, 7), np.int16, "volume"),
        ((5, 7), np.uint8, "single"),
    ):
        pixels = np.zeros((*shape, colours) if colours > 1 else shape, kind)
        sitk.WriteImage(sitk.GetImageFromArray(pixels, isVector=colours > 1), str(tmp_path / "one.nrrd"))
        with pytest.raises(RecordingError, match=f"is a {told}.*not a sequence. It has neither times nor poses"):
            read_sequence(tmp_path / "one.nrrd")


def test_a_volume_is_said_to_be_one(tmp_path: Path) -> None:
    sitk.WriteImage(sitk.GetImageFromArray(np.zeros((6, 5, 7), np.uint8)), str(tmp_path / "volume.mha"))
    with pytest.raises(RecordingError, match=r"6 pictures, and none of them has a field of its own.*It is a volume"):
        read_sequence(tmp_path / "volume.mha")


def luma(colour: np.ndarray) -> np.ndarray:
    """ITU-R BT.601, as scanners' and grabbers' grey is."""
    return colour[..., :3].astype(float) @ [0.299, 0.587, 0.114]


def as_itk(colours: np.ndarray, path: Path) -> None:
    volume = sitk.GetImageFromArray(colours, isVector=True)
    volume.SetMetaData(ORIENTATION, "MF")
    for index in range(len(colours)):
        volume.SetMetaData(f"Seq_Frame{index:04d}_Timestamp", f"{index / 10}")
    sitk.WriteImage(volume, str(path))


@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("name", ["rgb.mha", "rgb.nrrd"])
def test_colour_is_made_grey(tmp_path: Path, name: str, channels: int) -> None:
    """As written by SimpleITK, which calls the pictures of a sequence a third axis of space."""
    colours = np.random.default_rng(3).integers(0, 256, (3, *SIZE_PX[::-1], channels), np.uint8)
    as_itk(colours, tmp_path / name)
    for grey, colour in zip(read_sequence(tmp_path / name).pictures(), colours, strict=True):
        np.testing.assert_allclose(grey, luma(colour), atol=0.6)


def test_a_slicer_sequence_has_its_times_on_an_axis(tmp_path: Path) -> None:
    """Poses come from another file; a sequence of eight hours has them all in one line."""
    head = "NRRD0004\ntype: unsigned char\ndimension: 4\nsizes: 7 5 1 4\nkinds: domain domain domain list\n"
    times = "encoding: raw\naxis 3 index type:=numeric\naxis 3 index values:=0.5 0.58 0.66 0.74\n\n"
    (tmp_path / "scan.seq.nrrd").write_bytes((head + times).encode() + b"".join(picture(k).tobytes() for k in range(4)))
    sequence = read_sequence(tmp_path / "scan.seq.nrrd", "MF")
    assert [sequence.stamp_ns(k) for k in range(4)] == [500_000_000, 580_000_000, 660_000_000, 740_000_000]
    np.testing.assert_array_equal(list(sequence.pictures())[3], picture(3))
    poses = [replace(item, t_ns=500_000_000 + k * 80_000_000, image=None) for k, item in enumerate(items())]
    write_metaimage(tmp_path / "poses.mha", poses, None)
    recording = open_recording(tmp_path / "scan.seq.nrrd", poses=tmp_path / "poses.mha", orientation="MF")
    assert recording.size_px == SIZE_PX


def slicer(path: Path, index: str) -> Path:
    """A sequence of 3D Slicer whose axis of pictures is described by these lines."""
    head = "NRRD0004\ntype: unsigned char\ndimension: 4\nsizes: 7 5 1 4\nkinds: domain domain domain list\n"
    path.write_bytes((head + "encoding: raw\n" + index + "\n\n").encode() + bytes(7 * 5 * 4))
    return path


@pytest.mark.parametrize(
    ("unit", "values"), [("s", "0.5 0.58 0.66 0.74"), ("ms", "500 580 660 740"), ("us", "5e5 5.8e5 6.6e5 7.4e5")]
)
def test_times_of_a_slicer_sequence_have_the_unit_of_their_axis(tmp_path: Path, unit: str, values: str) -> None:
    index = f'labels: "" "" "" "time"\nunits: "mm" "mm" "mm" "{unit}"\naxis 3 index values:={values}'
    sequence = read_sequence(slicer(tmp_path / "scan.seq.nrrd", index), "MF")
    assert [sequence.stamp_ns(k) for k in range(4)] == [500_000_000, 580_000_000, 660_000_000, 740_000_000]


@pytest.mark.parametrize(
    ("index", "what"),
    [
        ("axis 3 index type:=text\naxis 3 index values:=0 1 2 3", "are of type 'text'"),
        ('labels: "" "" "" "frame"\naxis 3 index values:=0 1 2 3', "are 'frame' without a unit"),
        ('labels: "" "" "" "%R-R"\nunits: "" "" "" "%"\naxis 3 index values:=0 25 50 75', "are '%R-R' in '%'"),
    ],
)
def test_an_axis_that_only_counts_has_no_times(tmp_path: Path, index: str, what: str) -> None:
    """Pictures 0 1 2 3 were taken for pictures a second apart, and the report was of that."""
    with pytest.raises(RecordingError) as told:
        read_sequence(slicer(tmp_path / "scan.seq.nrrd", index), "MF")
    assert f"axis 3 index values {what}: no times of pictures" in str(told.value)
    assert "unit s" in str(told.value)


def test_what_older_slicers_stored_pixel_by_pixel_is_said(tmp_path: Path) -> None:
    path = written(tmp_path / "old.nrrd", ("kinds: domain domain domain list", "kinds: list domain domain domain"))
    with pytest.raises(RecordingError, match=r"pixel by pixel, as older versions of 3D Slicer do. Open it in a newer"):
        read_sequence(path)
