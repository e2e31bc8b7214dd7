"""`probewatch check`: every mistake of a configuration and its calibration, one line each, and nothing is started."""

import os
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.tools.commands.check import command, mistakes_in
from probewatch.tools.shared.named_cart import CONFIG
from tests.appliance.configuration.test_config import GOOD, written
from tests.appliance.storage.test_calibration_file import calibration
from tests.appliance.storage.test_device_set import device_set
from tests.support.answers import answered
from tests.support.stores import configuration, settled, started


def check(file: Path) -> Result:
    return CliRunner().invoke(command, [str(file)])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_calibration(tmp_path / "probe.toml", calibration(), {})
    return tmp_path


def test_a_good_configuration_and_calibration(folder: Path) -> None:
    result = check(written(folder, GOOD))
    assert (result.exit_code, result.stderr) == (0, "")
    assert "can be used" in result.stdout


def test_of_a_template_that_nobody_has_configured_it_names_the_command_that_does(folder: Path) -> None:
    file = written(folder, "configured = false\n" + GOOD.replace("probe.toml", "absent.toml"))
    result = check(file)
    assert result.exit_code == 78
    assert result.stderr.splitlines()[-1] == f"{file} is not configured yet: probewatch configure {file}"


def test_of_a_german_cart_it_tells_in_german_what_is_in_force(folder: Path) -> None:
    """It was English beside a German status."""
    german = '[alarm]\nlanguage = "de"\n[limits]\nprofile = "clinical"\noffset_mm = 3.5\nlatency_ms = 30.0\n'
    result = check(file := written(folder, GOOD + german))
    first, *rows = [" ".join(row.split()) for row in result.stdout.splitlines()]
    assert (result.exit_code, first) == (0, f"{file} und {folder}/probe.toml sind brauchbar")
    assert rows[1] == "rotation_deg 1.5 Profil clinical"
    assert rows[3:5] == [
        "offset_mm 3.5 in der Datei angegeben; Profil clinical hat 2.5",
        "latency_ms 30 in der Datei angegeben, wie Profil clinical sie hat",
    ]
    assert result.stderr == "[limits] offset_mm ist weiter als in Profil clinical: OK sagt weniger als dieser Name\n"


@pytest.mark.parametrize("language", ["en", "de"])
def test_two_devices_at_one_serial_port_of_two_names_are_refused(folder: Path, language: str) -> None:
    (folder / "by-id").symlink_to("/dev/ttyUSB0")
    text = GOOD.replace("/dev/ttyUSB1", str(folder / "by-id")) + f'[alarm]\nlanguage = "{language}"\n'
    result = check(file := written(folder, text))
    assert result.exit_code == 78
    keys = f"[output] entry 1 url = 'relay:{folder}/by-id'", "[tracker] url = 'ndi:/dev/ttyUSB0'"
    assert result.stderr.startswith(f"{file}:7: {keys[0]}")
    assert keys[1] in result.stderr
    assert ("serial port" in result.stderr) is (language == "en")


def test_of_a_cart_that_names_no_calibration_it_tells_which_reference_stays_in_force(tmp_path: Path) -> None:
    config = configuration(tmp_path)
    file = tmp_path / "probewatch.toml"
    file.write_text(file.read_text().replace('calibration.file = "probe.toml"\n', ""))
    kept = "reference 1 of its history stays in force; another: probewatch calibration use FILE"
    assert kept not in check(file).stdout, "it has no history yet"
    settled(started(config))
    assert kept in check(file).stdout


def test_it_tells_which_limits_are_in_force_and_why(folder: Path) -> None:
    result = check(written(folder, GOOD + '[limits]\nprofile = "clinical"\noffset_mm = 3.5\nlatency_ms = 30.0\n'))
    assert result.exit_code == 0
    rows = [" ".join(row.split()) for row in result.stdout.splitlines()[1:]]
    assert rows == [
        "limits: clinical, but for offset_mm 3.5",
        "rotation_deg 1.5 profile clinical",
        "scale_percent 3 profile clinical",
        "offset_mm 3.5 given in the file; profile clinical has 2.5",
        "latency_ms 30 given in the file, as profile clinical has it",
        "point_mm 4 profile clinical",
    ]
    assert result.stderr == "[limits] offset_mm is looser than profile clinical has it: OK says less than that name\n"


