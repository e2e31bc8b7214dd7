"""Arrays in, verdicts out: the page's code runs, the answer is that of `probewatch replay`, wrong arrays are told."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from probewatch.appliance.api import judge, reference
from probewatch.appliance.limits import Limits
from probewatch.appliance.storage.calibration_file import read_calibration, write_calibration
from probewatch.appliance.types import VerdictKind
from probewatch.drivers.errors import ConfigurationError, RecordingError
from probewatch.drivers.recordings.metaimage_writing import SequenceItem, write_metaimage
from probewatch.drivers.samples import Frame
from probewatch.drivers.twins.scene.world import WorldSettings
from tests.support.answers import answered
from tests.support.recordings import picture, turn
from tests.support.sessions import SWEPT, kept, session

SMALL = WorldSettings(width_px=400, height_px=300, scale_mm_per_px=(0.09, 0.08))
PAGE = Path(__file__).parents[2] / "docs" / "python.md"
SIZE_PX = (48, 32)
TIMES_S = 100 + 0.08 * np.arange(40)


@pytest.fixture
def arrays():
    pictures = np.stack([picture(index, SIZE_PX) for index in range(40)])
    poses = np.stack([turn(0.01 * index, 50 + 2.0 * index) for index in range(40)])
    watched = reference(np.diag([0.2, 0.2, 1.0, 1.0]), SIZE_PX)
    return {
        "pictures": pictures,
        "picture_times_s": TIMES_S,
        "poses": poses,
        "pose_times_s": TIMES_S,
        "watched": watched,
    }


@pytest.mark.parametrize("block", re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.M | re.S))
def test_the_code_of_the_page_runs(block, capsys):
    times_s = np.arange(12) / 30
    given = {
        "pictures": np.stack([picture(index, (400, 300)) for index in range(12)]),
        "picture_times_s": times_s,
        "poses": np.stack([turn(0.01 * index, 1.0 * index) for index in range(12)]),
        "pose_times_s": times_s,
    }
    exec(compile(block, str(PAGE), "exec"), given)
    assert capsys.readouterr().out.count("NOT_VERIFIED") >= 12


def test_an_identity_among_the_poses_is_no_pose(arrays):
    arrays["poses"][5] = np.eye(4)
    assert judge(**arrays).report.unusable == {"the pose is not a measurement (identity or zeros)": 1}


def test_the_answer_is_that_of_replay(arrays, tmp_path):
    frames, poses = arrays["pictures"], arrays["poses"]
    sequence = [
        SequenceItem(round(t_s * 1e9), frame, {"ProbeToTracker": pose})
        for t_s, frame, pose in zip(TIMES_S, frames, poses, strict=True)
    ]
    write_metaimage(tmp_path / "one.igs.mha", sequence, SIZE_PX)
    write_calibration(tmp_path / "probe.toml", arrays["watched"], {})
    said = answered("replay", str(tmp_path / "one.igs.mha"), "--calibration", str(tmp_path / "probe.toml"), "--json")
    told = json.loads(said.stdout)
    told.pop("of")
    watched = read_calibration(tmp_path / "probe.toml")
    assert json.loads(json.dumps(judge(**{**arrays, "watched": watched}).fields())) == told


def simulated(duration_s):
    """A sweep of the simulated world as arrays, and its true matrix."""
    world = kept(3, settings=SMALL)
    samples = list(session(world, duration_s))
    frames = [one for one in samples if isinstance(one, Frame)]
    poses = [one for one in samples if not isinstance(one, Frame)]
    arrays = {
        "pictures": np.stack([one.image for one in frames]),
        "picture_times_s": np.array([one.stamp.t_ns for one in frames]) / 1e9,
        "poses": np.stack([one.matrix for one in poses]),
        "pose_times_s": np.array([one.stamp.t_ns for one in poses]) / 1e9,
    }
    return arrays, world.image_to_probe, (world.settings.width_px, world.settings.height_px)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("mirrored", "kind", "fault"), [(False, VerdictKind.OK, None), (True, VerdictKind.FAULT, "polarity")]
)
def test_true_pictures_are_verified_and_mirrored_ones_named(mirrored, kind, fault):
    arrays, matrix, size_px = simulated(9.0)
    if mirrored:
        arrays["pictures"] = arrays["pictures"][:, :, ::-1]
    judged = judge(**arrays, watched=reference(matrix, size_px), limits=SWEPT)
    assert (judged.report.verdict.kind, judged.report.verdict.fault) == (kind, fault)
    assert judged.verdicts[-1].kind is kind
    np.testing.assert_array_equal(judged.times_s, arrays["picture_times_s"])


def test_a_pose_that_is_nan_was_not_seen_and_one_that_is_not_rigid_is_counted(arrays):
    arrays["poses"][3:5] = np.nan
    arrays["poses"][7, :3, :3] *= 0.1
    unusable = judge(**arrays).report.unusable
    assert sum(unusable.values()) == 3
    assert any("NaN" in why for why in unusable)


def test_a_picture_after_a_gap_keeps_the_order_of_times(arrays):
    times_s = np.where(TIMES_S > 101, TIMES_S + 5, TIMES_S)
    judged = judge(**{**arrays, "picture_times_s": times_s, "pose_times_s": times_s})
    assert len(judged.verdicts) == 40
    assert judged.times_s[-1] == times_s[-1]
    assert set(judged.times_s) <= set(times_s)


def test_the_last_pictures_wait_for_a_pose(arrays):
    arrays["poses"], arrays["pose_times_s"] = arrays["poses"][:30], TIMES_S[:30] + 0.01
    judged = judge(**arrays)
    assert 0 < len(judged.verdicts) == len(judged.times_s) < 40


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("pictures", lambda a: np.repeat(a[..., None], 3, 3), "colours"),
        ("pictures", lambda a: a[0], r"\(n, height, width\)"),
        ("pictures", lambda a: a[:0], "at least 1"),
        ("pictures", lambda a: a.transpose(0, 2, 1), "axes are exchanged"),
        ("pictures", lambda a: a.transpose(1, 2, 0), r"of pictures \(n, 32, 48\)"),
        ("pictures", lambda a: a[:, ::2, ::2], r"of pictures \(n, 32, 48\)"),
        ("pictures", lambda a: a.astype(np.uint16) * 16, "uint16, not uint8"),
        ("pictures", lambda a: a / 255, "float64, not uint8"),
        ("picture_times_s", lambda a: a * 1000, "divide ms by 1000"),
        ("picture_times_s", lambda a: (a - 100) * 1e6, "divide µs by 1e6"),
        ("pose_times_s", lambda a: (a - 100) * 1e9, "divide ns by 1e9|beyond 4e[+]09 s"),
        ("pictures", lambda a: [*a[:-1], a[0, :5]], "one shape"),
        ("poses", lambda a: [*a[:-1], None], "one shape"),
        ("poses", lambda a: a.astype(str), "no numbers"),
        ("poses", lambda a: np.array([None] * len(a)), "NaN in all 16 places"),
        ("pose_times_s", lambda a: a.astype("datetime64[s]"), "no numbers"),
        ("watched", lambda a: None, "NoneType, not Calibration"),
        ("watched", lambda a: np.eye(4), "ndarray, not Calibration"),
        ("picture_times_s", lambda a: 1.7e12 + a * 1000, "beyond 4e[+]09 s"),
        ("picture_times_s", lambda a: a[::-1], "not later than the one before at index 1"),
        ("picture_times_s", lambda a: a[:-1], r"shape \(39,\), not \(40,\)"),
        ("picture_times_s", lambda a: np.where(a > 101, np.nan, a), "not finite"),
        ("picture_times_s", lambda a: a - 50, "do not overlap: pictures 50.000 to 53.120 s"),
        ("pose_times_s", lambda a: a[:, None], r"shape \(40, 1\)"),
        ("poses", lambda a: a[:, :3], r"\(40, 3, 4\), not \(m, 4, 4\)"),
        ("poses", lambda a: a @ np.diag([0.1, 0.1, 0.1, 1]), "40 of 40 that were seen cannot be used"),
        ("poses", lambda a: a.transpose(0, 2, 1), "40 of 40 that were seen cannot be used"),
    ],
)
def test_a_wrong_array_is_told_by_name(arrays, name, change, said):
    with pytest.raises(RecordingError, match=said) as told:
        judge(**{**arrays, name: change(arrays[name])})
    assert name in str(told.value)
    assert told.value.remedy


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"scale": 3}, r"^Limits: scale is not known. Did you mean 'scale_percent'\?"),
        ({"scale_percent": "3"}, "^Limits: scale_percent = '3': input should be a valid number"),
        ({"scale_percent": 99}, "scale_percent = 99: input should be less than or equal to 30"),
        ({"profile": "fien"}, "profile = 'fien': input should be 'coarse', 'clinical' or 'fine'"),
        ({"required_age_s": {"ofset-axial": 3}}, r"ofset-axial is not known. Did you mean 'offset-axial'\?"),
        ({"region": {"left": 1.0, "right": 0.5}}, "region is empty"),
    ],
)
def test_limits_that_cannot_be_are_told_by_name(given, said):
    with pytest.raises(ConfigurationError, match=said):
        Limits(**given)


def test_limits_of_another_type_are_told(arrays):
    with pytest.raises(RecordingError, match="limits: is of type dict, not Limits"):
        judge(**arrays, limits={"scale_percent": 3.0})


@pytest.mark.parametrize("size", [(40.5, 30), (0, 30), (40, -30), 40, (40, 30, 3), None, "40x30"])
def test_what_is_no_size_is_refused(size):
    with pytest.raises(RecordingError, match=r"image_size_px: is .* Give \(width, height\), whole numbers"):
        reference(np.diag([0.2, 0.2, 1.0, 1.0]), size)


@pytest.mark.parametrize(
    ("matrix", "said"),
    [(np.eye(4), "never calibrated"), (np.diag([0.2, 0.2, 1.0, 2.0]), "last row"), (np.eye(3), r"\(3, 3\)")],
)
def test_a_matrix_that_is_no_calibration_is_refused(matrix, said):
    with pytest.raises((ConfigurationError, RecordingError), match=said):
        reference(matrix, SIZE_PX)


@pytest.mark.parametrize(("per_mm", "asked"), [(1.0, False), (0.001, True)])
def test_poses_in_metres_are_asked_about(arrays, per_mm, asked):
    arrays["poses"][:, :3, 3] *= per_mm
    verdict = judge(**arrays).report.verdict
    assert verdict.kind is not VerdictKind.OK
    assert ("are they in mm?" in verdict.reason) is asked
