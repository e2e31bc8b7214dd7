"""Every refusal of the configuration names file, key, value and bound, in one line."""

import importlib
import re
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from probewatch.appliance.configuration import toml_lines
from probewatch.appliance.configuration.config import SupervisorTimes, load_config
from probewatch.appliance.configuration.mistakes import Mistakes
from probewatch.appliance.configuration.toml_lines import key_lines, line_of
from probewatch.appliance.limits import Limits
from probewatch.appliance.supervision.device_health import Timeouts
from probewatch.appliance.supervision.policy import Durations
from probewatch.appliance.types import PARAMETERS
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.registry import device_kinds, drivers

TRACKERS = ", ".join(f"{scheme}:" for scheme in sorted(drivers()) if "tracker" in device_kinds(f"{scheme}:x"))
EXAMPLE = Path(__file__).parents[3] / "config" / "probewatch.toml"
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
    assert config.supervisor.timeouts() == Timeouts()


def test_a_verdict_may_be_behind_by_what_the_urls_take_off_the_stamps(tmp_path: Path) -> None:
    urls = GOOD.replace("sim:/tmp/x/scanner", "opencv:rtsp://scanner/x?delay_ms=1500")
    config = load_config(written(tmp_path, urls.replace("ttyUSB0", "ttyUSB0?latency_ms=80")))
    assert config.durations == replace(Durations(), behind_ns=Durations().behind_ns + 1_580_000_000)


@pytest.mark.parametrize("delay_ms", ["abc", "nan", "1e999"])
def test_a_delay_that_is_no_number_is_left_to_the_driver_to_refuse(tmp_path: Path, delay_ms: str) -> None:
    config = load_config(written(tmp_path, GOOD.replace("scanner", f"scanner?delay_ms={delay_ms}")))
    assert config.durations == Durations()


def test_units_become_nanoseconds(tmp_path: Path) -> None:
    text = GOOD + "[supervisor]\nhalt_after_s = 0.25\nvideo_silence_ms = 120\nunseen_s = 5\n"
    times = load_config(written(tmp_path, text)).supervisor
    assert times.durations().halt_after_ns == 250_000_000
    assert times.timeouts().video_ns == 120_000_000
    assert times.timeouts().out_of_sight_ns == 5_000_000_000


def test_the_commented_example_is_valid_and_names_every_key_with_its_default() -> None:
    config = load_config(EXAMPLE)
    assert config.limits == Limits()
    text = EXAMPLE.read_text()
    for model in (Limits(), SupervisorTimes()):
        for name, value in model:
            if name in ("required_age_s", "region", "named_nats", "profile"):  # sections, not by hand, words
                continue
            line = next(line for line in text.splitlines() if line.startswith(f"# {name} = "))
            assert value in (None, float(line.split("=")[1].split("#")[0]))  # None: off, and the value an example
            bounds = {type(bound).__name__: bound for bound in type(model).model_fields[name].metadata}
            low, high = (float(part) for part in line.split("#")[-1].split("…"))
            assert (low, high) == (bounds["Ge"].ge, bounds["Le"].le)


def test_the_commented_example_names_every_parameter_with_how_old_its_motion_may_be() -> None:
    section = EXAMPLE.read_text().split("[limits.required_age_s]")[1].split("[supervisor]")[0]
    told = dict(re.findall(r"^# ([a-z-]+) = (\d+)$", section, re.M))
    ages_ns = load_config(EXAMPLE).required_ages_ns
    assert {*told} == {*PARAMETERS, "polarity", "latency"}
    assert {name: int(age_s) * 10**9 for name, age_s in told.items() if age_s != "0"} == ages_ns


def test_a_parameter_may_be_asked_for_with_an_age_of_its_own(tmp_path: Path) -> None:
    text = GOOD + "[limits.required_age_s]\noffset-axial = 90.5\nscale-axial = 20\nrotation-axial = 0\n"
    ages_ns = load_config(written(tmp_path, text)).required_ages_ns
    assert (ages_ns["offset-axial"], ages_ns["scale-axial"], ages_ns["latency"]) == (90.5e9, 20e9, 30e9)
    assert "rotation-axial" not in ages_ns
    assert ages_ns["offset-lateral"] == 120e9


