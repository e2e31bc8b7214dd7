"""What is exported is read by others and by us as it was recorded."""

import io
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import SimpleITK as sitk  # noqa: N813  as its documentation does
from click.testing import CliRunner

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.limits import Limits
from probewatch.appliance.storage.black_box import BlackBox, BlackBoxWriter, Series
from probewatch.appliance.types import Calibration
from probewatch.drivers.errors import RecordingError
from probewatch.drivers.recordings.replay import open_recording
from probewatch.drivers.rigid import interpolate
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp
from probewatch.tools.commands.export import command
from tests.support.black_boxes import begun, record
from tests.support.recordings import picture, turn

SIZE_PX = (64, 48)
START_NS = 7_000_000_000
COUNT = 12


def samples():
    """Poses half a picture off, and one that is missing."""
    for k in range(COUNT):
        t_ns = START_NS + k * 40_000_000
        yield Frame(Stamp(t_ns, 500), 10 + k, picture(k, SIZE_PX))
        status = PoseStatus.MISSING if k == 5 else PoseStatus.OK
        matrix = None if k == 5 else turn(0.05 * k, k / 3, 1)
        yield Pose(Stamp(t_ns + 20_000_000, 1), k, matrix, 0.1, status, "" if matrix is not None else "hidden")


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("box") / "scan.mcap"
    reference = Calibration(np.eye(3), (1, 1), np.array([0.1, 0.1]), np.zeros(3), SIZE_PX)
    record(path, EstimatorSettings(1, reference, Limits(), 500_000_000), samples())
    return path


