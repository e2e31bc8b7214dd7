"""`probewatch log` as a clinical engineer uses it."""

import csv
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from appliance.storage import alarm_chain
from appliance.storage.alarm_chain import Latch, segments
from appliance.storage.alarm_log import AlarmLog
from drivers.errors import ConfigurationError
from tools.commands.log import command

NOON = datetime(2026, 1, 1, 12, tzinfo=UTC)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    log = AlarmLog(tmp_path / "alarms")
    steps = [("warning", "scale", None), ("halt", "scale", Latch("halt", "scale")), ("monitoring", None, None)]
    for number, (state, fault, latch) in enumerate(steps):
        data = {"state": state, "fault": fault, "reason": "as it is"}
        log.append(NOON + timedelta(hours=number), number, "state", data, latch)
    log.append(NOON + timedelta(hours=3), 9, "request", {"do": "acknowledge", "who": "anna, process 7"}, None)
    return tmp_path / "alarms"


def asked(folder: Path, *arguments: str) -> Result:
    return CliRunner().invoke(command, [str(folder), *arguments])


def test_the_whole_log_in_order(folder: Path) -> None:
    result = asked(folder)
    assert result.exit_code == 0
    lines = result.stdout.splitlines()
    assert len(lines) == 5
    assert "halt (scale) · as it is [latched: halt]" in lines[2]
    assert "acknowledge by anna, process 7" in lines[4]
    assert "5 entries, the chain is whole" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "numbers"),
    [
        (["--state", "halt"], [3]),
        (["--fault", "scale"], [2, 3]),
        (["--event", "request"], [5]),
        (["--last", "2"], [4, 5]),
        (["--since", "2026-01-01 13:00:00"], [3, 4, 5]),
        (["--until", "2026-01-01 13:00:00"], [1, 2]),
        (["--fault", "scale", "--last", "1"], [3]),
        (["--state", "nowhere"], []),
        (["--verify"], []),
    ],
)
def test_filters(folder: Path, arguments: list[str], numbers: list[int]) -> None:
    result = asked(folder, *arguments)
    assert [int(line.split()[0]) for line in result.stdout.splitlines()] == numbers


def test_damage_is_said_and_is_exit_65(folder: Path) -> None:
    file = segments(folder)[0]
    file.write_bytes(file.read_bytes().replace(b"anna", b"otto"))
    result = asked(folder, "--verify")
    assert result.exit_code == 65
    assert "line 5: is not an entry (it was changed)" in result.stderr
    assert "NOT whole" in result.stderr


def test_a_chain_that_was_begun_again_is_told(folder: Path) -> None:
    (folder / "alarm-memory.json").unlink()
    AlarmLog(folder).append(NOON, 0, "started", {}, None)
    result = asked(folder, "--verify")
    assert result.exit_code == 0
    assert "entry 6 begins a new chain: alarm-memory.json: is missing" in result.stderr


def test_csv_holds_what_was_chosen(folder: Path, tmp_path: Path) -> None:
    result = asked(folder, "--fault", "scale", "--csv", str(tmp_path / "out.csv"))
    assert "2 entries written" in result.stdout
    with (tmp_path / "out.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["number"], row["state"], row["latched"]) for row in rows] == [
        ("2", "warning", ""),
        ("3", "halt", "halt"),
    ]


def test_a_folder_that_is_not_there_and_a_file_that_cannot_be_written(folder: Path, tmp_path: Path) -> None:
    assert isinstance(asked(tmp_path / "none").exception, ConfigurationError)
    assert isinstance(asked(folder, "--csv", str(tmp_path / "no" / "out.csv")).exception, ConfigurationError)


def test_a_reading_beside_the_service_finds_no_damage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The service writes an entry between the reading of the log and of the memory."""
    log, read_memory = AlarmLog(tmp_path), alarm_chain._read_memory
    log.append(datetime(2026, 1, 1, tzinfo=UTC), 0, "started", {}, None)

    def beside(folder: Path, chain: alarm_chain._Chain) -> alarm_chain.Memory | None:
        monkeypatch.setattr(alarm_chain, "_read_memory", read_memory)
        log.append(datetime(2026, 1, 1, tzinfo=UTC), 0, "state", {}, None)
        return read_memory(folder, chain)

    monkeypatch.setattr(alarm_chain, "_read_memory", beside)
    result = asked(tmp_path, "--verify")
    assert (result.exit_code, result.stderr) == (0, "3 entries, the chain is whole\n")
