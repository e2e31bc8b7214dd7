"""Complaints of `probe` about poses and pictures, each with its remedy."""

import numpy as np
import pytest

from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp
from probewatch.tools.commands.probe import Measured, _too_few, complaints
from tests.tools.commands.test_probe import MS, placed, pose


def test_so_few_samples_that_they_have_no_rate_are_poor() -> None:
    """One picture in 5 s was good: its server gives all of them one time."""
    said = "0.2 poses come per second, 15 are needed. Have the device or the sender give each one that it measures"
    assert [*_too_few(Measured([pose(1, 0)], [0]), 5.0)] == [said]
    assert [*_too_few(Measured([pose(1, 0)], [0], DeviceLost("ended", "x", "")), 5.0)] == []
    assert [*_too_few(Measured([pose(n, 10 * n) for n in range(9)], [0] * 9), 5.0)] == []


def test_complaints_name_share_reason_and_remedy() -> None:
    seen = [placed(pose(number, number * 10), (120.0, 40.0, -900.0)) for number in range(75)]
    hidden = [pose(number, number * 10, PoseStatus.MISSING, reason="no line of sight") for number in range(75, 100)]
    found = list(complaints(Measured([*seen, *hidden], [0] * 100)))
    assert found == [
        "25 % of the poses: missing (no line of sight). "
        "Bring the tool into view, and clear the way between it and the tracker"
    ]


@pytest.mark.parametrize(("unit_mm", "told"), [(1.0, False), (1e-3, True)])
def test_poses_in_metres_are_asked_about(unit_mm: float, told: bool) -> None:
    place = (120.0 * unit_mm, 40.0 * unit_mm, -900.0 * unit_mm)
    samples = [placed(pose(number, number * 10), place) for number in range(75)]
    found = [text for text in complaints(Measured([*samples], [0] * 75)) if "of the origin" in text]
    wanted = "all poses lie within 0.91 mm of the origin. Have the sender use mm; it may use metres"
    assert found == ([wanted] if told else [])


@pytest.mark.parametrize(("hz", "half", "poor"), [(14, "poses", True), (16, "poses", False), (9, "pictures", True)])
def test_what_comes_too_seldom_is_poor(hz: float, half: str, poor: bool) -> None:
    image = np.zeros((24, 32), np.uint8)
    samples: list[Frame | Pose] = [
        pose(n, n * 1e3 / hz) if half == "poses" else Frame(Stamp(round(n * 1e9 / hz), 0), n, image) for n in range(20)
    ]
    found = [text for text in complaints(Measured(samples, [0] * 20)) if "per second" in text]
    assert [text.split(".")[0] for text in found] == (
        [f"{hz} {half} come per second, {15 if half == 'poses' else 10} are needed"] if poor else []
    )


def test_times_that_scatter_are_poor() -> None:
    samples = [pose(n, n * 50 + (20 if n % 2 else -20)) for n in range(40)]
    assert [text for text in complaints(Measured([*samples], [0] * 40)) if "scatter by 20 ms" in text]


def test_what_the_device_knows_of_its_time_is_the_remedy() -> None:
    loose = [Frame(Stamp(n * 40 * MS, 100 * MS), n, np.full((24, 32), n, np.uint8)) for n in range(10)]
    measured = Measured(list(loose), [frame.stamp.t_ns for frame in loose])
    known = "the time is known only to ± 100 ms in the median. "
    assert list(complaints(measured, "Have the server stamp")) == [known + "Have the server stamp"]
    assert list(complaints(measured)) == [known + "Measure longer, or look for what delays the line"]


@pytest.mark.parametrize(("differ", "poor"), [(False, True), (True, False)])
def test_pictures_that_are_all_the_same_are_poor(differ: bool, poor: bool) -> None:
    """As OpenCV gives them of an interlaced stream, each what its memory held."""
    frames = [Frame(Stamp(n * 40 * MS, 1000), n, np.full((24, 32), differ and n, np.uint8)) for n in range(10)]
    told = list(complaints(Measured(list(frames), [frame.stamp.t_ns for frame in frames])))
    assert any("all 10 pictures are the same" in one for one in told) is poor