def exported(box: Path, form: str, target: Path) -> Path:
    result = CliRunner().invoke(command, [str(box), "--to", form, "--output", str(target)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert "written" in result.output
    return target


def pose_at(k: int) -> np.ndarray | None:
    """Between poses k − 1 and k."""
    if k == 0:
        return None
    first, then = (1, 0) if k not in (5, 6) else ((1, 1) if k == 5 else (2, 0))
    if k == 5:
        return interpolate(turn(0.05 * 4, 4 / 3, 1), turn(0.05 * 6, 6 / 3, 1), 0.25)
    if k == 6:
        return interpolate(turn(0.05 * 4, 4 / 3, 1), turn(0.05 * 6, 6 / 3, 1), 0.75)
    return interpolate(turn(0.05 * (k - first), (k - first) / 3, 1), turn(0.05 * (k - then), (k - then) / 3, 1), 0.5)


@pytest.mark.parametrize("form", [".igs.mha", ".igs.nrrd"])
def test_a_sequence_has_equal_pixels_stamps_and_transforms_for_simpleitk_and_for_us(
    box: Path, tmp_path: Path, form: str
) -> None:
    path = exported(box, form, tmp_path / f"scan{form}")
    volume = sitk.ReadImage(str(path))
    pixels = sitk.GetArrayFromImage(volume)
    if form == ".igs.nrrd":
        pixels = np.moveaxis(pixels[0], -1, 0)
    session = open_recording(path)
    frames = list(session.frame_samples())
    poses = list(session.pose_samples())
    assert len(frames) == len(pixels) == COUNT
    for k, (frame, pose) in enumerate(zip(frames, poses, strict=True)):
        np.testing.assert_array_equal(pixels[k], picture(k, SIZE_PX))
        np.testing.assert_array_equal(frame.image, picture(k, SIZE_PX))
        assert frame.stamp.t_ns == START_NS + k * 40_000_000
        assert frame.sequence == 10 + k
        said = volume.GetMetaData(f"Seq_Frame{k:04d}_Timestamp")
        assert round(float(said) * 1e9) == frame.stamp.t_ns
        wanted = pose_at(k)
        if wanted is None:
            assert pose.matrix is None
            assert volume.GetMetaData(f"Seq_Frame{k:04d}_ProbeToTrackerTransformStatus") == "INVALID"
        else:
            text = volume.GetMetaData(f"Seq_Frame{k:04d}_ProbeToTrackerTransform")
            np.testing.assert_allclose(np.array(text.split(), float).reshape(4, 4), wanted, atol=1e-12)
            np.testing.assert_allclose(pose.matrix, wanted, atol=1e-12)


def test_a_film_and_a_table_are_a_recording_again(box: Path, tmp_path: Path) -> None:
    film, table = exported(box, "mp4", tmp_path / "scan.mp4"), exported(box, "csv", tmp_path / "scan.csv")
    session = open_recording(film, poses=table)
    frames, poses = list(session.frame_samples()), list(session.pose_samples())
    assert len(frames) == len(poses) == COUNT
    recorded = [told.item for told in Series([BlackBox(box)]).items() if isinstance(told.item, Pose)]
    for pose, wanted in zip(poses, recorded, strict=True):
        assert pose.stamp.t_ns == wanted.stamp.t_ns - START_NS
        if wanted.matrix is None:
            assert (pose.matrix, pose.reason) == (None, "hidden")
        else:
            np.testing.assert_allclose(pose.matrix, wanted.matrix, atol=1e-12)


def test_a_film_shows_the_picture_and_what_was_said_under_it(box: Path, tmp_path: Path) -> None:
    film = cv2.VideoCapture(str(exported(box, "mp4", tmp_path / "scan.mp4")))
    there, shown = film.read()
    fps = film.get(cv2.CAP_PROP_FPS)
    film.release()
    assert there
    assert fps == 25.0
    assert shown.shape == (48 + 24, 64, 3)
    difference = shown[2:46, 2:62].mean(axis=2) - picture(0, SIZE_PX)[2:46, 2:62]
    assert abs(difference).mean() < 40, "noise, which MP4 blurs"
    assert shown[50:].max() > 100, "letters"


def test_what_cannot_be_exported_is_refused(box: Path, tmp_path: Path) -> None:
    other = tmp_path / "x.igs.mha"
    other.write_bytes(b"ObjectType = Image\n")
    runner = CliRunner()
    assert "is not a black box" in str(runner.invoke(command, [str(other), "--to", "csv"]).exception)
    folder = str(runner.invoke(command, [str(tmp_path), "--to", "csv"]).exception)
    assert "holds no black box. Name a folder of probewatch record" in folder, (
        "not that it looks for .mha, and for films"
    )
    none = runner.invoke(command, [str(tmp_path / "none.mcap"), "--to", "csv"])
    assert "none.mcap: is not there" in str(none.exception)
    there = runner.invoke(command, [str(box), "--to", ".igs.mha", "--output", str(other)])
    assert "exists already" in str(there.exception)
    assert other.read_bytes() == b"ObjectType = Image\n"
    assert "does not end in .mp4" in runner.invoke(command, [str(box), "--to", "mp4", "--output", "x.avi"]).output


@pytest.mark.parametrize("form", ["csv", ".igs.mha", "mp4"])
def test_a_part_that_is_missing_is_told(box: Path, tmp_path: Path, form: str) -> None:
    """Replay told of the gap, and the table had it without a word."""
    parts = [box]
    for part in (2, 4):
        data = io.BytesIO()
        writer = BlackBoxWriter(data, begun(START_NS, part=part))
        for sample in samples():
            t_ns = sample.stamp.t_ns + part * 10**9
            writer.put(replace(sample, stamp=replace(sample.stamp, t_ns=t_ns)), t_ns)
        writer.finish()
        parts.append(tmp_path / f"{part}.mcap")
        parts[-1].write_bytes(data.getvalue())
    told = []
    for several in (parts[:2], parts):
        line = [*map(str, several), "--to", form, "--output", str(tmp_path / f"{len(several)}.{form.lstrip('.')}")]
        result = CliRunner().invoke(command, line, catch_exceptions=False)
        assert result.exit_code == 0
        told.append(result.stderr)
    wanted = (
        "The recording has neither picture nor reading of the tracker for 1.5 s from 2.46 s on: part 3 is missing\n"
    )
    assert told == ["", wanted]


@pytest.mark.parametrize("form", [".igs.mha", ".igs.nrrd"])
def test_a_second_body_is_exported_and_replayed_beside_the_first(tmp_path: Path, form: str) -> None:
    relative_pose = turn(0.3, 80.0)
    seen = [
        replace(one, witness=one.matrix @ relative_pose) if isinstance(one, Pose) and one.matrix is not None else one
        for one in samples()
    ]
    reference = Calibration(np.eye(3), (1, 1), np.array([0.1, 0.1]), np.zeros(3), SIZE_PX)
    record(tmp_path / "scan.mcap", EstimatorSettings(1, reference, Limits(), 500_000_000), seen)
    path = exported(tmp_path / "scan.mcap", form, tmp_path / f"scan{form}")
    poses = list(open_recording(path).pose_samples())
    found = [pose for pose in poses if pose.matrix is not None]
    assert len(found) == COUNT - 1
    for pose in found:
        assert pose.witness is not None
        np.testing.assert_allclose(np.linalg.inv(pose.matrix) @ pose.witness, relative_pose, atol=0.2)
    with pytest.raises(RecordingError, match="has no StylusToTracker"):
        open_recording(path, witness="Stylus")


def test_without_a_second_body_none_is_exported(box: Path, tmp_path: Path) -> None:
    session = open_recording(exported(box, ".igs.mha", tmp_path / "scan.igs.mha"))
    assert session.poses.transform_names() == ["ProbeToTracker"]
    assert {pose.witness for pose in session.pose_samples()} == {None}


@pytest.mark.parametrize(("form", "number"), [(".igs.mha", 9), (".igs.nrrd", 9), ("mp4", 9), ("csv", 12)])
def test_pictures_of_another_size_are_left_out_with_a_word(tmp_path: Path, form: str, number: int) -> None:
    """A grabber that changes its mode: the film had fewer pictures, and nobody knew."""
    size_px = (SIZE_PX[0] // 2, SIZE_PX[1])
    found = [
        replace(one, image=picture(one.sequence, size_px)) if isinstance(one, Frame) and one.sequence > 18 else one
        for one in samples()
    ]
    reference = Calibration(np.eye(3), (1, 1), np.array([0.1, 0.1]), np.zeros(3), SIZE_PX)
    record(tmp_path / "scan.mcap", EstimatorSettings(1, reference, Limits(), 500_000_000), found)
    ending = form if form.startswith(".") else f".{form}"
    asked = [str(tmp_path / "scan.mcap"), "--to", form, "--output", str(tmp_path / f"out{ending}")]
    result = CliRunner().invoke(command, asked, catch_exceptions=False)
    assert f", {number} p" in result.output
    assert ("left out: 3 pictures of another size" in result.output) is (form != "csv")


@pytest.mark.parametrize("name", ["scan.igs.mha", "scan.csv"])
def test_the_form_is_what_the_new_files_name_says(box: Path, tmp_path: Path, name: str) -> None:
    result = CliRunner().invoke(command, [str(box), "--output", str(tmp_path / name)])
    assert (result.exit_code, (tmp_path / name).exists()) == (0, True), result.output
    for words, why in (
        ([], "Missing option '--to'. Choose from: "),
        (
            ["--output", str(tmp_path / "scan.avi")],
            "scan.avi has no known ending. Use one of .igs.mha, .igs.nrrd, .csv, ",
        ),
    ):
        refused = CliRunner().invoke(command, [str(box), *words])
        assert (refused.exit_code, why in " ".join(refused.output.split())) == (2, True), refused.output


@pytest.mark.parametrize("form", ["csv", ".igs.mha"])
def test_a_cut_recording_is_written_and_ends_as_damaged(box: Path, tmp_path: Path, form: str) -> None:
    """It ended with 0, unlike `report` and `trend`."""
    cut, out = tmp_path / "cut.mcap", tmp_path / f"cut.{form.lstrip('.')}"
    cut.write_bytes(box.read_bytes()[:-400])
    result = CliRunner().invoke(command, [str(cut), "--to", form, "--output", str(out)])
    assert (result.exit_code, out.exists()) == (65, True), result.output
    assert "damaged: cut.mcap" in result.stderr
    assert "65: written, but" in CliRunner().invoke(command, ["--help"]).output
