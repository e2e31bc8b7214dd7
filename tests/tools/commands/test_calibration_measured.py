"""`probewatch calibration measured` on an alarm log of weeks, beside what the cross-wire states."""

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from probewatch.appliance.core.parameters import PER_UNIT
from probewatch.appliance.core.quality.calibration_difference import difference
from probewatch.appliance.storage.alarm_chain import segments
from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.appliance.storage.calibration_file import read_calibration, write_calibration
from probewatch.appliance.types import PARAMETERS
from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.commands.calibration import command
from probewatch.tools.shared.motion_measured import HEADINGS
from tests.support.stores import configuration, log, settled, started

pytestmark = pytest.mark.usefixtures("log")
__all__ = ["log"]
NOON = datetime(2026, 1, 1, 12, tzinfo=UTC)
BEND, SLIDE = 1.2, -0.9
"""What is truly wrong: rotation-lateral in deg, offset-axial in mm."""


def asked(folder: Path, *arguments: object) -> Result:
    words = ["measured", "--folder", str(folder), *map(str, arguments)]
    return CliRunner(env={"COLUMNS": "120"}).invoke(command, words)


def scanned(folder: Path, days: int, names: tuple[str, ...] = (*PARAMETERS, "latency")) -> None:
    """Six estimates a day, at .6 of each unit; a fault of reference 1 that no window alone would name."""
    random, store = np.random.default_rng(5), AlarmLog(folder)
    store.append(NOON, 0, "started", {}, None)
    truth = {"rotation-lateral": BEND, "offset-axial": SLIDE}
    times = [NOON + timedelta(days=k, seconds=300 * i) for k in range(days) for i in range(6)]
    for count, at in enumerate(times):
        checks = {name: [truth.get(name, 0.0) + 0.5 * random.standard_normal(), 0.6, 4.0] for name in names}
        noted = {"reference": 1, "checks": checks, "windows": dict.fromkeys(names, 1)}
        store.append(at, count, "estimate", noted, None)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The alarm log of a cart whose reference states .2° and .3 mm of its cross-wire."""
    config = configuration(tmp_path)
    file = tmp_path / "probe.toml"
    stated = np.array([0.2, 0.2, 0.2, 0.5, 0.5, 0.3, 0.3, 0.3]) / PER_UNIT[:8]
    write_calibration(file, replace(read_calibration(file), covariance=np.diag(stated**2)), {})
    settled(started(config))
    return Path(config.alarm.folder)


def test_what_motion_measured_stands_beside_what_the_cross_wire_states(folder: Path) -> None:
    scanned(folder, 20)
    result = asked(folder)
    assert result.exit_code == 0
    assert [name in result.stdout for name in HEADINGS] == [True] * len(HEADINGS)
    told = {one["name"]: one for one in json.loads(asked(folder, "--json").stdout)["parameters"]}
    bend, turn = told["rotation-lateral"], told["rotation-axial"]
    assert (bend["estimates"], bend["examinations"], bend["calibrated_sigma"]) == (120, 20, pytest.approx(0.2))
    assert abs(bend["value"] - BEND) < 3 * bend["sigma"] < 3 * 0.1
    assert bend["apart_sigmas"] > 4
    assert turn["apart_sigmas"] < 3
    assert told["latency"]["calibrated_sigma"] is None


def test_the_calibration_of_all_motion_is_written_with_its_sigmas(folder: Path, tmp_path: Path) -> None:
    scanned(folder, 20)
    result = asked(folder, "--output", tmp_path / "in-vivo.toml")
    assert result.exit_code == 0, result.output
    before, found = read_calibration(tmp_path / "probe.toml"), read_calibration(tmp_path / "in-vivo.toml")
    change = difference(before, found)
    assert change.rotation_deg == pytest.approx(BEND, abs=0.25)
    assert change.offset_mm[1] == pytest.approx(SLIDE, abs=0.4)
    assert found.covariance is not None
    assert np.rad2deg(np.sqrt(found.covariance[0, 0])) < 0.1
    assert isinstance(asked(folder, "--output", tmp_path / "in-vivo.toml").exception, ConfigurationError), "it is there"


def test_a_parameter_that_no_motion_showed_makes_no_calibration(folder: Path, tmp_path: Path) -> None:
    scanned(folder, 2, PARAMETERS[:7])
    result = asked(folder, "--output", tmp_path / "in-vivo.toml")
    assert isinstance(result.exception, ConfigurationError)
    assert "offset-elevational" in str(result.exception)
    assert not (tmp_path / "in-vivo.toml").exists()


def test_nothing_yet_is_said_and_a_damaged_log_tells_what_it_holds(folder: Path) -> None:
    scanned(folder, 0)
    result = asked(folder)
    assert (result.exit_code, "no estimate of reference 1 yet" in result.stdout) == (3, True)
    scanned(folder, 1)
    with segments(folder)[-1].open("r+b") as file:
        file.seek(40)
        file.write(b"X")
    result = asked(folder)
    assert result.exit_code == 65
    assert "rotation-lateral" in result.stdout
    assert "damaged" in result.stderr


def test_a_reference_that_never_was_is_refused(folder: Path) -> None:
    result = asked(folder, 7)
    assert isinstance(result.exception, ConfigurationError)
