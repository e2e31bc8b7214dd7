"""Breaks of the picture, judged by `probewatch replay` on recordings of a scanner that the product never saw.

Every picture after these breaks is drawn in another geometry than the reference's, so the contact may never be closed
on it.
"""

import json
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from probewatch.appliance.core.detectors.picture_change import flip_or_zoom_of
from probewatch.appliance.core.detectors.picture_link import small
from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.drivers.recordings.metaimage_writing import SequenceItem, write_metaimage
from probewatch.tools.commands.replay import command
from tests.support.foreign_scanner import (
    CONVEX,
    LINEAR,
    SIZE_PX,
    Break,
    Breath,
    Change,
    Hand,
    Session,
    pictures,
    scanned,
)

BREAK_S, END_S = 8.3, 10.4
DEPTH = Change(zoom=(1.3, 1.3))
REGION = Change(zoom=(1.3, 1.3), about=(0.3, 0.6))
MIRRORED = Change(flip=(-1, 1))


@cache
def session(then: str) -> Session:
    if then == "hold":
        return scanned(1, Hand(1, "hold"), END_S, CONVEX, Breath((0.5, 1.5, 2.0)))
    return scanned(2, Hand(2, then), END_S, LINEAR, Breath((2.0, 0.5, 0.5)))


def monitoring(folder: Path, then: str, broken: Break | None) -> list[tuple[float, float]]:
    """From when to when the contact is closed, s."""
    scan = session(then)
    images = pictures(scan, () if broken is None else broken)
    items = [
        SequenceItem(round((1 + t) * 1e9), image, {"ProbeToTracker": pose}, index)
        for index, (t, image, pose) in enumerate(zip(scan.t_s, images, scan.poses, strict=True))
    ]
    write_metaimage(folder / "scan.igs.mha", items, SIZE_PX, compressed=False)
    write_calibration(folder / "probe.toml", scan.calibration, {"by": "foreign scanner"})
    names = ["scan.igs.mha", "--calibration", "probe.toml", "--json"]
    paths = [name if name.startswith("--") else str(folder / name) for name in names]
    result = CliRunner().invoke(command, paths, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    changes = json.loads(result.stdout)["timeline"]
    ends = [*(change["t_s"] for change in changes[1:]), END_S]
    return [(change["t_s"], end) for change, end in zip(changes, ends, strict=True) if change["state"] == "monitoring"]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("then", "broken"),
    [
        pytest.param("hold", Break(BREAK_S, DEPTH, "black", 0.2), id="hold: depth after .2 s of black"),
        pytest.param("sweep", Break(BREAK_S, DEPTH, "black", 0.2), id="sweep: depth after .2 s of black"),
        pytest.param("sweep", Break(BREAK_S, MIRRORED, "frozen", 0.24), id="sweep: mirrored after a freeze"),
    ],
)
def test_no_contact_is_closed_on_a_picture_after_a_break(tmp_path: Path, then: str, broken: Break) -> None:
    closed = monitoring(tmp_path, then, broken)
    assert any(start < BREAK_S - 0.5 and end >= BREAK_S for start, end in closed), closed
    assert not any(end > BREAK_S + 1 for _, end in closed), closed


@pytest.mark.thorough
def test_without_a_break_the_contact_stays_closed(tmp_path: Path) -> None:
    closed = monitoring(tmp_path, "sweep", None)
    assert closed
    assert closed[-1][0] < BREAK_S - 0.5
    assert closed[-1][1] == END_S


@pytest.mark.thorough
@pytest.mark.parametrize(
    "broken",
    [
        pytest.param(Break(BREAK_S, REGION, "torn", 0.03), id="one torn picture, then zoom of a region"),
        pytest.param(Break(BREAK_S, MIRRORED, "torn-across", 0.1), id="three torn pictures, then mirrored"),
    ],
)
def test_a_picture_that_changes_half_by_half_is_no_quick_hand(tmp_path: Path, broken: Break) -> None:
    closed = monitoring(tmp_path, "hold", broken)
    assert not any(end > BREAK_S + 1 for _, end in closed), closed


def test_a_probe_in_air_is_no_zoom() -> None:
    """The first rows show the ring-down of the array, all else is black."""
    random = np.random.default_rng(0)
    speckle = cv2.GaussianBlur(random.normal(size=SIZE_PX[::-1]), (0, 0), 2)
    tissue = np.clip(90 + 25 * speckle / speckle.std(), 0, 255).astype(np.uint8)
    air = np.zeros_like(tissue)
    air[:14] = random.integers(20, 120, (14, SIZE_PX[0]))
    assert flip_or_zoom_of(small(tissue), small(air)) is None
