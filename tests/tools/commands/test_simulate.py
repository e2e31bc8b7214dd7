"""`probewatch simulate cart`: what it refuses; a whole cart beside a service is in tests/live/test_simulate_cart.py."""

import tomllib
from pathlib import Path

import click
import pytest

from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.simulators.cart import _claimed, _recorder
from probewatch.tools.simulators.whole_cart import SimulatedDevices
from tests.support.answers import answered


@pytest.mark.parametrize("option", ["--write", "--folder"])
def test_a_place_that_cannot_be_is_refused_before_anything_starts(option: str) -> None:
    refused = answered("simulate", "cart", option, "/dev/null/at/all")
    assert (refused.returncode, refused.stdout) == (78, "")
    assert "/dev/null/at/all" in refused.stderr


def test_a_folder_holds_one_cart_at_a_time(tmp_path: Path) -> None:
    with _claimed(tmp_path, 1):
        refused = answered("simulate", "cart", "--folder", tmp_path)
        assert (refused.returncode, refused.stdout) == (78, "")
        assert "a simulated cart runs there already" in refused.stderr
        with pytest.raises(ConfigurationError, match="runs there already"), _claimed(tmp_path, 1):
            raise AssertionError


def test_the_cart_of_a_folder_goes_on_and_says_what_is_left(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with _claimed(tmp_path, 3):
        assert capsys.readouterr().err == "", "it is a new one"
    (tmp_path / "scanner.json").write_text('["depth"]')
    with _claimed(tmp_path, 3):
        told = capsys.readouterr().err
    assert f"the cart in {tmp_path} goes on" in told
    assert "still in force there: scanner.json" in told


def test_a_folder_whose_calibration_is_of_another_probe_is_refused(tmp_path: Path) -> None:
    with pytest.raises(click.Abort), _claimed(tmp_path, 3):
        raise click.Abort
    refused = answered("simulate", "cart", "--folder", tmp_path, "--seed", "4")
    assert refused.returncode == 78
    assert "of a cart of --seed 3. Continue it with --seed 3" in refused.stderr


def test_a_simulated_cart_names_a_place_for_its_recorder(tmp_path: Path) -> None:
    """`probewatch record` went for that of the computer, and could not be tried beside one."""
    said = tomllib.loads(_recorder(SimulatedDevices(tmp_path)))
    assert said["recorder"] == {"folder": str(tmp_path / "recorder"), "socket": str(tmp_path / "record")}