def test_the_supervisors_bound_shortens_every_default_and_refuses_what_is_stated(tmp_path: Path) -> None:
    text = GOOD + "[supervisor]\nmax_verification_age_s = 20\n"
    assert {*load_config(written(tmp_path, text)).required_ages_ns.values()} == {20 * 10**9}
    message = refusal(tmp_path, text + "[limits.required_age_s]\noffset-axial = 21\n")
    assert "line 13: [limits.required_age_s] offset-axial = 21" in message, "of two sections it had no line"
    assert "offset-axial = 21 is longer than [supervisor] max_verification_age_s = 20" in message
    message = refusal(tmp_path, text + "[limits]\nat_rest_s = 21\n")
    assert "line 13: [limits] at_rest_s" in message
    assert "[limits] at_rest_s = 21 is longer than [supervisor] max_verification_age_s = 20" in message


def test_the_commented_way_to_ask_for_less_is_valid_and_leaves_the_offsets_out(tmp_path: Path) -> None:
    section = EXAMPLE.read_text().split("[limits.required_age_s]")[1].split("[supervisor]")[0]
    less = re.findall(r"^#   (offset-[a-z]+ = 0)$", section, re.M)
    config = load_config(written(tmp_path, GOOD + "[limits.required_age_s]\n" + "\n".join(less) + "\n"))
    assert {*config.required_ages_ns} == {*Limits().required_age_s.names} - {
        f"offset-{axis}" for axis in ("lateral", "axial", "elevational")
    }


def test_two_outputs(tmp_path: Path) -> None:
    config = load_config(written(tmp_path, GOOD + '[[output]]\nurl = "relay:/dev/ttyUSB2"\n'))
    assert len(config.output) == 2


@pytest.mark.parametrize(
    ("addition", "parts"),
    [
        ("[limits]\nrotation_deg = 50\n", ["[limits] rotation_deg = 50", "less than or equal to 30"]),
        ("[limits]\nrotation_dge = 3\n", ["[limits] rotation_dge", "Did you mean 'rotation_deg'?"]),
        ("[limts]\n", ["'limts'", "Did you mean 'limits'?"]),
        ("[supervisor]\nhalt_after_ms = 1\n", ["halt_after_ms", "Did you mean 'halt_after_s'?"]),
        ("[supervisor]\nhalt_after_s = '1'\n", ["halt_after_s = '1'", "valid number"]),
        ("[supervisor]\nhalt_after_s = nan\n", ["halt_after_s = nan", "finite"]),
        ("[supervisor]\nprobation_s = 0\n", ["probation_s = 0", "greater than or equal to 0.1"]),
        ("[log]\nlevel = 'loud'\n", ["[log] level = 'loud'", "'debug'"]),
        ("[control]\nxyzzy = 1\n", ["[control] xyzzy", "known: socket"]),
        (
            "[[output]]\nurl = 'relais:/dev/x'\n",
            ["[output] entry 2 url = 'relais:/dev/x'", "Did you mean 'relay:/dev/x'?"],
        ),
        ("[[output]]\nport = 1\n", ["[output] entry 2 url is missing", "[output] entry 2 port is not known"]),
        ("[limits]\npoint_mm = 0.1\n", ["[limits] point_mm = 0.1", "greater than or equal to 0.5"]),
        ("[limits]\npoint_depth_mm = -1\n", ["[limits] point_depth_mm = -1", "greater than or equal to 0"]),
        ("[limits.region]\nleft = 0.5\nright = 0.5\n", ["[limits] region", "left must be less than right"]),
        ("[limits.region]\ntop = 1.0\n", ["[limits] region", "top less than bottom"]),
        ("[limits.region]\nright = 1.5\n", ["[limits] region right = 1.5", "less than or equal to 1"]),
        ("[limits.region]\nmiddle = 0.5\n", ["[limits] region middle"]),
        ("[limits.required_age_s]\npolarity = 0\n", ["[limits] required_age_s", "without polarity and latency"]),
        ("[limits.required_age_s]\nlatency = 0.0\n", ["[limits] required_age_s", "without polarity and latency"]),
        ("[limits.required_age_s]\noffset-axial = 121\n", ["offset-axial = 121", "max_verification_age_s = 120"]),
        ("[limits.required_age_s]\noffset-axial = -1\n", ["[limits] required_age_s offset-axial = -1"]),
        ("[limits.required_age_s]\noffset-axail = 1\n", ["offset-axail", "Did you mean 'offset-axial'?"]),
        ("[limits.required_age_s]\noffset_axial = 1\n", ["offset_axial", "Did you mean 'offset-axial'?"]),
        (f"[control]\nsocket = '/run/{'x' * 100}'\n", ["[control] socket", "100 bytes"]),
    ],
)
def test_refusals(tmp_path: Path, addition: str, parts: list[str]) -> None:
    message = refusal(tmp_path, GOOD + addition)
    for part in parts:
        assert part in message


