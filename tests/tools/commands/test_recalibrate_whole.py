"""`probewatch recalibrate --solve all`: a first calibration from a scan alone, reviewed, checked, signed, exported."""

import hashlib
from pathlib import Path

import numpy as np
import pytest

from probewatch.appliance.storage.calibration_file import read_calibration
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe, image_to_probe
from probewatch.drivers.files.markup import toml_of
from probewatch.drivers.recordings.metaimage_writing import SequenceItem, write_metaimage
from probewatch.drivers.rigid import vector_from_rotation
from probewatch.drivers.twins.scene.world import World, WorldSettings
from tests.support.answers import answered

SIZE_PX = (320, 240)
SMALL = WorldSettings(*SIZE_PX, scale_mm_per_px=(0.16, 0.14))
"""The tank of a large picture in few pixels: a third of the time to render."""


def world(seed: int) -> World:
    return World(seed, "guided", "cross-wire", SMALL)


def record(path: Path, seen: World, pictures: int, rate_hz: int = 20) -> Path:
    """A PLUS sequence in which each picture carries its own pose."""
    items = []
    for index in range(pictures):
        t_s = index / rate_hz
        poses = {"ProbeToTracker": seen.measured_pose(t_s, index)}
        t_ns = 7_000_000_000 + index * 1_000_000_000 // rate_hz
        items.append(SequenceItem(t_ns, seen.frame(t_s, index), poses))
    write_metaimage(path, items, SIZE_PX)
    return path


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("whole") / "scan.igs.mha", world(3), 1000)


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("whole") / "other.igs.mha", world(8), 240)


@pytest.mark.thorough
def test_a_first_calibration_from_a_recording_alone(tmp_path, scan, elsewhere) -> None:
    new = tmp_path / "probe.toml"
    people = ("--made-by", "A. Hill", "--signed-by", "B. Stone", "--role", "physicist", "--due", "2999-05-01")
    shown = answered(
        "recalibrate", "--recording", scan, "--solve", "all", "--output", new, "--check", elsewhere, "--water-c", 47,
        "--strike", 2, *people,
    )  # fmt: skip
    assert shown.returncode == 0, shown.stderr
    assert "check at an independent point: " in shown.stdout
    assert "tracker late by" in shown.stdout
    found, true = read_calibration(new), calibration_from_image_to_probe(world(3).image_to_probe, SIZE_PX)
    assert found.covariance is not None
    sigma = np.sqrt(np.diag(found.covariance))
    off = np.concatenate(
        [
            vector_from_rotation(found.rotation @ true.rotation.T),
            found.scale_mm_per_px / true.scale_mm_per_px - 1,
            found.offset_mm - true.offset_mm,
        ]
    )
    assert np.all(np.abs(off) < 4.5 * sigma), off / sigma
    said = toml_of(new.read_bytes(), 20_000)["provenance"]
    assert said["data_sha256"] == hashlib.sha256(scan.read_bytes()).hexdigest()
    assert (said["made_by"], said["signed_by"], said["due"]) == ("A. Hill", "B. Stone", "2999-05-01")
    assert "1 struck out" in said["views"]
    assert said["check"].endswith("at most")
    assert said["previous_file"] == "none"


@pytest.mark.thorough
def test_a_short_scan_is_refused_with_every_reason_and_writes_nothing(tmp_path, elsewhere) -> None:
    new = tmp_path / "probe.toml"
    refused = answered("recalibrate", "--recording", elsewhere, "--solve", "all", "--output", new)
    assert refused.returncode == 65
    assert "too few views" in refused.stderr
    assert "what would add most" in refused.stdout
    assert not new.exists()


def test_options_that_do_not_go_together_are_refused(tmp_path) -> None:
    cases = {
        ("--strike", "3"): "--strike goes with --solve all",
        ("--signed-by", "Me", "--made-by", "me", "--role", "x"): "cannot sign it as well",
        ("--signed-by", "Me"): "a name and a role",
    }
    for options, what in cases.items():
        refused = answered("recalibrate", "--simulated", "--output", tmp_path / "new.toml", *options)
        assert refused.returncode in (2, 78)
        assert what in refused.stderr


def test_plain_cold_water_is_refused_before_the_scan(tmp_path) -> None:
    refused = answered("recalibrate", "--simulated", "--output", tmp_path / "new.toml", "--water-c", 20)
    assert refused.returncode == 65
    assert "3.9 % too deep" in refused.stderr


@pytest.mark.parametrize("suffix", ["xml", "tfm"])
def test_a_calibration_goes_to_another_program_and_comes_back(tmp_path, suffix: str) -> None:
    mine, there, back = tmp_path / "mine.toml", tmp_path / f"probe.{suffix}", tmp_path / "back.toml"
    template = Path(__file__).parents[3] / "config" / "calibration.toml"
    mine.write_text(template.read_text())
    before = read_calibration(mine)
    assert answered("calibration", "export", mine, "--output", there).returncode == 0
    size = before.image_size_px
    imported = answered("calibration", "import", there, "--image-size", *size, "--output", back)
    assert imported.returncode == 0, imported.stderr
    np.testing.assert_allclose(image_to_probe(read_calibration(back)), image_to_probe(before), rtol=0, atol=1e-9)
    again = answered("calibration", "export", mine, "--output", there)
    assert again.returncode == 78
    assert "exists already" in again.stderr
    assert answered("calibration", "export", mine, "--output", tmp_path / "probe.h5").returncode == 2
