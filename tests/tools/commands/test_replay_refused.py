"""`probewatch replay`: one clear line for every bad input."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from tests.support.answers import answered
from tests.support.recordings import REPLAYED_PX, items, turn
from tests.tools.commands.test_replay import run


def cut(path):
    path.write_bytes(path.read_bytes()[:-100])


def shorten_header(path):
    path.write_bytes(path.read_bytes()[:600])


def corrupt(path):
    data = bytearray(path.read_bytes())
    data[-20_000] ^= 0xFF
    path.write_bytes(data)


def colour(path):
    path.write_bytes(path.read_bytes().replace(b"MET_UCHAR", b"MET_FLOAT"))


def rename_transforms(path):
    path.write_bytes(path.read_bytes().replace(b"_ProbeToTracker", b"_NeedleToTracker"))


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (cut, "CompressedDataSize promises"),
        (shorten_header, "the header ends before ElementDataFile"),
        (corrupt, "the compressed pictures are damaged"),
        (colour, "ElementType is 'MET_FLOAT', not MET_UCHAR"),
        (rename_transforms, "its transforms: NeedleToTracker, ReferenceToTracker"),
        (Path.unlink, "cannot be read: No such file"),
    ],
)
def test_a_bad_recording_is_one_line_and_65(session, calibration, damage, complaint):
    damage(session)
    code, out, err = run(session, "--calibration", calibration)
    assert (code, out) == (65, "")
    assert err.count("\n") == 1
    assert err.startswith(f"probewatch: {session}: ")
    assert complaint in err


def no_rotation(path):
    path.write_text(path.read_text().replace("[1.0, 0.0, 0.0]", "[1.1, 0.0, 0.0]"))


def misspelt(path):
    path.write_text(path.read_text().replace("offset_mm", "ofset_mm"))


def other_size(path):
    path.write_text(path.read_text().replace("[48, 32]", "[64, 32]"))


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (no_rotation, "rotation is not a rotation matrix"),
        (misspelt, "ofset_mm"),
        (other_size, "image_size_px is (64, 32), the pictures are (48, 32)"),
        (Path.unlink, "cannot be read: No such file"),
    ],
)
def test_a_bad_calibration_is_one_line_and_78(session, calibration, damage, complaint):
    damage(calibration)
    code, out, err = run(session, "--calibration", calibration)
    assert (code, out) == (78, "")
    assert err.count("\n") == 1
    assert err.startswith(f"probewatch: {calibration}: ")
    assert complaint in err


@pytest.mark.parametrize("fault", ["melt", "depth@soon", "depth@-1", "depth@nan", "depth@"])
def test_an_unknown_fault_is_a_usage_error(session, calibration, fault):
    code, _, err = run(session, "--calibration", calibration, "--inject", fault)
    assert code == 2
    assert "Traceback" not in err


def test_a_sentence_ends_once_where_a_name_is_guessed() -> None:
    told = answered("replay", "a.igs.mha", "--inject", "flip").stderr
    assert "Did you mean 'flip-lateral' or 'flip-vertical'? Use bend-marker" in told


def test_a_recording_that_is_not_there_is_told_before_a_missing_option(tmp_path) -> None:
    for name in ("box.mcap", "box.mc.html"):
        (tmp_path / name).write_bytes(b"")
    answer = answered("replay", tmp_path / "box.mcp")
    assert (answer.returncode, f"Did you mean '{tmp_path}/box.mcap'?" in answer.stderr) == (65, True), answer.stderr
    assert "--calibration" not in answer.stderr
    other = answered("replay", tmp_path / "nope.mcap").stderr
    assert "Did you mean" not in other, "the suffix alone makes no name alike"


def test_a_fault_that_begins_after_the_recording_is_a_usage_error(session, calibration):
    """Nothing would be spoiled, and the report would say so all the same."""
    code, out, err = run(session, "--calibration", calibration, "--inject", "depth@1", "--inject", "flip-lateral@30")
    assert (code, out) == (2, "")
    assert "flip-lateral@30 begins after the recording, which ends at 3.1 s" in err


@pytest.mark.parametrize(
    ("statuses", "ends", "said"),
    [
        (["INVALID"] * 40, 65, "no picture has a pose: ProbeToTracker is INVALID"),
        (["INVALID"] * 31 + ["OK"] * 9, 65, "only 9 of 40 pictures have a pose: ProbeToTracker is INVALID"),
        (["INVALID"] * 30 + ["OK"] * 10, 0, "only 10 of 40 pictures have a pose: ProbeToTracker is INVALID"),
    ],
)
def test_where_most_pictures_have_no_pose_the_verdict_says_why(tmp_path, calibration, statuses, ends, said):
    poses = [turn(0.1, 10.0 * index) if status == "OK" else None for index, status in enumerate(statuses)]
    kept = [
        replace(item, transforms={"ProbeToTracker": pose})
        for item, pose in zip(items(40, REPLAYED_PX), poses, strict=True)
    ]
    write_metaimage(tmp_path / "lost.igs.mha", kept, REPLAYED_PX)
    code, out, err = run(tmp_path / "lost.igs.mha", "--calibration", calibration)
    assert (code, "nothing in it can be judged" in err) == (ends, ends == 65)
    assert f"verdict: NOT_VERIFIED  {said}" in out


@pytest.mark.parametrize("suffix", [".mha", ".csv"])
@pytest.mark.parametrize("device_set", [True, False])
def test_poses_without_pictures_are_told_as_that(tmp_path, calibration, device_set, suffix):
    """And not as a calibration without a size, nor by a report whose picture-flip is OK."""
    alone = [replace(item, image=None) for item in items(9)]
    path = tmp_path / f"poses{suffix}"
    if suffix == ".csv":
        path.write_text("t_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n0,1,2,3,1,0,0,0\n0.1,2,2,3,1,0,0,0\n")
    else:
        write_metaimage(path, alone, None)
    if device_set:
        calibration.write_text("<PlusConfiguration/>")
    code, _, err = run(path, "--calibration", calibration)
    assert code == 65
    assert "holds no pictures. Give those, and this with --poses" in err


def test_the_console_script_ends_bad_input_without_traceback(session, calibration):
    cut(session)
    script = Path(sys.executable).with_name("probewatch")
    arguments = [script, "replay", session, "--calibration", calibration]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 65
    assert done.stderr.count("\n") == 1
    assert "copy it again" in done.stderr
