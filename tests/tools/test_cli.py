"""A misspelt command or URL is refused with the one that was probably meant."""

import click
import pytest
from click.testing import CliRunner

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.registry import known_schemes, split_url
from probewatch.tools.cli import probewatch
from tests.support.commands import commands


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["statsu"], "No such command 'statsu'. Did you mean 'status'?"),
        (["acknowledge"], "Did you mean 'ack'?"),
        (["lamptest"], "Did you mean 'lamp-test'?"),
        (["simulate", "optotrack"], "Did you mean 'optotrak'?"),
        (["xyz"], "Use one of ack, calibration, check"),
    ],
)
def test_an_unknown_command(words: list[str], said: str) -> None:
    result = CliRunner().invoke(probewatch, words)
    assert result.exit_code == 2
    assert said in result.stderr


def test_no_option_of_any_command_takes_the_next_option_for_its_text() -> None:
    """Such as `pause --off --on`, which switched the sound off with the reason "--on"."""
    tried = 0
    for path, command in commands():
        if isinstance(command, click.Group):
            continue
        options = [one for one in command.params if isinstance(one, click.Option)]
        for one in options:
            if not one.is_flag and not one.count:
                result = CliRunner().invoke(probewatch, [*path, one.opts[0], options[-1].opts[0]])
                said = f"Option '{one.opts[0]}' needs a value, and '{options[-1].opts[0]}' is an option"
                assert (result.exit_code, said in result.stderr) == (2, True), (path, result.stderr)
                tried += 1
    assert tried > 100


@pytest.mark.parametrize(
    ("url", "meant"),
    [
        ("/dev/ttyUSB0", "'ndi:/dev/ttyUSB0' or 'relay:/dev/ttyUSB0' or 'serialpin:/dev/ttyUSB0?pin=rts'"),
        ("/dev/serial/by-id/usb-X", "'ndi:/dev/serial/by-id/usb-X' or"),
        ("/dev/video2", "'v4l2:/dev/video2'"),
        ("/dev/gpiochip0", "'gpio:/dev/gpiochip0?line=17'"),
        ("rtsp://scanner/1", "'opencv:rtsp://scanner/1'"),
        ("scan.igs.mha", "'replay:scan.igs.mha'"),
        ("192.168.1.20:8765", "'ndi+tcp://192.168.1.20:8765' or 'optotrak://192.168.1.20:8765'"),
        ("tcp://vega", "'ndi+tcp://vega'"),
        ("v4l:/dev/video0", "'v4l2:/dev/video0'"),
        ("nid:/dev/ttyUSB0", "'ndi:/dev/ttyUSB0'"),
    ],
)
def test_what_is_nearly_a_url(url: str, meant: str) -> None:
    with pytest.raises(ConfigurationError) as refusal:
        split_url(url)
    assert refusal.value.remedy.startswith(f"Did you mean {meant}")
    assert refusal.value.exit_code == 78


def test_what_is_meant_by_nothing_names_the_kinds() -> None:
    with pytest.raises(ConfigurationError) as refusal:
        split_url("x y:z")
    assert refusal.value.remedy == f"Use one of {', '.join(f'{scheme}:' for scheme in sorted(known_schemes()))}"
