"""No command writes over a file of another kind: every option that names a file is known here as read or written."""

import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.cli import probewatch
from tests.appliance.configuration.test_config import GOOD

WRITTEN = {
    ("calibration export", "--output"): ["1", "--output", "FILE.xml"],
    ("calibration import", "--output"): ["probe.xml", "--output", "FILE"],
    ("calibration measured", "--output"): ["--folder", "FOLDER", "--output", "FILE"],
    ("calibration recover", "--output"): ["--output", "FILE"],
    ("export", "--output"): ["FOLDER/box.mcap", "--to", "csv", "--output", "FILE.csv"],
    ("log", "--csv"): ["FOLDER", "--csv", "FILE"],
    ("metrics", "--textfile"): ["--no-http", "--textfile", "FILE"],
    ("noise", "--output"): ["FOLDER/scan.igs.mha", "--output", "FILE"],
    ("recalibrate", "--output"): ["--simulated", "--duration", "1", "--force", "--output", "FILE"],
    ("replay", "--estimate"): ["FOLDER/scan.igs.mha", "--calibration", "probe.toml", "--estimate", "FILE"],
    ("replay", "--html"): ["FOLDER/scan.igs.mha", "--html", "FILE"],
    ("replay", "--pdf"): ["FOLDER/scan.igs.mha", "--html", "page.html", "--pdf", "FILE"],
    ("simulate cart", "--write"): ["--write", "FILE"],
    ("trend", "--html"): ["FOLDER", "--html", "FILE"],
}
"""(command, option) → arguments that reach it; FILE is there already."""
NAMED_BY_ITSELF = {
    ("page", "--folder"): "new names, with date and time",
    ("recalibrate", "--folder"): "new names, with date and time",
    ("report", "--folder"): "by cart and period: tests/tools/report",
    ("self-test", "--folder"): "new names, with date and time",
    ("simulate cart", "--folder"): "sockets and files of its own",
    ("study", "--output"): "a folder: its table and page are looked at",
    ("study", "--motions"): "a folder of its own",
}
ASKS = {("configure", "file"): "shows what changes in a configuration, and asks; anything else it cannot read"}
MADE_BY_ITSELF = "--pty"
"""A link to a terminal, refused where something is there: drivers' own tests."""
READ = {
    *("--calibration", "--check", "--config", "--control", "--door", "--estimate", "--feed", "--folder", "--key"),
    *("--ca", "--certificate", "--password-file", "--poses", "--recording", "--reference-rom", "--rom", "--root"),
    *("--sign", "--socket", "--tank", "--witness-rom", "file", "folder", "log", "recording", "recordings"),
}
CONTENTS = {
    "a recording": b"ObjectType = Image\nNDims = 3\n",
    "a black box": b"\x89MCAP0\r\n",
    "a calibration": b'format = "probewatch-calibration"\n',
    "a configuration": GOOD.encode(),
    "a device set": b'<?xml version="1.0"?>\n<PlusConfiguration/>\n',
}


def commands(group: click.Group, name: str = "") -> Iterator[tuple[str, click.Command]]:
    context = click.Context(group)
    for word in group.list_commands(context):
        command = group.get_command(context, word)
        assert command is not None
        if isinstance(command, click.Group):
            yield from commands(command, f"{name}{word} ")
        else:
            yield f"{name}{word}", command


def named_files() -> list[tuple[str, str]]:
    """(command, option) of everything that names a file or a folder."""
    assert isinstance(probewatch, click.Group)
    return [
        (name, parameter.opts[0])
        for name, command in commands(probewatch)
        for parameter in command.params
        if isinstance(parameter.type, click.Path | click.File)
    ]


def test_each_option_that_names_a_file_is_known_as_read_or_written() -> None:
    """A new one must be told here what it is."""
    named = named_files()
    assert set(WRITTEN) | set(NAMED_BY_ITSELF) | set(ASKS) <= set(named)
    written = {*WRITTEN, *NAMED_BY_ITSELF, *ASKS}
    assert not [one for one in named if one not in written and one[1] not in READ | {MADE_BY_ITSELF}]


@pytest.mark.parametrize("what", CONTENTS)
@pytest.mark.parametrize("where", WRITTEN, ids=" ".join)
def test_no_command_writes_over_a_file_of_another_kind(
    where: tuple[str, str], what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("probewatch.tools.report.pdf._browser", lambda: "chromium")
    monkeypatch.chdir(tmp_path)
    words = [word.replace("FILE", str(tmp_path / "there")).replace("FOLDER", str(tmp_path)) for word in WRITTEN[where]]
    there = next(Path(word) for word in words if Path(word).stem == "there")
    there.write_bytes(CONTENTS[what])
    for name in ("scan.igs.mha", "box.mcap"):
        (tmp_path / name).write_bytes(b"")
    result = CliRunner().invoke(import_module("probewatch.tools.cli").probewatch, [*where[0].split(), *words])
    assert there.read_bytes() == CONTENTS[what]
    assert isinstance(result.exception, ConfigurationError), (result.exception, result.output)
    assert result.exception.where == str(there)
    assert "exists already" in result.exception.what


ENDINGS = (".html", ".pdf", ".csv", ".json", ".toml", ".mcap", ".mha", ".png")
OWN = {".html": "--html", ".pdf": "--pdf", ".csv": "--csv"}
"""Ending → the option that writes such a file."""
NAMED = {**WRITTEN, ("study", "--output"): ["--output", "FILE"], ("configure", "file"): ["FILE", "--yes"]}
TOML = {
    *(("calibration import", "--output"), ("calibration measured", "--output"), ("calibration recover", "--output")),
    ("configure", "file"),
    *(("noise", "--output"), ("recalibrate", "--output"), ("replay", "--estimate"), ("simulate cart", "--write")),
}


@pytest.mark.parametrize("where", NAMED, ids=" ".join)
def test_no_command_writes_under_a_name_of_another_kind(
    where: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("probewatch.tools.report.pdf._browser", lambda: "chromium")
    monkeypatch.chdir(tmp_path)
    for name in ("scan.igs.mha", "box.mcap"):
        (tmp_path / name).write_bytes(b"")
    before = sorted(tmp_path.iterdir())
    own = ".toml" if where in TOML else next((one for one, option in OWN.items() if where[1] == option), None)
    for ending in ENDINGS:
        if ending == own or (where[0] == "export" and ending == ".csv"):
            continue
        words = [re.sub(r"FILE(\.\w+)?", f"{tmp_path}/there{ending}", word) for word in NAMED[where]]
        words = [word.replace("FOLDER", str(tmp_path)) for word in words]
        result = CliRunner().invoke(import_module("probewatch.tools.cli").probewatch, [*where[0].split(), *words])
        said = f"{result.exception} {result.output}"
        assert "and what is written there is" in said or re.search("--output .*ends? in ", said), (ending, said)
        assert result.exit_code != 0
        assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("page", [b"", b"<!doctype html><html>old"])
def test_a_page_replaces_an_earlier_page(page: bytes, tmp_path: Path) -> None:
    (tmp_path / "trend.html").write_bytes(page)
    trend = import_module("probewatch.tools.commands.trend").command
    result = CliRunner().invoke(trend, [str(tmp_path), "--html", str(tmp_path / "trend.html")])
    assert "holds no alarm log" in str(result.exception), "it goes on to read"
