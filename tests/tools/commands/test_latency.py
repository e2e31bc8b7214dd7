"""`probewatch latency` on real recordings of PLUS: the figure that is known of each, and a sigma that covers it."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.drivers.errors import RecordingError
from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from probewatch.drivers.recordings.replay import open_recording
from probewatch.tools.commands.latency import command
from tests.support.answers import answered
from tests.support.recordings import NWIRE_IMAGE_TO_PROBE, items, plus_file


def n_wires(folder: Path) -> list[object]:
    """With the published calibration."""
    recording = plus_file("NwirePhantomFreehand.igs.mha")
    size_px = open_recording(recording).size_px
    assert size_px is not None
    published = calibration_from_image_to_probe(NWIRE_IMAGE_TO_PROBE, size_px)
    write_calibration(folder / "published.toml", published, {})
    return [recording, "--calibration", folder / "published.toml"]


def water_tank(_: Path) -> list[object]:
    poses = plus_file("WaterTankBottomTranslationTrackerBuffer-trimmed.igs.mha")
    return [plus_file("WaterTankBottomTranslationVideoBuffer.igs.mha"), "--poses", poses]


def fcal(_: Path) -> list[object]:
    recording = plus_file("fCal_Test_Validation_3NWires_fCal2.0.igs.mha")
    return [recording, "--calibration", plus_file("PlusDeviceSet_fCal_Sim_VolumeReconstruction.xml")]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("arguments", "known_ms", "within_ms"), [(water_tank, -65, 10), (n_wires, 75, 30), (fcal, 20, 30)]
)
def test_what_is_known_of_a_real_recording_is_found_and_covered(
    arguments, known_ms: float, within_ms: float, tmp_path: Path
) -> None:
    done = CliRunner().invoke(command, [str(one) for one in arguments(tmp_path)])
    assert done.exit_code == 0, done.output
    told = re.search(r"tracker (late|early) by (\d\S*) ± (\S+) ms", done.output)
    assert told is not None
    value_ms, sigma_ms = (-1 if told[1] == "early" else 1) * float(told[2]), float(told[3])
    assert abs(value_ms - known_ms) < within_ms
    assert abs(value_ms - known_ms) < 2 * sigma_ms < 20


def test_a_recording_without_pictures_is_refused() -> None:
    done = CliRunner().invoke(command, [str(plus_file("WaterTankBottomTranslationTrackerBuffer-trimmed.igs.mha"))])
    assert isinstance(done.exception, RecordingError)
    assert "holds no pictures" in str(done.exception)


@pytest.mark.parametrize("name", ["NwirePhantomFreehand.igs.mha", "fCal_Test_Validation_3NWires_fCal2.0.igs.mha"])
def test_wires_are_no_bottom_of_a_tank(name: str) -> None:
    """Their spots were followed as if they were one line, and 160 and 57 ms told."""
    done = CliRunner().invoke(command, [str(plus_file(name))])
    assert isinstance(done.exception, RecordingError)
    assert done.exception.exit_code == 65
    for words in ("line across the picture", "water tank", "--calibration"):
        assert words in str(done.exception), words
    assert " by " not in done.output


def test_poses_out_of_order_are_counted_here_and_by_replay(tmp_path: Path) -> None:
    """They were left out without a word."""
    shown = [replace(item, transforms={}) for item in items(40, (48, 32))]
    scan, poses, calibration = (tmp_path / name for name in ("scan.igs.mha", "poses.csv", "probe.toml"))
    write_metaimage(scan, shown, (48, 32))
    rows = [f"{2588.14 + 0.08 * n - (n == 20) * 0.5:.3f},1,2,{n},1,0,0,0" for n in range(40)]
    poses.write_text("\n".join(["t_s,x_mm,y_mm,z_mm,qw,qx,qy,qz", *rows]))
    tank = answered("latency", scan, "--poses", poses)
    assert "scan.igs.mha: 1 poses left out: pose time does not increase" in tank.stderr
    assert tank.returncode == 65, "it shows no bottom of a tank"
    write_calibration(calibration, calibration_from_image_to_probe(np.diag([0.2, 0.2, 1.0, 1.0]), (48, 32)), {})
    report = json.loads(answered("replay", scan, "--poses", poses, "--calibration", calibration, "--json").stdout)
    assert (report["poses"], report["unusable_poses"]) == (40, {"pose time does not increase": 1})
