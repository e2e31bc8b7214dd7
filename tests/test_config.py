"""Every refusal of the configuration names file, key, value and bound, in one line."""

import re
from pathlib import Path

import pytest

from appliance.config import SupervisorTimes, load_config
from appliance.limits import Limits
from appliance.supervision.ledger import Durations
from appliance.supervision.watchers.facts import Patience
from drivers.errors import ConfigurationError

EXAMPLE = Path(__file__).parent.parent / "config" / "probewatch.toml"
GOOD = """
[video]
url = "sim:/tmp/x/scanner"
[tracker]
url = "ndi:/dev/ttyUSB0"
[[output]]
url = "relay:/dev/ttyUSB1"
[calibration]
file = "probe.toml"
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "probewatch.toml"
    path.write_text(text)
    return path


def refusal(folder: Path, text: str) -> str:
    with pytest.raises(ConfigurationError) as caught:
        load_config(written(folder, text))
    message = str(caught.value)
    assert "\n" not in message
    assert str(folder / "probewatch.toml") in message
    assert caught.value.exit_code == 78
    return message


def test_a_short_file_gets_every_default(tmp_path: Path) -> None:
    config = load_config(written(tmp_path, GOOD))
    assert (config.video.url, config.tracker.url) == ("sim:/tmp/x/scanner", "ndi:/dev/ttyUSB0")
    assert [output.url for output in config.output] == ["relay:/dev/ttyUSB1"]
    assert config.calibration.file == tmp_path / "probe.toml"
    assert config.limits == Limits()
    assert config.supervisor.durations() == Durations()
    assert config.supervisor.patience() == Patience()


def test_units_become_nanoseconds(tmp_path: Path) -> None:
    text = GOOD + "[supervisor]\nhalt_after_s = 0.25\nvideo_silence_ms = 120\nunseen_s = 5\n"
    times = load_config(written(tmp_path, text)).supervisor
    assert times.durations().halt_after_ns == 250_000_000
    assert times.patience().video_ns == 120_000_000
    assert times.patience().unseen_ns == 5_000_000_000


def test_the_commented_example_is_valid_and_names_every_key_with_its_default() -> None:
    config = load_config(EXAMPLE)
    assert config.limits == Limits()
    text = EXAMPLE.read_text()
    for model in (Limits(), SupervisorTimes()):
        for name, value in model:
            line = next(line for line in text.splitlines() if line.startswith(f"# {name} = "))
            assert float(line.split("=")[1].split("#")[0]) == value
            bounds = {type(bound).__name__: bound for bound in type(model).model_fields[name].metadata}
            low, high = (float(part) for part in line.split("#")[-1].split("…"))
            assert (low, high) == (bounds["Ge"].ge, bounds["Le"].le)


def test_two_outputs(tmp_path: Path) -> None:
    config = load_config(written(tmp_path, GOOD + '[[output]]\nurl = "relay:/dev/ttyUSB2"\n'))
    assert len(config.output) == 2


@pytest.mark.parametrize(
    ("addition", "parts"),
    [
        ("[limits]\nrotation_deg = 50\n", ["[limits] rotation_deg = 50", "less than or equal to 30"]),
        ("[limits]\nrotation_dge = 3\n", ["[limits] rotation_dge", "did you mean 'rotation_deg'?"]),
        ("[limts]\n", ["'limts'", "did you mean 'limits'?"]),
        ("[supervisor]\nhalt_after_ms = 1\n", ["halt_after_ms", "did you mean 'halt_after_s'?"]),
        ("[supervisor]\nhalt_after_s = '1'\n", ["halt_after_s = '1'", "valid number"]),
        ("[supervisor]\nhalt_after_s = nan\n", ["halt_after_s = nan", "finite"]),
        ("[supervisor]\nprobation_s = 0\n", ["probation_s = 0", "greater than or equal to 0.1"]),
        ("[log]\nlevel = 'loud'\n", ["[log] level = 'loud'", "'debug'"]),
        ("[control]\nxyzzy = 1\n", ["[control] xyzzy", "known: socket"]),
        ("[[output]]\nurl = 'relais:/dev/x'\n", ["[output (entry 2)] url = 'relais:/dev/x'", "relay:"]),
        ("[[output]]\nport = 1\n", ["[output] entry 2 url is missing", "[output] entry 2 port is not known"]),
        (f"[control]\nsocket = '/run/{'x' * 100}'\n", ["[control] socket", "100 bytes"]),
    ],
)
def test_refusals(tmp_path: Path, addition: str, parts: list[str]) -> None:
    message = refusal(tmp_path, GOOD + addition)
    for part in parts:
        assert part in message


def test_missing_sections_are_all_named(tmp_path: Path) -> None:
    message = refusal(tmp_path, "")
    for section in ("video", "tracker", "output", "calibration"):
        assert f"'{section}' is missing" in message


def test_no_output_at_all_is_refused(tmp_path: Path) -> None:
    without = GOOD.replace('[[output]]\nurl = "relay:/dev/ttyUSB1"\n', "")
    assert "at least 1" in refusal(tmp_path, "output = []\n" + without)


def test_syntax_errors_give_line_and_column(tmp_path: Path) -> None:
    assert "line 2, column 8" in refusal(tmp_path, "[video]\nurl = [\x01\n")


@pytest.mark.parametrize("value", [5000 * "1", 5000 * "["])
def test_numbers_and_nestings_beyond_reason_are_refused(tmp_path: Path, value: str) -> None:
    assert "not valid TOML" in refusal(tmp_path, f"x = {value}")


def test_text_that_is_not_utf8(tmp_path: Path) -> None:
    path = tmp_path / "probewatch.toml"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigurationError, match="UTF-8"):
        load_config(path)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="No such file"):
        load_config(tmp_path / "nothing.toml")


def test_lamps_alone_are_refused(tmp_path: Path) -> None:
    message = refusal(tmp_path, GOOD.replace('"relay:/dev/ttyUSB1"', '"relay:/dev/ttyUSB1"\nsignal = "red"'))
    assert "no output has signal = 'contact'" in message


def test_an_unknown_signal_names_those_that_exist(tmp_path: Path) -> None:
    message = refusal(tmp_path, GOOD.replace('"relay:/dev/ttyUSB1"', '"relay:/dev/ttyUSB1"\nsignal = "blue"'))
    assert "'contact', 'green', 'cyan', 'yellow', 'red' or 'tone'" in message


def test_two_outputs_on_one_contact_are_refused(tmp_path: Path) -> None:
    assert "two outputs share one contact" in refusal(tmp_path, GOOD + '[[output]]\nurl = "relay:/dev/ttyUSB1"\n')


def test_the_template_names_no_simulated_device() -> None:
    written = EXAMPLE.read_text(encoding="utf-8")
    assert not re.findall(r'^[^#\n]*"(?:sim|replay):.*$', written, re.M), "a cart must not be watched by a simulation"
