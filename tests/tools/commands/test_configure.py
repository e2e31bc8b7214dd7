"""`probewatch configure`: what it writes, what it refuses, and that it writes nothing that was not accepted."""

import re
import stat
from collections import defaultdict
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from probewatch.appliance.configuration.config import CalibrationPlace, load_config
from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.appliance.supervision.annunciator import Role
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.io.inventory import Found
from probewatch.drivers.registry import split_url
from probewatch.tools.commands.configure import (
    _calibration,
    _connected,
    command,
)
from probewatch.tools.shared.configuration_text import template
from probewatch.tools.shared.device_question import DeviceQuestion
from tests.appliance.storage.test_calibration_file import calibration
from tests.appliance.storage.test_device_set import CLIP, device_set
from tests.support.person import Person
from tests.support.stores import configuration, settled, started
from tests.tools.shared.test_device_question import Answers, tool_definition

DEVICES = (
    "--video",
    "v4l2:/dev/video0",
    "--tracker",
    "ndi:/dev/ttyUSB0?baud=921600",
    "--contact",
    "relay:/dev/ttyUSB1",
)
GIVEN = (*DEVICES, "--no-calibration", "--untried", "--yes")


def configured(file: Path, *arguments: str) -> Result:
    return CliRunner().invoke(command, [str(file), *arguments])


@pytest.fixture
def file(tmp_path: Path) -> Path:
    file = tmp_path / "probewatch.toml"
    file.write_text(template())
    return file


def refusal(result: Result) -> str:
    assert isinstance(result.exception, ConfigurationError), result.output
    return str(result.exception)


def test_a_cart_whose_calibration_is_named_no_longer_is_told_that_it_stays_in_force(tmp_path: Path) -> None:
    """It said "no calibration yet? scan it"."""
    settled(started(configuration(tmp_path)))
    file = tmp_path / "cart.toml"
    file.write_text(template().replace('# folder = "/var/lib/probewatch"', 'folder = "state"'))
    assert load_config(file).alarm.folder == tmp_path / "state"
    result = configured(file, *GIVEN)
    assert result.exit_code == 0, result.output
    assert "reference 1 of its history stays in force" in result.stdout
    assert "no calibration yet" not in result.stdout


def test_the_file_of_a_package_becomes_that_of_this_cart(file: Path) -> None:
    result = configured(file, *GIVEN, "--lamp", "red", "relay:/dev/ttyUSB1?channel=2", "--language", "de")
    assert result.exit_code == 0, result.output
    config = load_config(file)
    assert (config.configured, config.alarm.language, config.calibration.file) == (True, "de", None)
    assert (config.video.url, config.tracker.url) == (DEVICES[1], DEVICES[3])
    assert [(one.url, one.signal) for one in config.output] == [
        ("relay:/dev/ttyUSB1", Role.CONTACT),
        ("relay:/dev/ttyUSB1?channel=2", Role.RED),
    ]
    comments = [line for line in template().splitlines() if re.match("# [A-Z]", line)]
    assert [line for line in file.read_text().splitlines() if re.match("# [A-Z]", line)] == comments
    assert "recalibrate --live --solve all" in result.stdout
    assert f"startet von selbst; siehe: probewatch status --config {file}\n" in result.stdout


def test_again_with_the_same_nothing_is_written(file: Path) -> None:
    configured(file, *GIVEN)
    before = file.stat()
    assert "is already up to date" in configured(file, *GIVEN).stdout
    assert file.stat().st_mtime_ns == before.st_mtime_ns


def test_what_is_not_named_stays_and_a_lamp_is_replaced(file: Path) -> None:
    configured(file, *GIVEN, "--lamp", "red", "relay:/dev/ttyUSB1?channel=2")
    result = configured(file, "--lamp", "red", "relay:/dev/ttyUSB1?channel=3", "--language", "de", "--yes")
    assert result.exit_code == 0, result.output
    config = load_config(file)
    assert [one.url for one in config.output] == ["relay:/dev/ttyUSB1", "relay:/dev/ttyUSB1?channel=3"]
    assert (config.video.url, config.calibration.file, config.alarm.language) == (DEVICES[1], None, "de")
    assert f"damit es gilt: Strg-C, wo er läuft, dann probewatch run --config {file}\n" in result.stdout


def test_a_profile_is_written_where_the_template_shows_it_and_what_it_costs_is_told(file: Path) -> None:
    result = configured(file, *GIVEN, "--profile", "fine")
    assert result.exit_code == 0, result.output
    assert load_config(file).limits.profile == "fine"
    assert "offset_mm = 1.5 is never verified over tissue that gives way" in result.stderr
    assert 'profile = "fine"                # coarse, clinical, fine' in file.read_text()
    configured(file, *GIVEN)
    assert load_config(file).limits.profile == "fine", "what is not named stays"
    configured(file, *GIVEN, "--profile", "coarse")
    assert load_config(file).limits.profile == "coarse"


