"""`probewatch noise` on recorded simulated sessions, as a technician asks it."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from probewatch.appliance.configuration.config import load_config
from probewatch.appliance.configuration.noise_file import read_noise
from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.limits import NAMED_NATS
from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.appliance.types import Calibration
from probewatch.drivers.errors import ProbewatchError
from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from probewatch.drivers.samples import Frame, Stamp
from probewatch.drivers.twins.faults import Schedule
from probewatch.drivers.twins.scene.world import WorldSettings
from probewatch.tools.commands import noise
from probewatch.tools.commands.noise import command
from tests.appliance.configuration.test_config import GOOD, written
from tests.support.black_boxes import record
from tests.support.recordings import items, picture
from tests.support.sessions import SWEPT, kept, session

SMALL = WorldSettings(width_px=400, height_px=300, scale_mm_per_px=(0.09, 0.08))
FLIP = '[{"fault": "flip-lateral", "from_s": 3.0, "to_s": null}]'


def recorded(path: Path, faults: str = "[]", seconds: float = 6.0) -> Path:
    world = kept(3, settings=SMALL)
    reference = calibration_from_image_to_probe(world.image_to_probe, (400, 300))
    record(path, EstimatorSettings(1, reference, SWEPT, 500_000_000), session(world, seconds, Schedule.parse(faults)))
    return path


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("healthy") / "scan.mcap")


def learn(*arguments: object) -> Result:
    return CliRunner().invoke(command, [str(one) for one in arguments])


def refused(*arguments: object) -> str:
    result = learn(*arguments)
    assert isinstance(result.exception, ProbewatchError), result.output
    assert result.exception.exit_code == 65
    return str(result.exception)


@pytest.mark.thorough
def test_healthy_scanning_becomes_a_file_that_a_configuration_names(
    healthy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(noise, "least_hours", lambda: 0.001)
    result = learn(healthy, "--output", tmp_path / "noise.toml")
    assert result.exit_code == 0, result.output
    learned = read_noise(tmp_path / "noise.toml")
    assert 0.001 <= learned.hours <= 6 / 3600 + 0.0005
    assert [one.sha256 for one in learned.recording] == [hashlib.sha256(healthy.read_bytes()).hexdigest()]
    assert (learned.simulated, learned.software.split()[0]) == (True, "probewatch")
    assert learned.named_nats > NAMED_NATS, "six seconds without a peak show little"
    assert f"a fault is named from {learned.named_nats:.1f} nats" in result.output
    config = load_config(written(tmp_path, GOOD + '[noise]\nfile = "noise.toml"\n'))
    assert config.limits.named_nats == learned.named_nats


@pytest.mark.thorough
def test_too_little_scanning_says_how_much_is_needed_and_writes_nothing(healthy: Path, tmp_path: Path) -> None:
    said = refused(healthy, "--output", tmp_path / "noise.toml")
    assert "1 min of scanning with motion to test are too little. At least 46 min are needed, 46 min more" in said
    assert not (tmp_path / "noise.toml").exists()


@pytest.mark.thorough
def test_a_faulty_recording_is_refused_by_name(tmp_path: Path) -> None:
    box = recorded(tmp_path / "flipped.mcap", FLIP)
    said = refused(box, "--output", tmp_path / "noise.toml")
    assert said.startswith(f"{box}: is not healthy scanning: polarity")


def told_live(path: Path, state: str, fault: str | None) -> Path:
    """A box of few pictures, in which the service said this."""
    world = kept(3, settings=SMALL)
    reference = calibration_from_image_to_probe(world.image_to_probe, (400, 300))
    settings = EstimatorSettings(1, reference, SWEPT, 500_000_000)
    record(path, settings, session(world, 0.2), told={3: {"state": state, "fault": fault, "reason": "mirrored"}})
    return path


@pytest.mark.parametrize(
    ("state", "fault", "healthy"),
    [
        ("halt", "polarity", False),
        ("recalibration requested", "offset", False),
        ("halt", "field-distortion", False),
        ("warning", "polarity", True),
        ("internal fault", "estimator-silent", True),
        ("halt", "a fault of a later version", True),
    ],
)
def test_a_box_in_which_the_service_halted_is_not_healthy_however_little_of_it_is_there(
    tmp_path: Path, state: str, fault: str, healthy: bool
) -> None:
    """The recorder was too slow for all but 0.4 s of a mirrored picture; it was called too little scanning."""
    box = told_live(tmp_path / "box.mcap", state, fault)
    said = refused(box, "--output", tmp_path / "noise.toml")
    refusal = f"{box}: is not healthy scanning: the service said {state}, {fault}, mirrored"
    assert said.startswith(refusal) is not healthy
    assert ("are too little" in said) is healthy


@pytest.mark.thorough
def test_a_black_box_named_twice_counts_once(healthy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(noise, "least_hours", lambda: 0.001)
    again = tmp_path / "again.mcap"
    again.write_bytes(healthy.read_bytes())
    result = learn(healthy, again, "--output", tmp_path / "noise.toml")
    learned = read_noise(tmp_path / "noise.toml")
    assert learned.hours <= 6 / 3600 + 0.0005, result.output
    assert len(learned.recording) == 1


def test_a_sequence_named_twice_is_refused(tmp_path: Path) -> None:
    for name in ("one.igs.mha", "two.igs.mha"):
        (tmp_path / name).write_text("the same")
    given = (tmp_path / "one.igs.mha", tmp_path / "two.igs.mha", "--calibration", tmp_path / "probe.toml")
    assert "is the same recording as" in refused(*given, "--output", tmp_path / "noise.toml")


@pytest.mark.thorough
def test_a_damaged_recording_is_refused(healthy: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(healthy.read_bytes()[:-200_000])
    assert "damaged" in refused(cut, "--output", tmp_path / "noise.toml")


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.mcap").write_text("no recording")
    result = learn(tmp_path / "notes.mcap", "--output", tmp_path / "noise.toml")
    assert result.exit_code != 0
    assert not (tmp_path / "noise.toml").exists()


def test_a_sequence_whose_tools_have_other_names_is_learned_from_as_replay_reads_it(tmp_path: Path) -> None:
    """It was refused, with a remedy that only replay had."""
    size_px = (48, 32)
    scan, probe = tmp_path / "scan.igs.mha", tmp_path / "probe.toml"
    stylus = [
        replace(one, transforms={"StylusToTracker": one.transforms["ProbeToTracker"]}) for one in items(6, size_px)
    ]
    write_metaimage(scan, stylus, size_px)
    write_calibration(probe, Calibration(np.eye(3), (1, 1), np.array([0.2, 0.2]), np.zeros(3), size_px), {})
    given = (scan, "--calibration", probe, "--output", tmp_path / "noise.toml")
    assert "--probe Stylus" in refused(*given)
    assert "are too little" in refused(*given, "--probe", "Stylus", "--reference", "Tracker", "--orientation", "MF")
    assert "'XX' is not M or U" in refused(*given, "--probe", "Stylus", "--orientation", "XX")


@pytest.mark.parametrize("option", ["--probe", "--reference", "--orientation"])
def test_an_option_for_sequences_without_any_is_refused(tmp_path: Path, option: str) -> None:
    size_px = (48, 32)
    reference = Calibration(np.eye(3), (1, 1), np.array([0.2, 0.2]), np.zeros(3), size_px)
    frames = [Frame(Stamp(n * 100_000_000, 0), n, picture(n, size_px)) for n in range(3)]
    record(tmp_path / "a.mcap", EstimatorSettings(1, reference, SWEPT, 500_000_000), frames)
    result = learn(tmp_path / "a.mcap", "--output", tmp_path / "noise.toml", option, "Stylus")
    assert (result.exit_code, f"{option} is for sequences" in result.output) == (2, True), result.output
