"""`probewatch trend` on an alarm log of weeks, as a clinical engineer asks it."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from probewatch.appliance.storage.alarm_chain import segments
from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.commands.trend import command

NOON = datetime(2026, 1, 1, 12, tzinfo=UTC)


def made(folder: Path, references: tuple[tuple[int, float, int], ...]) -> Path:
    """Estimates of two parameters; references: (number, drift of the rotation, deg per day, entries)."""
    random = np.random.default_rng(3)
    log, number = AlarmLog(folder), 0
    log.append(NOON, 0, "started", {}, None)
    for reference, drift, entries in references:
        for index in range(entries):
            bend = drift * index * 300 / 86400 + 0.1 * random.standard_normal()
            scale = 0.3 * random.standard_normal()
            checks = {"rotation-axial": [bend, 0.1, 3.0], "scale-axial": [scale, 0.3, 5.0]}
            at = NOON + timedelta(days=10 * reference, seconds=300 * index)
            log.append(at, number, "estimate", {"reference": reference, "checks": checks}, None)
            number += 1
    return folder


def asked(folder: Path, *arguments: str) -> Result:
    return CliRunner(env={"COLUMNS": "120"}).invoke(command, [str(folder), *arguments])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("alarms"), ((1, 0.0, 200), (2, 0.6, 400)))


def test_a_slow_bend_is_named_with_the_day_on_which_it_meets_its_limit(folder: Path) -> None:
    result = asked(folder)
    assert result.exit_code == 1
    bend, scale = (next(line for line in result.stdout.splitlines() if name in line) for name in ("rot", "scale"))
    assert "moving" in bend
    assert "not before" in bend
    assert "days" in bend
    assert "steady" in scale


def test_a_reference_has_a_trend_of_its_own(folder: Path) -> None:
    steady, latest = (json.loads(asked(folder, *more, "--json").stdout) for more in (("--reference", "1"), ()))
    assert (steady["reference"], latest["reference"]) == (1, 2)
    moving = {one["name"]: one["moving"] for one in latest["parameters"]}
    assert moving == {"rotation-axial": True, "scale-axial": False}
    assert [one["moving"] for one in steady["parameters"]] == [False, False]
    bend = latest["parameters"][0]
    assert bend["per_day"] == pytest.approx(0.6, abs=4 * bend["per_day_sigma"])
    assert 2 < bend["days_left"] < 4.5, "3 deg at .6 a day, a day and a half of it gone"
    assert asked(folder, "--reference", "1").exit_code == 0


def test_the_page_shows_every_parameter_and_loads_nothing(folder: Path, tmp_path: Path) -> None:
    page = tmp_path / "trend.html"
    assert asked(folder, "--html", str(page)).exit_code == 1
    text = page.read_text()
    assert text.count("<svg") == 2
    assert "rotation-axial over days" in text
    assert "default-src 'none'" in text
    refused = asked(folder, "--html", str(tmp_path / "no" / "such" / "trend.html"))
    assert isinstance(refused.exception, ConfigurationError)


def test_too_few_estimates_say_so(tmp_path: Path) -> None:
    empty = asked(made(tmp_path / "empty", ()))
    assert (empty.exit_code, "holds no estimates yet" in empty.stdout) == (3, True)
    few = asked(made(tmp_path / "few", ((1, 0.0, 5),)))
    assert (few.exit_code, "not known yet" in few.stdout) == (3, True)


def test_a_reference_that_never_was_is_not_told_to_wait(folder: Path) -> None:
    result = asked(folder, "--reference", "7")
    assert result.exit_code == 3
    assert "no estimates of reference 7, only of 1, 2: give --reference 2" in result.stdout.replace("\n", " ")


def test_a_damaged_log_tells_what_it_still_holds(tmp_path: Path) -> None:
    folder = made(tmp_path / "alarms", ((1, 0.0, 40),))
    segment = segments(folder)[-1]
    lines = segment.read_bytes().splitlines(keepends=True)
    segment.write_bytes(b"".join([*lines[:-2], b"not JSON\n"]))
    result = asked(folder)
    assert (result.exit_code, "steady" in result.stdout) == (65, True)
    assert result.stderr.startswith("the alarm log is damaged: ")
    assert "is not an entry (it is not JSON, or a part of it is missing)" in result.stderr


@pytest.mark.parametrize("checks", [[], {"rotation-axial": 3}, {"rotation-axial": ["a", 1, 2]}, {"": [1, 2, 3]}, None])
def test_an_entry_that_is_none_is_passed_over(tmp_path: Path, checks: object) -> None:
    folder = made(tmp_path / "alarms", ((1, 0.0, 20),))
    AlarmLog(folder).append(NOON + timedelta(days=30), 99, "estimate", {"reference": 1, "checks": checks}, None)
    assert asked(folder).exit_code == 0


def test_the_trend_of_a_german_cart_is_told_in_german(folder: Path, tmp_path: Path) -> None:
    cart = tmp_path / "cart.toml"
    cart.write_text('[alarm]\nlanguage = "de"\n')
    result = asked(folder, "--config", str(cart))
    heading, *rows = result.stdout.splitlines()
    assert heading.split("\t") == [
        "Größe", "Schätzungen", "jetzt", "Grenze", "seit der ersten", "pro Tag", "erreicht die Grenze", "ist",
    ]  # fmt: skip
    assert [row.split("\t")[0] for row in rows] == ["Drehung axial", "Maßstab axial"]
    assert " Tagen\t" in rows[0]
    assert rows[1].endswith("\tbeständig")
    none = asked(folder, "--config", str(cart), "--reference", "7")
    assert "hat keine Schätzungen zu Referenz 7, nur zu 1, 2: --reference 2 angeben" in none.stdout
