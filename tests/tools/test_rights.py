"""Files and folders without rights: every command says which one it is, why, and what to do."""

import shutil
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.appliance.storage.reference_store import FOLDER, HISTORY
from probewatch.appliance.types import Calibration
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.atomic_file import check_writable
from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from probewatch.tools import cli
from tests.appliance.configuration.test_config import GOOD
from tests.support.nobody import open_folder, told, without_rights
from tests.support.recordings import items

SIZE_PX = (48, 32)
NOW = datetime(2026, 1, 2, tzinfo=UTC)


@pytest.fixture(scope="module")
def place() -> Iterator[Path]:
    """A cart's files, and a folder `closed` into which nobody else may write."""
    with open_folder() as folder:
        log = AlarmLog(folder / "log")
        log.append(NOW, 1, "started", {"software": "probewatch 1"}, None)
        (folder / "cart.toml").write_text(GOOD + f'[alarm]\nfolder = "{folder}/log"\n')
        write_metaimage(folder / "scan.igs.mha", items(8, SIZE_PX), SIZE_PX)
        reference = Calibration(np.eye(3), (1, 1), np.array([0.2, 0.2]), np.zeros(3), SIZE_PX)
        write_calibration(folder / "probe.toml", reference, {})
        for file in folder.rglob("*"):
            file.chmod(0o755 if file.is_dir() else 0o644)
        (folder / "closed").mkdir(0o555)
        for secret in ("scan.igs.mha", "probe.toml", "cart.toml"):
            shutil.copy(folder / secret, folder / f"secret-{secret}")
            (folder / f"secret-{secret}").chmod(0)
        (folder / "locked").mkdir()
        shutil.copy(folder / "scan.igs.mha", folder / "locked")
        (folder / "locked").chmod(0)
        yield folder
        (folder / "locked").chmod(0o700)


WRITES = {
    "report": ["report", "--config", "cart.toml", "--folder", "closed"],
    "log": ["log", "log", "--csv", "closed/log.csv"],
    "trend": ["trend", "log", "--html", "closed/trend.html"],
    "replay --html": ["replay", "scan.igs.mha", "--calibration", "probe.toml", "--html", "closed/a.html"],
    "replay --estimate": ["replay", "scan.igs.mha", "--calibration", "probe.toml", "--estimate", "closed/a.toml"],
    "noise": ["noise", "scan.igs.mha", "--calibration", "probe.toml", "--output", "closed/noise.toml"],
    "study": ["study", "scan.igs.mha", "--calibration", "probe.toml", "--jobs", "1", "--output", "closed"],
    "study, new": ["study", "scan.igs.mha", "--calibration", "probe.toml", "--jobs", "1", "--output", "closed/new"],
    "import": ["calibration", "import", "probe.toml", "--output", "closed/new.toml"],
    "export": ["calibration", "export", "probe.toml", "--output", "closed/new.xml"],
    "configure": ["configure", "closed/cart.toml", "--yes"],
    "simulate": ["simulate", "cart", "--write", "closed/cart.toml"],
    "recalibrate": ["recalibrate", "--simulated", "--duration", "1", "--output", "closed/new.toml"],
}
READS = {
    "replay": ["replay", "secret-scan.igs.mha", "--calibration", "probe.toml"],
    "replay --calibration": ["replay", "scan.igs.mha", "--calibration", "secret-probe.toml"],
    "replay --config": ["replay", "scan.igs.mha", "--calibration", "probe.toml", "--config", "secret-cart.toml"],
    "replay, folder": ["replay", "locked", "--calibration", "probe.toml"],
    "replay, in it": ["replay", "locked/scan.igs.mha", "--calibration", "probe.toml"],
    "latency": ["latency", "secret-scan.igs.mha", "--calibration", "probe.toml"],
    "latency, in it": ["latency", "locked/scan.igs.mha", "--calibration", "probe.toml"],
    "noise": ["noise", "secret-scan.igs.mha", "--calibration", "probe.toml", "--output", "open/noise.toml"],
    "study": ["study", "locked", "--calibration", "probe.toml", "--jobs", "1", "--output", "open"],
    "study, in it": ["study", "locked/a.mha", "--calibration", "probe.toml", "--jobs", "1", "--output", "open"],
    "export": ["export", "secret-scan.igs.mha", "--to", "csv", "--output", "open/a.csv"],
    "export, in it": ["export", "locked/a.mcap", "--to", "csv", "--output", "open/a.csv"],
    "import": ["calibration", "import", "secret-probe.toml", "--output", "open/a.toml"],
    "diff": ["calibration", "diff", "probe.toml", "secret-probe.toml"],
    "check": ["check", "secret-cart.toml"],
    "report": ["report", "--config", "secret-cart.toml"],
    "record": ["record", "--config", "secret-cart.toml"],
    "recalibrate": ["recalibrate", "--recording", "secret-scan.igs.mha", "--calibration", "probe.toml"],
    "run": ["run", "--config", "secret-cart.toml"],
}


