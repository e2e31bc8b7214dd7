"""`make release-check` on stand-ins for the targets: all are run whatever fails, and the table leaves none out."""

import re
import subprocess
from pathlib import Path

import pytest

from tests.rules.release import OF_A_MACHINE, PARTS, ROOT, main


def test_all_targets_run_whatever_fails_and_the_table_says_how_each_ended(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    rules = [f"{part[0]}:\n\t@echo ran {part[0]} $(FRAMES); test {part[0]} != mutation" for part in PARTS]
    (tmp_path / "Makefile").write_text("\n".join(rules) + "\n")
    assert main(["make", "-C", str(tmp_path)], root=False) == 1
    text = capfd.readouterr().out
    assert re.findall(r"^ran (\S+)", text, re.M) == [part[0] for part in PARTS]
    assert "ran invariant 100000" in text
    rows = dict(re.findall(r"^\| (.+?) \| \d* \| (.*) \|$", text, re.M))
    assert rows.pop("mutation") == "FAILED, exit code 2"
    assert [rows.pop(part[0]) for part in OF_A_MACHINE] == ["LEFT OUT: needs root"] * 2
    assert set(rows.values()) == {"passed"}


def test_every_target_that_judges_is_in_it() -> None:
    """Those that measure, write or make something are not, nor those that are part of another."""
    targets = set(re.findall(r"^([a-z0-9-]+):.*##[+]? ", (ROOT / "Makefile").read_text(), re.M))
    of_another = {"lint", "types", "contracts", "quick", "failures", "deb", "release-check"}
    measures = {
        *(
            "evidence",
            "evidence-full",
            "false-alarms",
            "coverage-page",
            "point-coverage",
            "crosswire",
            "crosswire-scans",
            "onlookers",
        ),
        *("repeat", "coverage", "bench", "paper", "docs", "lock", "clean", "help", "help-all", "setup"),
    }
    emulated = {"test-arm64"}  # hours, and the tests that fail there are those that qemu-user cannot run
    judging = targets - of_another - measures - emulated
    assert judging == {part[0] for part in (*PARTS, *OF_A_MACHINE)}


def test_help_lists_at_most_twenty_targets_and_help_all_every_one() -> None:
    listed = {
        asked: re.findall(r"^  ([a-z0-9-]+) +\S", subprocess.check_output(["make", "-C", ROOT, asked], text=True), re.M)
        for asked in ("help", "help-all")
    }
    assert {"demo", "test"} < {*listed["help"]} < {*listed["help-all"]}
    assert len(listed["help"]) <= 20
    phony = re.search(r"^\.PHONY: ((?:.*\\\n)*.*)", (ROOT / "Makefile").read_text(), re.M)
    assert phony is not None
    assert {*listed["help-all"]} == {*phony[1].replace("\\\n", " ").split()}