def test_missing_sections_are_all_named(tmp_path: Path) -> None:
    message = refusal(tmp_path, "")
    for section in ("video", "tracker", "output"):
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


def test_a_key_that_is_there_twice_is_named(tmp_path: Path) -> None:
    said = refusal(tmp_path, GOOD + "[log]\nlevel = 1\nlevel = 2\n")
    line = GOOD.count("\n") + 3
    assert f"is not valid TOML: the key level is there twice (at line {line})" in said


def test_the_template_names_no_simulated_device() -> None:
    written = EXAMPLE.read_text(encoding="utf-8")
    assert not re.findall(r'^[^#\n]*"(?:sim|replay):.*$', written, re.M), "a cart must not be watched by a simulation"


@pytest.mark.parametrize(
    ("good", "bad", "said"),
    [
        ("[video]", "[vidoe]", "line 2: 'vidoe' is not known. Did you mean 'video'?"),
        ('url = "sim', 'ulr = "sim', "line 3: [video] ulr is not known. Did you mean 'url'?"),
        ("[[output]]", "[output]", "line 6: 'output': must be a list of sections, each written [[output]]"),
        (
            "[tracker]",
            '[control]\nviewers = "anna"\n[tracker]',
            "[control] viewers = 'anna': must be a list, written [\"anna\", …]",
        ),
        (
            "[tracker]",
            "[control]\ngroup = 2020-01-01\n[tracker]",
            "[control] group = 2020-01-01: must be text in quotes",
        ),
        ("[tracker]", "[control]\nviewers = [5]\n[tracker]", "[control] viewers entry 1 = 5: must be text in quotes"),
        ('[[output]]\nurl = "relay:/dev/ttyUSB1"', "output = 'relay:/x'", "line 6: [tracker] output is not known"),
        ('"ndi:/dev/ttyUSB0"', "5", "line 5: [tracker] url = 5: must be text in quotes"),
        (
            '"ndi:/dev/ttyUSB0"',
            '"relay:/dev/x"',
            f"'relay:' is an alarm output, not a tracker. Use one of {TRACKERS}",
        ),
        ('"ndi:/dev/ttyUSB0"', '"/dev/ttyUSB0"', "Did you mean 'ndi:/dev/ttyUSB0'?"),
        (
            '"relay:/dev/ttyUSB1"',
            '"/dev/ttyUSB1"',
            "Did you mean 'relay:/dev/ttyUSB1' or 'serialpin:/dev/ttyUSB1?pin=rts'?",
        ),
        ('"sim:/tmp/x/scanner"', '"/dev/video0"', "Did you mean 'v4l2:/dev/video0'?"),
        ('"probe.toml"', '"probe.toml"\nlanguage = "de"', "[calibration] language is not known, it belongs in [alarm]"),
        (
            '"probe.toml"',
            '"probe.toml"\n[limits]\noffset_mm = true',
            "line 11: [limits] offset_mm = true: input should be",
        ),
        (
            '"probe.toml"',
            '"probe.toml"\n[limits]\noffset_mm = "4"',
            "line 11: [limits] offset_mm = '4': input should be",
        ),
    ],
)
def test_one_mistake_is_one_complaint(tmp_path: Path, good: str, bad: str, said: str) -> None:
    assert good in GOOD
    with pytest.raises(Mistakes) as caught:
        load_config(written(tmp_path, GOOD.replace(good, bad)))
    (mistake,) = caught.value.rows()
    assert said in f"line {mistake.removeprefix(f'{tmp_path}/probewatch.toml:').replace(': ', ': ', 1)}"


def test_every_mistake_is_told_in_the_order_of_the_file(tmp_path: Path) -> None:
    text = GOOD.replace("sim:", "simm:") + "[limits]\nrotation_deg = 50\nscale_procent = 3\n[log]\nlevel = 'loud'\n"
    with pytest.raises(Mistakes) as caught:
        load_config(written(tmp_path, text))
    assert [line for line, _ in caught.value.each] == [3, 11, 12, 14]
    assert all(row.startswith(f"{tmp_path}/probewatch.toml:") for row in caught.value.rows())


