"""NRRD sequences: as PLUS and 3D Slicer store them, read by others, and refused where they are none."""

import gzip
import re
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk  # noqa: N813  as its documentation does

from probewatch.drivers.errors import RecordingError
from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from probewatch.drivers.recordings.nrrd import read_nrrd, write_nrrd
from probewatch.drivers.recordings.replay import open_recording
from probewatch.drivers.recordings.sequence import read_sequence
from probewatch.drivers.samples import Frame
from tests.support.recordings import SIZE_PX, items, picture, turn


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "scan.igs.nrrd"
    write_nrrd(path, items(), SIZE_PX)
    return path


def test_pictures_have_the_axes_that_slicer_reads(path: Path) -> None:
    """3D Slicer's own reader takes three spatial axes and a list, and refuses two; with these it read every pixel."""
    head = path.read_bytes().partition(b"\n\n")[0].decode().splitlines()
    assert {"dimension: 4", f"sizes: {SIZE_PX[0]} {SIZE_PX[1]} 1 4", "kinds: domain domain domain list"} <= {*head}


def test_it_says_the_same_as_a_metaimage(path: Path, tmp_path: Path) -> None:
    other = tmp_path / "scan.igs.mha"
    write_metaimage(other, items(), SIZE_PX)
    nrrd, mha = (list(open_recording(one).samples()) for one in (path, other))
    assert len(nrrd) == len(mha) == 8
    for one, two in zip(nrrd, mha, strict=True):
        assert (one.stamp, one.sequence) == (two.stamp, two.sequence)
        if isinstance(one, Frame):
            np.testing.assert_array_equal(one.image, two.image)
        else:
            assert one.matrix.tobytes() == two.matrix.tobytes()


def test_keys_with_a_colon_alone_are_named(path: Path) -> None:
    """The error used to say that no picture has fields of its own."""
    path.write_bytes(path.read_bytes().replace(b":=", b": "))
    with pytest.raises(RecordingError, match=r"header line 'Seq_Frame0000_.* has ': ' after its key. Write ':='"):
        read_nrrd(path)


@pytest.mark.parametrize("part", ["Seq_Frame0001_Time", "Seq_Frame0001_Timestamp:=", "dimen"])
def test_a_header_that_is_cut_within_a_line_is_cut(path: Path, part: str) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: data.index(part.encode())] + part.encode())
    with pytest.raises(RecordingError, match=f"the header ends within its line '{part}'. It is cut short"):
        read_nrrd(path)


@pytest.mark.parametrize(("suffix", "by", "right"), [(".igs.mha", "gzip", "zlib"), (".igs.nrrd", "zlib", "gzip")])
def test_pictures_that_are_compressed_by_another_program_are_not_damaged(tmp_path: Path, suffix, by, right) -> None:
    path = tmp_path / f"scan{suffix}"
    (write_nrrd if suffix == ".igs.nrrd" else write_metaimage)(path, items(), SIZE_PX)
    end = b"\n\n" if suffix == ".igs.nrrd" else b"ElementDataFile = LOCAL\n"
    head = re.sub(b"CompressedDataSize = .*\n", b"", path.read_bytes().partition(end)[0]) + end
    pixels = b"".join(picture(index).tobytes() for index in range(4))
    path.write_bytes(head + (gzip.compress(pixels) if by == "gzip" else zlib.compress(pixels)))
    with pytest.raises(
        RecordingError, match=f"are compressed by {by}, not as the header says. Compress them by {right}"
    ):
        list(read_sequence(path).pictures())


def test_a_byte_order_mark_is_no_part_of_a_name(tmp_path: Path) -> None:
    path = tmp_path / "scan.igs.mha"
    write_metaimage(path, items(), SIZE_PX)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert open_recording(path).notes == []


@pytest.mark.parametrize("write", [write_nrrd, write_metaimage])
def test_simpleitk_reads_equal_pixels_stamps_and_transforms(write, tmp_path: Path) -> None:
    path = tmp_path / ("scan.igs.nrrd" if write is write_nrrd else "scan.igs.mha")
    write(path, items(), SIZE_PX)
    volume = sitk.ReadImage(str(path))
    pixels = sitk.GetArrayFromImage(volume)
    if write is write_nrrd:
        pixels = np.moveaxis(pixels[0], -1, 0)  # ITK takes a list of pictures for one with several components
    assert pixels.shape == (4, SIZE_PX[1], SIZE_PX[0])
    for index, item in enumerate(items()):
        np.testing.assert_array_equal(pixels[index], picture(index))
        said = volume.GetMetaData(f"Seq_Frame{index:04d}_ProbeToTrackerTransform")
        assert np.array(said.split(), float).tobytes() == item.transforms["ProbeToTracker"].ravel().tobytes()
        assert volume.GetMetaData(f"Seq_Frame{index:04d}_Timestamp") == f"{item.t_ns / 1e9:.9f}"
        assert volume.GetMetaData(f"Seq_Frame{index:04d}_ImageStatus") == "OK"