@pytest.mark.parametrize(
    ("section", "told"),
    [
        (
            'profile = "fine"\n',
            ["offset_mm = 1.5 is never verified over tissue that gives way, as a patient's: what motion cannot tell"],
        ),
        (
            "offset_mm = 0.6\n",
            ["offset_mm = 0.6 is never verified, so the contact stays open: what motion"],
        ),
        ('profile = "fine"\noffset_mm = 10.0\n', ["offset_mm is looser than profile fine"]),
        ('profile = "clinical"\nconfidence_sigma = 2.0\n', ["confidence_sigma is looser than profile clinical"]),
        ('profile = "clinical"\npoint_mm = 4.5\n', ["point_mm is looser than profile clinical"]),
        ('profile = "clinical"\n[limits.region]\nbottom = 0.2\n', ["region is looser than profile clinical"]),
        ('profile = "clinical"\n[limits.required_age_s]\nlatency = 90\n', ["required_age_s is looser"]),
        ('profile = "clinical"\noffset_mm = 2.0\nat_rest_s = 0\n[limits.required_age_s]\nlatency = 20\n', []),
        ("point_mm = 5.0\n", []),
    ],
)
def test_it_remarks_on_what_never_closes_and_on_what_is_looser_than_its_name(
    folder: Path, section: str, told: list[str]
) -> None:
    result = check(written(folder, f"{GOOD}[limits]\n{section}"))
    assert result.exit_code == 0
    remarks = result.stderr.splitlines()
    assert len(remarks) == len(told)
    assert all(f"[limits] {what}" in remark for what, remark in zip(told, remarks, strict=True))


@pytest.mark.parametrize(("more_mm", "remarks"), [(-0.5, 0), (0.5, 1)])
def test_it_remarks_on_a_depth_below_the_picture(folder: Path, more_mm: float, remarks: int) -> None:
    height_mm = calibration().image_size_px[1] * calibration().scale_mm_per_px[1]
    result = check(written(folder, f"{GOOD}[limits]\npoint_depth_mm = {height_mm + more_mm:.1f}\n"))
    assert (result.exit_code, result.stderr.count("\n")) == (0, remarks)
    assert ("lies below the picture, which is" in result.stderr) == bool(remarks)


@pytest.mark.parametrize(
    ("section", "key"),
    [
        ("[supervisor]\nmax_verification_age_s = 10", "[supervisor] max_verification_age_s = 10"),
        ("[limits.required_age_s]\noffset-axial = 5", "[limits.required_age_s] offset-axial = 5"),
    ],
)
def test_it_remarks_on_an_age_that_quiet_scanning_cannot_keep(folder: Path, section: str, key: str) -> None:
    result = check(written(folder, f"{GOOD}{section}\n"))
    assert result.exit_code == 0
    said = f"{key}: what quiet scanning shows is up to 20 s old, so the contact opens again and again. Give 20 or more"
    assert said in result.stderr.splitlines()


def test_one_that_waits_for_a_person_says_so(folder: Path) -> None:
    assert "configured = true" in check(written(folder, "configured = false\n" + GOOD)).stdout


def test_every_mistake_is_one_line_and_exit_78(folder: Path) -> None:
    file = written(folder, GOOD.replace("sim:", "simm:") + "[limits]\nrotation_deg = 50\nscale_procent = 3\n")
    result = check(file)
    assert result.exit_code == 78
    rows = result.stderr.splitlines()
    assert [row.split(": ")[0] for row in rows] == [f"{file}:{line}" for line in (3, 11, 12)]
    assert "[limits] rotation_deg = 50: input should be less than or equal to 30" in rows[1]
    assert "Did you mean 'scale_percent'?" in rows[2]


@pytest.mark.parametrize(
    ("good", "bad", "part"),
    [
        ("relay:/dev/ttyUSB1", "relay:/dev/ttyUSB1?chanel=2", "[output] entry 1 url = 'relay:/dev/ttyUSB1?chanel=2'"),
        ("relay:/dev/ttyUSB1", "gpio:/dev/gpiochip0", "names no line"),
        ("ndi:/dev/ttyUSB0", "ndi:/dev/ttyUSB0?baud=3", "baud=3 is not a line speed"),
        ("ndi:/dev/ttyUSB0", "ndi+tcp://host:8765?bauds=1", "unknown option 'bauds'"),
        ("ndi:/dev/ttyUSB0", "optotrak://host?rate=0", "rate=0 cannot be used"),
        ("sim:/tmp/x/scanner", "v4l2:video0", "is not the path of a device"),
        ("sim:/tmp/x/scanner", "opencv:0?delay_ms=x", "delay_ms=x is not a time"),
    ],
)
def test_options_of_a_url_are_checked_without_the_device(folder: Path, good: str, bad: str, part: str) -> None:
    result = check(written(folder, GOOD.replace(good, bad)))
    assert result.exit_code == 78
    (row,) = result.stderr.splitlines()
    assert part in row


def test_every_mistake_of_the_calibration_is_told(folder: Path) -> None:
    probe = folder / "probe.toml"
    text = (
        probe.read_text().replace("version = 1", "version = 7").replace("scale_mm_per_px = [", "scale_mm_per_px = [-")
    )
    probe.write_text(text)
    result = check(written(folder, GOOD))
    assert result.exit_code == 78
    first, second = result.stderr.splitlines()
    numbers = [number for number, line in enumerate(text.splitlines(), 1) if line.startswith(("version", "scale_mm"))]
    assert first.startswith(f"{probe}:{numbers[0]}: 'version' = 7: input should be 1")
    assert second.startswith(f"{probe}:{numbers[1]}: 'scale_mm_per_px' entry 1 = -")


