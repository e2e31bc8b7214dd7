"""What the package is made from, without building it: arguments, man pages, completion, and what purging leaves."""

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import click
import pytest

ROOT = Path(__file__).parents[2]
DEB = ROOT / "systemd" / "deb"
sys.path.insert(0, str(DEB))
import build  # noqa: E402  a script beside the package's files, not a package
import documents  # noqa: E402
import sbom  # noqa: E402

from probewatch.tools.cli import _COMMANDS as COMMANDS  # noqa: E402
from probewatch.tools.commands.simulate import _DEVICES  # noqa: E402

_CALIBRATION = ("back", "diff", "export", "import", "list", "measured", "recover", "reset", "show", "use")
PAGES = documents.man_pages("9.9", "2026-01-02")


@pytest.mark.parametrize("suites", [(), ("bookworm",), ("bookworm", "trixie")], ids=str)
def test_suites_may_be_named_or_not(suites: tuple[str, ...]) -> None:
    context = build.main.make_context("build", ["out", *suites])
    assert context.params["suites"] == suites


def test_an_unknown_suite_is_refused_by_name() -> None:
    with pytest.raises(click.BadParameter, match="'buster' is not one of 'bookworm', 'trixie'"):
        build.main.make_context("build", ["out", "buster"])


def test_the_units_and_what_lies_beside_them_are_shipped_where_systemd_looks() -> None:
    for file in [*DEB.parent.glob("*.service"), *DEB.parent.glob("*.timer"), *DEB.parent.glob("*.service.d/*")]:
        place = file.relative_to(DEB.parent)
        assert build.FILES[f"systemd/{place}"] == f"usr/lib/systemd/system/{place}"


def test_every_command_and_subcommand_has_a_man_page() -> None:
    below = {f"probewatch-simulate-{name}.1" for name in _DEVICES}
    below |= {f"probewatch-calibration-{name}.1" for name in _CALIBRATION}
    assert set(PAGES) == {"probewatch.1"} | {f"probewatch-{name}.1" for name in COMMANDS} | below


def test_the_first_page_names_every_command_in_words_that_are_not_cut_off() -> None:
    for name, what in COMMANDS.items():
        assert f"\\fB{name}\\fP\n  {what}\n" in PAGES["probewatch.1"]
    assert all("..." not in page.split(".SH SYNOPSIS")[0] for page in PAGES.values())
    assert "/var/lib/probewatch" in PAGES["probewatch.1"]


def test_lines_of_a_man_page_stay_as_the_help_has_them() -> None:
    page = PAGES["probewatch-log.1"]
    assert re.search(r"\.nf\nExamples:\n  probewatch log --last 20\n.*?\n\.fi\n", page, re.S)
    assert not any("\x08" in page for page in PAGES.values())


@pytest.mark.skipif(shutil.which("man") is None, reason="needs man (man-db)")
def test_man_reads_every_page_without_a_warning(tmp_path: Path) -> None:
    for name, page in PAGES.items():
        (tmp_path / name).write_text(page)
    files = [str(tmp_path / name) for name in PAGES]
    command = ["man", "--warnings", "-E", "UTF-8", "-l", "-Tutf8", "-Z", *files]
    done = subprocess.run(command, capture_output=True, check=False, env=os.environ | {"LC_ALL": "C.UTF-8"})
    assert (done.returncode, done.stderr.decode()) == (0, "")


@pytest.mark.thorough
def test_bash_completes_commands_by_the_script_that_the_package_ships(tmp_path: Path) -> None:
    script = tmp_path / "completion"
    script.write_text(documents.completions()[documents.COMPLETIONS["bash"]])
    typed = "COMP_WORDS=(probewatch re); COMP_CWORD=1; _probewatch_completion probewatch; echo ${COMPREPLY[@]}"
    command = ["bash", "-c", f"source {script}; {typed}"]
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert done.stdout.split() == ["recalibrate", "record", "release", "reload", "replay", "report"]


def test_the_list_of_parts_is_the_same_for_the_same_tree_and_valid(tmp_path: Path) -> None:
    """Of this environment, which holds more than the package does."""
    site, at = Path(sysconfig.get_path("purelib")), datetime(2026, 1, 2, tzinfo=UTC)
    text = sbom.sbom(site, "probewatch", "9.9", at)
    assert text == sbom.sbom(site, "probewatch", "9.9", at)
    bom = json.loads(text)
    parts = {part["name"]: part for part in bom["components"]}
    assert bom["metadata"]["component"]["purl"].startswith("pkg:pypi/probewatch@")
    assert parts["numpy"]["purl"] == f"pkg:pypi/numpy@{version('numpy')}"
    assert all(part.get("licenses") for part in parts.values() if part["type"] == "library")
    assert not [name for name, part in parts.items() if part["type"] == "file" and not part["hashes"]]
    assert {bom["specVersion"], bom["bomFormat"]} == {"1.6", "CycloneDX"}


def purged(system: Path, **environment: str) -> str:
    """What the script says that dpkg runs for `apt purge`, on a system that lies in a folder."""
    command = ["sh", str(DEB / "postrm"), "purge"]
    environment = os.environ | {"DPKG_ROOT": str(system)} | environment
    done = subprocess.run(
        command, capture_output=True, text=True, env=environment, stdin=subprocess.DEVNULL, check=True
    )
    assert not (system / "etc/probewatch").exists()
    return done.stderr


@pytest.fixture
def system(tmp_path: Path) -> Path:
    (tmp_path / "etc/probewatch").mkdir(parents=True)
    (tmp_path / "etc/probewatch/probewatch.toml").write_text("configured = true\n")
    (tmp_path / "var/lib/probewatch").mkdir(parents=True)
    return tmp_path


def test_purging_keeps_the_audit_trail_and_says_where_it_is(system: Path) -> None:
    log = system / "var/lib/probewatch/alarm.jsonl"
    log.write_text("{}\n")
    said = purged(system)
    assert log.read_text() == "{}\n"
    assert str(log.parent) in said
    assert "PROBEWATCH_PURGE_AUDIT_TRAIL=yes" in said


def test_purging_deletes_the_audit_trail_where_that_is_asked_for(system: Path) -> None:
    (system / "var/lib/probewatch/alarm.jsonl").write_text("{}\n")
    assert purged(system, PROBEWATCH_PURGE_AUDIT_TRAIL="yes") == ""
    assert not (system / "var/lib/probewatch").exists()


def test_purging_leaves_no_empty_folder(system: Path) -> None:
    for name in ("probewatch-recorder", "probewatch-page"):
        (system / "var/lib" / name).mkdir()
    assert purged(system) == ""
    assert not [*(system / "var/lib").iterdir()]


def test_purging_keeps_recordings_and_says_where_they_are(system: Path) -> None:
    recording = system / "var/lib/probewatch-recorder/kept/a.mcap"
    recording.parent.mkdir(parents=True)
    recording.write_bytes(b"x")
    assert "pictures of patients" in purged(system, PROBEWATCH_PURGE_AUDIT_TRAIL="yes")
    assert recording.exists()
