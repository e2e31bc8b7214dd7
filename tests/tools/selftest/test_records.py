"""Records of self-tests: what is none is told, and so is one that was edited, put in or taken out."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from probewatch.tools.selftest.records import read_self_tests, sealed


def kept(folder: Path, number: int) -> None:
    record = {"utc": f"2026-01-0{number}T07:00:00+00:00", "passed": True, "items": [{"name": "disk", "green": True}]}
    (folder / f"{number}.json").write_text(json.dumps(sealed(record, folder)))


def edited(folder: Path, changed: Callable[[dict[str, Any]], object]) -> None:
    record = json.loads((folder / "2.json").read_text())
    changed(record)
    (folder / "2.json").write_text(json.dumps(record))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for number in (1, 2, 3):
        kept(tmp_path, number)
    return tmp_path


def test_a_chain_that_nobody_touched_is_whole(folder: Path) -> None:
    records = read_self_tests(folder)
    assert (len(records.kept), records.faults) == (3, [])
    assert read_self_tests(folder / "none").kept == []


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda folder: edited(folder, lambda one: one.update(passed=False)), "2.json was changed"),
        (lambda folder: edited(folder, lambda one: one["items"][0].update(green=False)), "2.json was changed"),
        (lambda folder: edited(folder, lambda one: one.pop("digest")), "2.json has no digest"),
        (lambda folder: edited(folder, lambda one: one.update(previous="0" * 64)), "2.json was changed"),
        (lambda folder: (folder / "2.json").unlink(), "3.json follows a record that is missing"),
        (lambda folder: (folder / "2.json").write_text("[]"), "2.json cannot be read"),
    ],
)
def test_what_was_edited_or_taken_out_is_told(folder: Path, change: Callable[[Path], object], told: str) -> None:
    change(folder)
    assert any(told in fault for fault in read_self_tests(folder).faults)


@pytest.mark.parametrize(
    ("field", "value"),
    [("digest", [1]), ("previous", {}), ("items", [{"figure": 10**400}]), ("items", [{"figure": "x"}])],
)
def test_what_somebody_else_put_there_is_told_and_the_rest_is_read(folder: Path, field: str, value: object) -> None:
    """Each ended the report, or the next self-test, with a traceback."""
    record = {"utc": "2026-01-02T08:00:00+00:00", "items": [], "previous": "", "digest": "", field: value}
    (folder / "other\x1b[2J.json").write_text(json.dumps(record))
    records = read_self_tests(folder)
    assert (len(records.kept), records.faults) == (3, ["other\N{REPLACEMENT CHARACTER}[2J.json cannot be read"])


def test_a_clock_that_was_set_back_breaks_no_chain(folder: Path) -> None:
    (folder / "3.json").rename(folder / "4.json")
    record = {"utc": "2025-12-01T07:00:00+00:00", "passed": True, "items": []}
    (folder / "0.json").write_text(json.dumps(sealed(record, folder)))
    kept(folder, 5)
    assert (len(read_self_tests(folder).kept), read_self_tests(folder).faults) == (5, [])


def test_records_of_an_earlier_version_are_read_and_followed(folder: Path) -> None:
    edited(folder, lambda one: one.pop("digest"))
    for name in ("1.json", "3.json"):
        (folder / name).unlink()
    assert read_self_tests(folder).faults == []
    kept(folder, 3)
    assert read_self_tests(folder).faults == []


def test_what_somebody_else_put_beside_them_is_told_and_not_waited_for(tmp_path: Path) -> None:
    """Whoever is in the group may write there."""
    os.mkfifo(tmp_path / "pipe.json")
    (tmp_path / "endless.json").symlink_to("/dev/zero")
    (tmp_path / "deep.json").write_text("[" * 100_000)
    (tmp_path / "early.json").write_text('{"utc": "0001-01-01T00:00:00+23:00", "items": []}')
    (tmp_path / "number.json").write_text("7")
    records = read_self_tests(tmp_path)
    assert records.kept == []
    assert len(records.faults) == 5
