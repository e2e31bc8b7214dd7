"""The file that healthy scanning wrote, and how a configuration names it."""

from pathlib import Path

import pytest

from probewatch.appliance.configuration.config import load_config
from probewatch.appliance.configuration.noise_file import LearnedFrom, LearnedNoise, judged_by, read_noise, write_noise
from probewatch.appliance.limits import MOST_NAMED_NATS, NAMED_NATS, Limits
from probewatch.appliance.service.control.status import noise_fields
from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.commands.check import mistakes_in
from tests.appliance.configuration.test_config import GOOD, refusal, written

NAMED = GOOD + '[noise]\nfile = "noise.toml"\n'
LINE = NAMED.splitlines().index('file = "noise.toml"') + 1


def learned(**changed: object) -> LearnedNoise:
    plain = {
        "format": "probewatch-noise", "version": 1, "named_nats": 23.5, "hours": 2.5, "from_nats": 6.0,
        "exceedances": 7, "tail_nats": 1.9, "per_hour": 5.2, "software": "probewatch 0.1.0",
        "learned_utc": "2026-11-24T21:00:00+00:00", "simulated": False, "limits": judged_by(Limits()),
        "recording": (LearnedFrom(file='a "b".mcap', sha256="0" * 64),),
    }  # fmt: skip
    return LearnedNoise.model_validate(plain | changed)


def test_what_is_written_is_what_is_read(tmp_path: Path) -> None:
    write_noise(tmp_path / "noise.toml", learned())
    again = read_noise(tmp_path / "noise.toml")
    assert again.model_dump() == learned().model_dump()
    assert len(again.sha256) == 64


def test_the_shipped_threshold_survives_the_file(tmp_path: Path) -> None:
    write_noise(tmp_path / "noise.toml", learned(named_nats=NAMED_NATS))
    assert load_config(written(tmp_path, NAMED)).limits.named_nats == NAMED_NATS


def test_a_configuration_that_names_it_has_its_threshold_and_tells_its_origin(tmp_path: Path) -> None:
    write_noise(tmp_path / "noise.toml", learned())
    config = load_config(written(tmp_path, NAMED))
    assert config.limits == Limits(named_nats=23.5)
    told = noise_fields(config)
    assert told is not None
    assert (told["file"], told["named_nats"], told["hours"]) == (str(tmp_path / "noise.toml"), 23.5, 2.5)
    assert (told["recordings"], told["learned_utc"]) == (1, "2026-11-24T21:00:00+00:00")
    assert noise_fields(load_config(written(tmp_path, GOOD))) is None


@pytest.mark.parametrize("limits", ['"a\\nb\\u001b[31m" = 1.0', "rotation_deg = 3.0", ""])
def test_limits_that_no_cart_has_are_refused_in_printable_words(tmp_path: Path, limits: str) -> None:
    text = learned().toml()
    begin, end = text.index("[limits]\n") + len("[limits]\n"), text.index("\n[[recording]]")
    (tmp_path / "noise.toml").write_text(f"{text[:begin]}{limits}\n{text[end:]}")
    with pytest.raises(ConfigurationError, match="must be rotation_deg, scale_percent") as refused:
        read_noise(tmp_path / "noise.toml")
    assert str(refused.value).isprintable()


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (None, "cannot be read (No such file or directory)"),
        ("", "is not what probewatch noise writes"),
        ('format = "probewatch-calibration"\n', "is not what probewatch noise writes"),
        ("named_nats = \n", "is not valid TOML"),
        ("\xff\xfe", "is UTF-16 text, not UTF-8"),
    ],
)
def test_a_file_of_another_kind_is_named_by_line(tmp_path: Path, content: str | None, what: str) -> None:
    if content is not None:
        (tmp_path / "noise.toml").write_bytes(content.encode("latin-1"))
    file = written(tmp_path, NAMED)
    (row,) = mistakes_in(NAMED, file)
    assert row.startswith(f"{file}:{LINE}: [noise] file = '{tmp_path / 'noise.toml'}': {what}")
    with pytest.raises(ConfigurationError):
        load_config(file)


@pytest.mark.parametrize(
    ("key", "value"), [("named_nats", "10.0"), ("named_nats", f"{MOST_NAMED_NATS + 1}"), ("hours", "0.0")]
)
def test_a_value_out_of_its_bounds_is_named_by_its_own_line(tmp_path: Path, key: str, value: str) -> None:
    lines = learned().toml().splitlines()
    number = next(index for index, line in enumerate(lines) if line.startswith(f"{key} = "))
    lines[number] = f"{key} = {value}"
    (tmp_path / "noise.toml").write_text("\n".join(lines))
    (row,) = mistakes_in(NAMED, written(tmp_path, NAMED))
    assert row.startswith(f"{tmp_path / 'noise.toml'}:{number + 1}: '{key}' = {float(value)}")


def test_a_threshold_belongs_to_the_limits_that_it_was_learned_under(tmp_path: Path) -> None:
    write_noise(tmp_path / "noise.toml", learned())
    assert "was learned under other [limits], rotation_deg = 3" in refusal(
        tmp_path, NAMED + "[limits]\nrotation_deg = 2.0\n"
    )


def test_what_simulated_devices_taught_is_for_no_real_cart(tmp_path: Path) -> None:
    write_noise(tmp_path / "noise.toml", learned(simulated=True))
    assert load_config(written(tmp_path, NAMED)).limits.named_nats == 23.5, "its scanner is simulated"
    real = NAMED.replace("sim:/tmp/x/scanner", "v4l2:/dev/video0")
    assert "was learned from simulated devices" in refusal(tmp_path, real)


def test_the_threshold_is_not_set_by_hand(tmp_path: Path) -> None:
    assert "named_nats is not set by hand" in refusal(tmp_path, GOOD + "[limits]\nnamed_nats = 25.0\n")