def test_what_simpleitk_wrote_is_read(tmp_path: Path) -> None:
    """Another writer's header: other names for the same, raw and compressed."""
    volume = sitk.GetImageFromArray(np.stack([picture(k) for k in range(3)]))
    volume.SetMetaData("UltrasoundImageOrientation", "MF")
    for index in range(3):
        volume.SetMetaData(f"Seq_Frame{index:04d}_Timestamp", f"{index / 10}")
    for compressed in (False, True):
        path = tmp_path / f"{compressed}.nrrd"
        sitk.WriteImage(volume, str(path), compressed)
        assert b"\nkinds: domain domain domain\n" in path.read_bytes(), "no list, which it does not know"
        sequence = read_sequence(path)
        for index, image in enumerate(sequence.pictures()):
            np.testing.assert_array_equal(image, picture(index))
        assert [sequence.stamp_ns(k) for k in range(3)] == [0, 100_000_000, 200_000_000]


def test_stored_orientation_is_turned(tmp_path: Path) -> None:
    path = tmp_path / "scan.nrrd"
    write_nrrd(path, items(2), SIZE_PX, orientation="UNA")
    assert not np.array_equal(sitk.GetArrayFromImage(sitk.ReadImage(str(path)))[0], picture(0))
    for index, image in enumerate(read_nrrd(path).pictures()):
        np.testing.assert_array_equal(image, picture(index))


def changed(path: Path, old: bytes, new: bytes) -> Path:
    data = path.read_bytes()
    assert old in data
    path.write_bytes(data.replace(old, new))
    return path


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        (b"encoding: gzip", b"encoding: bzip2", "neither raw nor gzip"),
        (
            b"type: uchar",
            b"type: float",
            r"type is 'float', not uchar\. Record 8-bit grey B-mode pictures \(uchar, one",
        ),
        (b"type: uchar", b"type: uint16", "type is 'uint16', not uchar"),
        (b"kinds: domain domain domain list", b"kinds: list domain domain domain", "stored pixel by pixel"),
        (b"kinds: domain domain domain list", b"kinds: domain domain domain domain", "not those of a sequence"),
        (b"kinds: domain domain domain list", b"kinds: vector domain domain list", "not domain domain list"),
        (
            b"encoding: gzip",
            b"encoding: gzip\ndata file: LIST\na.raw\nb.raw",
            "data file is LIST: a file for each picture",
        ),
        (b"sizes: 7 5 1 4", b"sizes: 7 5 1 5", "sizes says 5 frames"),
        (b"sizes: 7 5 1 4", b"sizes: 7 5 4 1", "not width, height"),
        (b"sizes: 7 5 1 4", b"sizes: 99999 99999 1 4", "not width, height"),
        (b"dimension: 4", b"dimension 4", "neither 'field: value'"),
        (b"Timestamp:=2588", b"Timestamp:=noon", "not a time"),
    ],
)
def test_a_header_that_cannot_be_vouched_for_is_refused(path: Path, old: bytes, new: bytes, what: str) -> None:
    with pytest.raises(RecordingError, match=what):
        open_recording(changed(path, old, new))


def test_axes_in_the_order_of_numpy_are_told_as_that(path: Path) -> None:
    changed(path, b"sizes: 7 5 1 4", b"sizes: 4 5 7")
    with pytest.raises(
        RecordingError, match=r"sizes has the 4 frames not as its last number, which is 7\. Write columns"
    ):
        open_recording(changed(path, b"kinds: domain domain domain list", b"kinds: domain domain list"))


def test_colours_as_the_last_axis_are_told_as_that(path: Path) -> None:
    changed(path, b"sizes: 7 5 1 4", b"sizes: 7 5 4 3")
    with pytest.raises(RecordingError, match="its colours are stored as pictures of their own"):
        open_recording(changed(path, b"kinds: domain domain domain list", b"kinds: domain domain list RGB-color"))


def test_a_file_cut_anywhere_is_refused_and_never_taken_for_whole(path: Path) -> None:
    data = path.read_bytes()
    for cut in range(4, len(data) - 1, 11):
        path.write_bytes(data[:cut])
        with pytest.raises(RecordingError):
            list(open_recording(path).samples())


def test_poses_alone_are_a_sequence_too(tmp_path: Path) -> None:
    path = tmp_path / "poses.nrrd"
    write_nrrd(path, [replace(item, image=None) for item in items()], None)
    sequence = read_nrrd(path)
    assert sequence.size_px is None
    np.testing.assert_allclose(sequence.transform(1, "ProbeToTracker").matrix, turn(0.1, 10, 2), atol=1e-12)


def test_a_header_without_end_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scan.nrrd"
    path.write_bytes(b"NRRD0004\n" + b"k:" + b"x" * 5_000_000)
    with pytest.raises(RecordingError, match="longer than any"):
        read_nrrd(path)