def test_without_a_file_it_begins_with_the_template(tmp_path: Path) -> None:
    file = tmp_path / "new.toml"
    assert configured(file, *GIVEN).exit_code == 0
    assert load_config(file).configured
    assert file.read_text().count("\n") == template().count("\n")


def test_nothing_is_written_before_it_is_accepted(file: Path) -> None:
    result = configured(file, *DEVICES, "--no-calibration", "--untried")
    assert "Give --yes" in refusal(result)
    assert "+configured = true" in result.stdout, "the difference is shown first"
    assert file.read_text() == template()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (GIVEN[2:], "Give --video URL"),
        (GIVEN[:2] + GIVEN[4:], "Give --tracker URL"),
        ((*DEVICES, "--untried", "--yes"), "--calibration FILE, or --no-calibration"),
        ((*GIVEN, "--video", "/dev/video0"), "Did you mean 'v4l2:/dev/video0'"),
        ((*GIVEN, "--contact", "relay:/dev/ttyUSB1?chanel=2"), "unknown option 'chanel'"),
        ((*GIVEN, "--lamp", "purple", "relay:/dev/ttyUSB1?channel=2"), "'purple' is not a lamp"),
        ((*GIVEN, "--lamp", "red", "relay:/dev/ttyUSB1"), "nothing was written"),
        ((*DEVICES, "--calibration", "/nowhere.toml", "--untried", "--yes"), "nothing was written"),
    ],
)
def test_what_cannot_be_is_refused_and_the_file_stays(file: Path, arguments: tuple[str, ...], said: str) -> None:
    assert said in refusal(configured(file, *arguments))
    assert file.read_text() == template()


