"""Sequences as other programs write them: names of fields, numbers of frames, colours, times of an axis."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk  # noqa: N813  as its documentation does

from drivers.errors import RecordingError
from drivers.recordings.keys import IMAGE_STATUS, NAMES, ORIENTATION, known
from drivers.recordings.metaimage import write_metaimage
from drivers.recordings.nrrd import write_nrrd
from drivers.recordings.replay import open_recording
from drivers.recordings.sequence import read_sequence
from drivers.samples import PoseStatus
from tests.support.recordings import SIZE_PX, items, picture


@pytest.mark.parametrize("field", NAMES)
def test_each_name_of_a_field_is_read(field: str) -> None:
    for name in NAMES[field]:
        assert known({name: "x", "Timestamp": "1"}) == {field: "x", "Timestamp": "1"}
    assert known(dict.fromkeys(NAMES[field], "other") | {field: "own"})[field] == "own"


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


def test_what_older_slicers_stored_pixel_by_pixel_is_said(tmp_path: Path) -> None:
    path = written(tmp_path / "old.nrrd", ("kinds: domain domain domain list", "kinds: list domain domain domain"))
    with pytest.raises(RecordingError, match=r"pixel by pixel, as older versions of 3D Slicer do. Open it in a newer"):
        read_sequence(path)