def test_a_threshold_set_by_hand_and_a_feed_at_the_control_socket_are_told_with_their_lines(tmp_path: Path) -> None:
    assert "line 11: [limits] named_nats is not" in refusal(tmp_path, GOOD + "[limits]\nnamed_nats = 30.0\n")
    sockets = '[control]\nsocket = "/run/x/control"\n[feed]\nsocket = "/run/x/control"\n'
    assert "line 13: [feed] socket = '/run/x/control': is the control" in refusal(tmp_path, GOOD + sockets)
    beside = '[control]\nsocket = "/run/x/feed"\n'
    assert "line 11: [control] socket = '/run/x/feed': is the socket of" in refusal(tmp_path, GOOD + beside)


@pytest.mark.parametrize(
    ("good", "bad", "key", "other"),
    [
        ("ttyUSB1", "ttyUSB0", "[output] entry 1 url = 'relay:/dev/ttyUSB0'", "[tracker] url = 'ndi:/dev/ttyUSB0'"),
        ("ttyUSB1", "./ttyUSB0?channel=2", "[output] entry 1 url", "[tracker] url"),
        (
            '"relay:/dev/ttyUSB1"',
            '"relay:/dev/ttyUSB1"\n[[output]]\nsignal = "red"\nurl = "serialpin:/dev/ttyUSB1"',
            "[output] entry 2 url = 'serialpin:/dev/ttyUSB1'",
            "[output] entry 1 url = 'relay:/dev/ttyUSB1'",
        ),
    ],
)
def test_two_devices_at_one_serial_port_are_refused_by_their_keys(
    tmp_path: Path, good: str, bad: str, key: str, other: str
) -> None:
    message = refusal(tmp_path, GOOD.replace(good, bad))
    assert re.search(rf"line \d+: {re.escape(key)}.* is on the serial port of {re.escape(other)}", message), message


def test_channels_of_a_relay_board_and_a_network_tracker_share_no_port(tmp_path: Path) -> None:
    lamp = '[[output]]\nsignal = "red"\nurl = "relay:/dev/ttyUSB1?channel=2"\n[calibration]'
    text = GOOD.replace("[calibration]", lamp).replace("/dev/ttyUSB0", "192.168.1.9:8765")
    assert len(load_config(written(tmp_path, text)).output) == 2


def test_lines_of_keys() -> None:
    text = """a = 1
# comment
[b]
c = [
  1,
]
d.e = \'\'\'
x = 1
\'\'\'

[[f]]
g = { h = 2 }
[f.i]
j = 1
[[f]]
g = 3
"""
    lines = key_lines(text)
    assert {
        place: lines[place] for place in [("a",), ("b",), ("b", "c"), ("b", "d", "e"), ("f", 0), ("f", 0, "g", "h")]
    } == {
        ("a",): 1,
        ("b",): 3,
        ("b", "c"): 4,
        ("b", "d", "e"): 7,
        ("f", 0): 11,
        ("f", 0, "g", "h"): 12,
    }
    assert (lines["f", 0, "i", "j"], lines["f", 1], lines["f", 1, "g"]) == (14, 15, 16)
    assert line_of(("f", 1, "missing"), lines) == 15
    assert line_of(("missing",), lines) is None


def test_a_text_made_to_be_slow_gives_up_its_lines_instead_of_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    parsed: list[int] = []

    def loads(text: str) -> dict[str, object]:
        parsed.append(len(text))
        return tomllib.loads(text)

    monkeypatch.setattr(toml_lines, "tomllib", SimpleNamespace(loads=loads))
    value = "[\n" + "1,\n" * 190 + "]\n"
    text = "".join(f"a{number} = {value}" for number in range(380)) + "b = 1\n"
    lines = key_lines(text)
    assert sum(parsed) < 4.1 * len(text)
    assert lines["a1",] == 193, "what was read before keeps its line"
    assert ("b",) not in lines


@pytest.mark.parametrize("kind", ["output", "tracker", "video"])
def test_the_table_of_kinds_is_what_the_drivers_can(kind: str) -> None:
    for scheme, driver in drivers().items():
        module = importlib.import_module(driver.module)
        assert (kind in device_kinds(f"{scheme}:x")) == hasattr(module, f"open_{kind}")
        assert callable(module.checked)
