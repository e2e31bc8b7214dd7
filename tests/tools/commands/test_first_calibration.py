"""The way of docs/first-calibration.md, walked with its commands on recordings of a simulated probe."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from probewatch.appliance.storage.calibration_file import _File, read_calibration, write_calibration
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe, image_to_probe
from probewatch.appliance.types import PARAMETERS, Calibration
from probewatch.drivers.recordings.metaimage_writing import SequenceItem, write_metaimage
from probewatch.drivers.rigid import rotation_from_vector, vector_from_rotation
from probewatch.drivers.twins.scene.world import World
from tests.support.answers import answered
from tests.support.recordings import items

SIZE_PX = (640, 480)
TEMPLATE = Path(__file__).parents[3] / "config" / "calibration.toml"


def test_the_template_is_valid_and_names_every_key() -> None:
    calibration = read_calibration(TEMPLATE)
    assert calibration.observed == (True,) * 7 + (False,)
    text = TEMPLATE.read_text()
    for name in (*_File.model_fields, *PARAMETERS):
        assert re.search(rf"^(# )?\[?{name}\b", text, re.M), name


def test_the_two_forms_in_the_template_mean_the_same(tmp_path: Path) -> None:
    text = TEMPLATE.read_text()
    matrix = re.search(r"# image_to_probe = \[\n(?:# .*\n)+", text)
    assert matrix is not None
    parts = text.index("rotation = ["), text.index("offset_mm = ")
    other = tmp_path / "other.toml"
    rest = text[: parts[0]] + text[text.index("\n", parts[1]) :]
    other.write_text(rest.replace(matrix[0], matrix[0].replace("# ", "")))
    given = image_to_probe(read_calibration(TEMPLATE))
    np.testing.assert_allclose(image_to_probe(read_calibration(other)), given, atol=0.01)


def test_a_recording_without_motion_writes_no_calibration(tmp_path) -> None:
    recording, rough = tmp_path / "session.igs.mha", tmp_path / "rough.toml"
    write_metaimage(recording, items(40, (48, 32)), (48, 32))
    write_calibration(rough, Calibration(np.eye(3), (1, 1), np.array([0.2, 0.2]), np.zeros(3), (48, 32)), {})
    wanted = tmp_path / "estimate.toml"
    refused = answered("replay", recording, "--calibration", rough, "--estimate", wanted)
    assert refused.returncode == 65
    assert "of the calibration. Record a minute of tissue" in refused.stderr
    assert not wanted.exists()
    assert answered("replay", recording, "--calibration", rough, "--estimate", rough).returncode == 78


def turn_deg(one: Calibration, other: Calibration) -> float:
    return float(np.degrees(np.linalg.norm(vector_from_rotation(one.rotation @ other.rotation.T))))


def record(path: Path, world: World, duration_s: float, rate_hz: int = 20) -> Path:
    """A PLUS sequence in which each picture carries its own pose."""
    sequence = []
    for index in range(round(duration_s * rate_hz)):
        t_s = index / rate_hz
        poses = {"ProbeToTracker": world.measured_pose(t_s, index)}
        t_ns = 7_000_000_000 + index * 1_000_000_000 // rate_hz
        sequence.append(SequenceItem(t_ns, world.frame(t_s, index), poses))
    write_metaimage(path, sequence, SIZE_PX)
    return path


@pytest.mark.slow
def test_from_a_ruler_to_a_verified_calibration(tmp_path) -> None:
    """Rotation 5° off, scales 3 %, offset 8 mm: what a ruler and the eye give."""
    tissue = record(tmp_path / "tissue.igs.mha", World(1, "gestured", "tissue"), 35)
    wires = record(tmp_path / "wires.igs.mha", World(1, "freehand", "cross-wire"), 35)
    true = calibration_from_image_to_probe(World(1).image_to_probe, SIZE_PX)
    axis = np.array([0.6, -0.64, 0.48])
    rough = replace(
        true,
        rotation=rotation_from_vector(np.radians(5) * axis) @ true.rotation,
        scale_mm_per_px=true.scale_mm_per_px * [1.03, 0.97],
        offset_mm=true.offset_mm + 8 * axis[::-1],
    )
    latest = tmp_path / "step-0.toml"
    write_calibration(latest, rough, {})
    for step in range(1, 6):
        found = tmp_path / f"step-{step}.toml"
        arguments = ("--calibration", latest, "--estimate", found, "--json")
        answer = answered("replay", tissue, *arguments)
        assert answer.returncode == 0
        latest, verdict = found, json.loads(answer.stdout)["verdict"]
        if verdict == "OK":
            break
    assert verdict == "OK", "settled"
    final = tmp_path / "probe.toml"
    scan = ("--recording", wires, "--calibration", latest, "--output", final)
    assert answered("recalibrate", *scan, "--solve", "offset").returncode == 0
    found = read_calibration(final)
    assert turn_deg(found, true) < 1.0
    assert np.abs(found.scale_mm_per_px / true.scale_mm_per_px - 1).max() < 0.01
    np.testing.assert_allclose(found.offset_mm, true.offset_mm, atol=1.0)