def test_what_a_device_set_says_of_its_devices_is_told_and_is_no_mistake(folder: Path) -> None:
    (folder / "set.xml").write_bytes(device_set('LocalTimeOffsetSec="-0.05"'))
    done = check(written(folder, GOOD.replace("probe.toml", "set.xml")))
    assert (done.exit_code, "can be used" in done.stdout) == (0, True)
    assert "LocalTimeOffsetSec = -0.05 s" in done.stderr


def test_a_calibration_that_is_not_there(tmp_path: Path) -> None:
    result = check(written(tmp_path, GOOD))
    assert result.exit_code == 78
    assert "probe.toml: cannot be read: No such file" in result.stderr


def test_the_shipped_templates_have_no_mistake() -> None:
    result = check(Path(__file__).parents[3] / "config" / "probewatch.toml")
    assert (result.exit_code, result.stderr) == (0, "")


def test_a_simulated_calibration_is_a_mistake_on_a_cart_with_real_devices(folder: Path) -> None:
    """The service did not start with what was told to be good."""
    write_calibration(folder / "simulated.toml", replace(calibration(), simulated=True), {})
    named = GOOD.replace("probe.toml", "simulated.toml")
    assert check(written(folder, named)).exit_code == 0
    result = check(written(folder, named.replace("sim:/tmp/x/scanner", "v4l2:/dev/video0")))
    assert result.exit_code == 78
    assert "simulated.toml: was made of a simulated scan and cannot be the reference" in result.stderr


def test_a_group_that_is_not_there_is_a_mistake(folder: Path) -> None:
    result = check(file := written(folder, GOOD + '[control]\ngroup = "nosuchgroup"\n'))
    assert result.exit_code == 78
    said = "[control] group = 'nosuchgroup': there is no such group. Make it: groupadd --system nosuchgroup"
    assert result.stderr == f"{file}: {said}\n"


@pytest.mark.parametrize(
    ("good", "bad", "hidden"),
    [
        ('file = "probe.toml"', 'file = "/home/anna/probe.toml"', "/home"),
        ("probe=@1", "probe=/root/probe.rom@1", "/root"),
    ],
)
def test_what_the_unit_cannot_see_is_a_mistake_of_its_configuration_alone(good: str, bad: str, hidden: str) -> None:
    text = GOOD.replace("ndi:/dev/ttyUSB0", "ndi:/dev/ttyUSB0?probe=@1").replace(
        "sim:/tmp/x/scanner", "v4l2:/dev/video0"
    )
    assert good in text
    said = [line for line in mistakes_in(text.replace(good, bad), CONFIG) if "cannot see it" in line]
    assert len(said) == 1, text
    assert f"its unit is shown nothing of {hidden}. Copy it to /etc/probewatch" in said[0]
    assert not [line for line in mistakes_in(text.replace(good, bad), Path("/srv/cart.toml")) if "cannot see" in line]
    assert not [line for line in mistakes_in(text, CONFIG) if "cannot see" in line]


def test_of_a_configuration_that_is_not_there_it_says_how_to_write_one(tmp_path: Path) -> None:
    for words in (("check", tmp_path / "cart.tmol"), ("record", "status", "--config", tmp_path / "cart.tmol")):
        answer = answered(*words)
        assert (answer.returncode, f"probewatch configure {tmp_path}/cart.tmol" in answer.stderr) == (78, True), answer


def test_a_folder_is_told_to_name_the_file_in_it(tmp_path: Path) -> None:
    """Its permissions were to be checked."""
    assert "it is a folder, not a file). Name the file in it" in str(check(tmp_path).exception)


def test_of_a_device_or_a_pipe_it_says_that_it_is_no_configuration(tmp_path: Path) -> None:
    """The permissions were to be checked."""
    os.mkfifo(tmp_path / "cart.toml")
    for file in (Path("/dev/zero"), tmp_path / "cart.toml"):
        said = str(check(file).exception)
        assert "not a file). Name the cart's configuration, a TOML file" in said, said


@pytest.mark.parametrize(("overdue", "said"), [("advise", ""), ("expires", "; the contact stays open")])
def test_it_tells_which_date_of_the_calibration_has_passed(folder: Path, overdue: str, said: str) -> None:
    """A date that had passed was found by the running service alone."""
    (folder / "probe.toml").unlink()
    write_calibration(folder / "probe.toml", calibration(), {"due": "2020-01-01"})
    result = check(written(folder, GOOD.replace("[calibration]", f'[calibration]\noverdue = "{overdue}"')))
    assert result.exit_code == 0
    assert result.stderr == f"{folder}/probe.toml: it is due since 2020-01-02 00:00 UTC{said}\n"


@pytest.mark.parametrize(("keys", "said"), [("", True), ("due_days = 30\n", False)])
def test_it_remarks_on_a_calibration_that_is_to_expire_and_has_no_date(folder: Path, keys: str, said: bool) -> None:
    """The contact would stay closed for good, and nothing said so."""
    expires = f'[calibration]\n{keys}overdue = "expires"'
    result = check(written(folder, GOOD.replace("[calibration]", expires)))
    assert result.exit_code == 0
    assert ("it has no date, so [calibration] overdue" in result.stderr) is said
    assert ("Give due_days there too" in result.stderr) is said