def in_place(place: Path, words: list[str]) -> list[str]:
    names = ("closed", "locked", "open", "log", "scan.", "secret-", "probe.toml", "cart.toml")
    return [
        f"{place}/{word}" if word.startswith(names) and (n or word != "log") else word for n, word in enumerate(words)
    ]


@pytest.mark.parametrize("words", WRITES.values(), ids=WRITES)
def test_a_folder_that_may_not_be_written_to_is_told_before_the_work(place: Path, words: list[str]) -> None:
    said = told(*in_place(place, words))
    assert said.startswith("1 ConfigurationError: "), said
    assert f"{place}/closed" in said
    assert "may not write there, in" in said or "Permission denied" in said
    assert "Name a" in said or "Give another" in said or "Put sudo" in said


@pytest.mark.parametrize("words", READS.values(), ids=READS)
def test_a_file_that_may_not_be_read_is_told_with_what_to_do(place: Path, words: list[str]) -> None:
    (place / "open").mkdir(0o777, exist_ok=True)
    (place / "open").chmod(0o777)
    said = told(*in_place(place, words))
    assert said.split()[1] in ("ConfigurationError:", "RecordingError:"), said
    assert "Permission denied" in said
    assert f"{place}/locked" in said or f"{place}/secret-" in said
    assert ". " in said.partition("Permission denied")[2], "what to do"
    assert not list((place / "open").iterdir())


@pytest.mark.parametrize("command", ["log", "trend", "report"])
def test_a_log_or_a_store_that_may_not_be_read_is_not_called_damaged(place: Path, command: str) -> None:
    """The report to be filed said DAMAGED at its top, because of the rights of who made it."""
    with open_folder() as folder:
        shutil.copytree(place / "log", folder / "log")
        config = folder / "cart.toml"
        config.write_text(GOOD + f'[alarm]\nfolder = "{folder}/log"\n')
        config.chmod(0o644)
        for unread in [
            next((folder / "log").glob("*.jsonl")),
            *([folder / "log" / FOLDER / HISTORY] * (command == "report")),
        ]:
            unread.parent.mkdir(0o755, exist_ok=True)
            unread.touch()
            unread.chmod(0)
            said = told(command, "--config", config, *(["--folder", folder] if command == "report" else []))
            assert said.startswith("1 ConfigurationError: "), said
            assert f"{unread}: cannot be read (Permission denied). An administrator adds you" in said
            assert not list(folder.glob("*.html"))
            unread.chmod(0o644)


def test_a_file_of_another_user_in_a_folder_for_all_is_told_before_the_work() -> None:
    """In /tmp it was told after the whole recording had been played."""
    with open_folder() as folder:
        folder.chmod(0o1777)
        page = folder / "a.html"
        page.write_text("<!doctype html>")
        if page.owner() != "root":
            pytest.skip("whoever is not root can make no file of another user")
        said = without_rights(lambda: _looked_at(page), another_user=True)
    assert said.startswith(f"{page}: cannot be written: it is another user's, in a folder in which only that one may")


def _looked_at(page: Path) -> str:
    try:
        check_writable(page)
    except ConfigurationError as error:
        return str(error)
    return "may be written"


def test_a_refusal_of_the_system_that_no_command_expects_is_a_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for path, what in (("a" * 300, "File name too long"), ("/dev/null/x", "Not a directory")):

        def refused(*_: object, path: str = path, **__: object) -> None:
            Path(path).open().close()

        monkeypatch.setattr(cli.probewatch, "main", refused)
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert ended.value.code == 78
        assert f"{path}: {what}. Check the path" in capsys.readouterr().err


def test_who_has_no_rights_here_has_none() -> None:
    with open_folder() as folder:
        (folder / "a").write_text("x")
        (folder / "a").chmod(0)
        assert "PermissionError" in without_rights(lambda: _tried(folder / "a"))


def _tried(file: Path) -> str:
    try:
        return file.read_text()
    except OSError as error:
        return type(error).__name__
