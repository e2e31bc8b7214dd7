"""Transforms of MetaImage sequences: their status, form and rigidity."""

import numpy as np
import pytest

from probewatch.drivers.errors import RecordingError
from probewatch.drivers.recordings.metaimage import read_metaimage
from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from probewatch.drivers.samples import PoseStatus
from tests.drivers.recordings.test_metaimage import edit
from tests.support.recordings import SIZE_PX, items


@pytest.fixture
def raw(tmp_path):
    path = tmp_path / "raw.igs.mha"
    write_metaimage(path, items(), SIZE_PX, compressed=False)
    return path


IDENTITY = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"


@pytest.mark.parametrize(
    ("numbers", "reason"),
    [
        (IDENTITY.replace("1", "1.02", 1), "not a rotation"),
        (IDENTITY.replace("1", "-1", 1), "not a rotation"),
        (IDENTITY.replace("1", "nan", 1), "not finite"),
        (IDENTITY.replace("0", "1e400", 1), "not finite"),
        ("0 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1", "not a rotation"),
        ("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0.1 1", "not a rotation"),
        ("0.2 0 0 0 0 0.2 0 0 0 0 0.2 0 0 0 0 1", "not a rotation"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0 0 0 0 1", "not a rotation"),
        ("1 0 0 1e9 0 1 0 0 0 0 1 0 0 0 0 1", "further away"),
    ],
)
def test_what_is_not_rigid_gives_no_matrix(raw, numbers, reason):
    edit(
        raw,
        b"Seq_Frame0000_ProbeToTrackerTransform = ",
        f"Seq_Frame0000_ProbeToTrackerTransform = {numbers}\nX = ".encode(),
    )
    reading = read_metaimage(raw).transform(0, "ProbeToTracker")
    assert (reading.matrix, reading.status) == (None, PoseStatus.NOT_UNDERSTOOD)
    assert reason in reading.reason


def test_printed_digits_are_made_orthonormal(raw):
    numbers = (
        "0.239045 -0.899263 0.366311 287.271 -0.276161 0.298706 0.913515 -28.7887 "
        "-0.930909 -0.319532 -0.176937 -14.817 0 0 0 1"
    )
    edit(
        raw,
        b"Seq_Frame0000_ProbeToTrackerTransform = ",
        f"Seq_Frame0000_ProbeToTrackerTransform = {numbers}\nX = ".encode(),
    )
    matrix = read_metaimage(raw).transform(0, "ProbeToTracker").matrix
    # The six digits are off by 1e-6. What rounding leaves, in nine products of three numbers, depends on NumPy.
    assert np.abs(matrix[:3, :3].T @ matrix[:3, :3] - np.eye(3)).max() < 8 * np.finfo(float).eps
    np.testing.assert_allclose(matrix.ravel(), [float(word) for word in numbers.split()], atol=2e-6)


@pytest.mark.parametrize(
    ("word", "status"),
    [
        ("INVALID", PoseStatus.MISSING),
        ("OUT_OF_VIEW", PoseStatus.MISSING),
        ("MISSING", PoseStatus.DISABLED),
        ("DISABLED", PoseStatus.DISABLED),
        ("VALID", PoseStatus.NOT_UNDERSTOOD),
        ("whatever", PoseStatus.NOT_UNDERSTOOD),
    ],
)
def test_transform_status_is_kept(raw, word, status):
    edit(raw, b"ProbeToTrackerTransformStatus = OK", f"ProbeToTrackerTransformStatus = {word}".encode())
    reading = read_metaimage(raw).transform(0, "ProbeToTracker")
    assert (reading.matrix, reading.status) == (None, status)
    assert "ProbeToTracker" in reading.reason


@pytest.mark.parametrize(
    ("numbers", "remedy"),
    [
        ("1,0 0,0 0 0 0 1 0 0 0 0 1 0 0 0 0 1", "Write it with decimal points"),
        ("[1 0 0 0; 0 1 0 0; 0 0 1 0; 0 0 0 1]", "Write blanks alone between the numbers"),
        ("1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1", "Write blanks alone between the numbers"),
        ("1 0 0 0 0 1 0 0 0 0 1 0", "It has 12: append the last row, 0 0 0 1"),
        ("1 0 0", "Record again, or fix this line"),
    ],
)
def test_a_matrix_in_another_form_is_told_with_what_to_write(raw, numbers, remedy):
    key = "Seq_Frame0000_ProbeToTrackerTransform = "
    edit(raw, key.encode(), f"{key}{numbers}\nX = ".encode())
    with pytest.raises(RecordingError) as told:
        read_metaimage(raw).transform(0, "ProbeToTracker")
    assert remedy in told.value.remedy


@pytest.mark.parametrize(
    ("time", "remedy"),
    [
        ("1700000000000", "Is it in ms? Divide by 1000"),
        ("1700000000000000", "Is it in µs? Divide by 1000000"),
        ("1700000000000000000", "Is it in ns? Divide by 1000000000"),
        ("2026-01-01T10:00:00", "Write it in seconds, such as 12.345"),
    ],
)
def test_a_time_in_another_unit_is_told_with_it(raw, time, remedy):
    edit(raw, b"Timestamp = 2588.141729000", f"Timestamp = {time}".encode())
    with pytest.raises(RecordingError) as told:
        read_metaimage(raw).stamp_ns(0)
    assert told.value.remedy == remedy


@pytest.mark.parametrize("numbers", ["1 2 3", "one " * 16, "1 " * 17, ""])
def test_text_that_is_not_sixteen_numbers_is_refused(raw, numbers):
    edit(
        raw,
        b"Seq_Frame0000_ProbeToTrackerTransform = ",
        f"Seq_Frame0000_ProbeToTrackerTransform = {numbers}\nX = ".encode(),
    )
    with pytest.raises(RecordingError, match=r"Seq_Frame0000_ProbeToTrackerTransform .*sixteen"):
        read_metaimage(raw).transform(0, "ProbeToTracker")