def test_a_calibration_is_named_whole_and_checked(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_calibration(file.parent / "probe.toml", calibration(), {})
    monkeypatch.chdir(file.parent)
    assert configured(file, *DEVICES, "--calibration", "probe.toml", "--untried", "--yes").exit_code == 0
    assert load_config(file).calibration.file == file.parent / "probe.toml"


def test_a_picture_of_another_name_in_a_device_set_can_be_named(file: Path) -> None:
    device_set_file = file.parent / "set.xml"
    device_set_file.write_bytes(device_set(source=CLIP).replace(b'"Image"', b'"LeftImage"'))
    named = (*DEVICES, "--calibration", str(device_set_file), "--untried", "--yes")
    assert "--calibration-probe" in configured(file, *named).stderr
    result = configured(file, *named, "--calibration-probe", "LeftImageToProbe")
    assert (result.exit_code, load_config(file).calibration.probe) == (0, "LeftImageToProbe")
    assert "crop=100,20,640,480" in result.stderr


@pytest.mark.parametrize("damage", ["[vidio]\n", "= 3\n", "\x00"])
def test_a_damaged_file_is_left_alone_unless_begun_anew(file: Path, damage: str) -> None:
    file.write_text(template() + damage)
    assert "--fresh" in refusal(configured(file, *GIVEN))
    assert file.read_text() == template() + damage
    assert configured(file, *GIVEN, "--fresh").exit_code == 0
    assert load_config(file).configured


def test_what_only_some_may_read_stays_so(file: Path) -> None:
    """A URL may hold a password."""
    file.chmod(0o640)
    assert configured(file, *GIVEN).exit_code == 0
    assert stat.S_IMODE(file.stat().st_mode) == 0o640


def test_a_link_stays_one(file: Path) -> None:
    link = file.with_name("link.toml")
    link.symlink_to(file)
    assert configured(link, *GIVEN).exit_code == 0
    assert link.is_symlink()
    assert load_config(file).configured


@pytest.mark.parametrize("place", ["nowhere/probewatch.toml", "."])
def test_a_place_that_cannot_be_written_is_refused_before_anything_is_asked(tmp_path: Path, place: str) -> None:
    assert "cannot be written" in refusal(configured(tmp_path / place, *GIVEN))


def test_a_device_that_does_not_answer_is_told_and_nothing_is_written(file: Path) -> None:
    arguments = [word for word in GIVEN if word != "--untried"]
    arguments[1] = f"sim:{file.parent}/nobody"
    result = configured(file, *arguments)
    assert getattr(result.exception, "exit_code", 0) == 69
    assert file.read_text() == template()


def test_a_port_that_the_tracker_takes_is_not_offered_for_the_contact() -> None:
    offered = [url for url, _ in _connected("output", "ndi:/dev/ttyS0")]
    assert not any("ttyS0" in url for url in offered)


def test_what_is_connected_is_listed_in_german(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside German questions it said `in use by`, and how to type what must be typed."""
    found = Found("/dev/ttyUSB0", "/dev/ttyUSB0", "USB device", "in use by minicom (42)")
    monkeypatch.setattr("probewatch.tools.commands.configure.CONNECTED", defaultdict(lambda: lambda _: (found,)))
    titles = [title for kind in ("tracker", "output") for _, title in _connected(kind, language="de")]
    assert titles
    assert all("benutzt von minicom (42)" in title for title in titles)
    assert not any("type it with" in title for title in titles)


def test_a_missing_calibration_is_told_at_its_question(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    right = tmp_path / "probe.toml"
    write_calibration(right, calibration(), {})
    (broken := tmp_path / "broken.toml").write_text("scale = 1\n")
    person = Answers(str(tmp_path / "prope.toml"), str(broken), str(right))
    assert _calibration(None, False, None, CalibrationPlace(), (), person) == str(right)
    assert person.asked == ["calibration"] * 3
    told = capsys.readouterr().out
    assert f"{tmp_path}/prope.toml" in told
    assert "No such file or directory" in told
    assert "'scale' is not known" in told
    assert _calibration(None, False, None, CalibrationPlace(), (), Answers("nowhere.toml", "none")) is None


def test_files_that_the_unit_cannot_see_are_asked_for_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As of a home; here of /tmp, which is the unit's own as well."""
    monkeypatch.setattr("probewatch.tools.shared.unit_sight._HIDDEN", (str(tmp_path / "home"),))
    (tmp_path / "home").mkdir()
    seen, hidden = tool_definition(tmp_path / "seen.rom"), tool_definition(tmp_path / "home" / "hidden.rom")
    (link := tmp_path / "link.rom").symlink_to(hidden)
    mine = tmp_path / "home" / "probe.toml"
    write_calibration(mine, calibration(), {})
    tools = str(hidden), str(link), str(seen), "none"
    tracker = DeviceQuestion("tracker", None, "", None)
    for sees_less, taken in ((True, seen), (False, hidden)):
        person = Answers(*tools)
        person.sees_less = sees_less
        assert split_url(tracker.with_files("ndi:/dev/ttyUSB0", person))[2]["probe"] == str(taken)
        if not sees_less:
            break
        assert capsys.readouterr().out.count("the service cannot see it: its unit is shown nothing of") == 2
        person = Answers(str(mine), "none")
        person.sees_less = True
        assert _calibration(None, False, None, CalibrationPlace(), (), person) is None
        assert "Copy it to /etc/probewatch, and name it there" in capsys.readouterr().out


def test_a_missing_calibration_of_an_option_is_told_before_a_device_is_tried(file: Path) -> None:
    result = configured(file, "--video", f"sim:{file.parent}/nobody", "--calibration", "/nowhere.toml")
    assert "--calibration /nowhere.toml" in refusal(result)
    assert "trying" not in result.output


def test_no_half_file_is_left(file: Path) -> None:
    configured(file, *GIVEN)
    assert list(file.parent.iterdir()) == [file]


def test_whoever_stops_is_told_that_nothing_was_written(file: Path) -> None:
    with Person("configure", file) as person:
        person.sees("The scanner's picture")
        person.sees("the scanner's picture")
        person.interrupts()
        assert person.ends() == 130
        assert "stopped: nothing was written" in person.text
    assert file.read_text() == template()


@pytest.mark.parametrize(
    "slip",
    [
        ("--contact", "relay:/dev/ttyUSB1?chanel=1"),
        ("--lamp", "red", "relay:/dev/ttyUSB1?chanel=2"),
        ("--tracker", "ndi:/dev/ttyUSB0?channel=1"),
    ],
)
def test_a_slip_in_an_option_is_told_before_any_device_is_tried(
    file: Path, monkeypatch: pytest.MonkeyPatch, slip: tuple[str, ...]
) -> None:
    """Each is tried for seconds."""
    tried: list[str] = []
    monkeypatch.setattr("probewatch.tools.commands.configure._try", lambda url, *_: tried.append(url))
    refused = refusal(configured(file, *DEVICES, *slip, "--no-calibration", "--yes"))
    assert ("'chan" in refused, tried, file.read_text()) == (True, [], template())
    assert configured(file, *DEVICES, "--no-calibration", "--yes").exit_code == 0
    assert tried == [DEVICES[1], DEVICES[3]]
