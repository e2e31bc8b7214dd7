"""The hash chain of the alarm log: entries of other types, in another place, or of another version."""

import json
from pathlib import Path
from typing import Any

import pytest

from probewatch.appliance.storage.alarm_chain import AFTER, MEMORY, digest_of, read_log, segments
from probewatch.appliance.storage.alarm_log import AlarmLog
from tests.appliance.storage.test_alarm_log import HALT, NOON, faults, filled


def signed(entry: dict[str, Any]) -> bytes:
    """A line whose digest is right, as another version of this software may have written it."""
    return json.dumps({**entry, "digest": digest_of(entry)}).encode() + b"\n"


ENTRY = {"number": 5, "utc": NOON.isoformat(), "t_ns": 0, "event": "state", "data": {}, "latch": None, "previous": ""}


@pytest.mark.parametrize(
    "change",
    [
        {"number": "5"},
        {"number": None},
        {"number": True},
        {"utc": "noon"},
        {"utc": "2026-01-01T12:00:00"},
        {"t_ns": 0.5},
        {"event": None},
        {"data": []},
        {"latch": {}},
        {"latch": "halt"},
        {"latch": {"state": 5, "fault": None}},
        {"latch": {"state": "halt", "fault": ["scale"]}},
        {"previous": 0},
        {"more": 1},
    ],
)
def test_an_entry_of_other_types_is_damage_and_no_crash(tmp_path: Path, change: dict[str, Any]) -> None:
    filled(tmp_path, 3, HALT)
    with segments(tmp_path)[0].open("ab") as stream:
        stream.write(signed(ENTRY | change))
    assert (AlarmLog(tmp_path).damage, AlarmLog(tmp_path).latch) == (("log-damaged",), HALT)


@pytest.mark.parametrize(
    "change",
    [
        {"number": "4"},
        {"number": None},
        {"first": "1"},
        {"digest": 0},
        {"damage": "log-damaged"},
        {"damage": 7},
        {"latch": {}},
        {"latch": {"state": 5, "fault": None}},
        {"more": 1},
    ],
)
def test_a_memory_of_other_types_is_damage_and_no_crash(tmp_path: Path, change: dict[str, Any]) -> None:
    filled(tmp_path, 3, HALT)
    stored = json.loads((tmp_path / MEMORY).read_bytes())
    del stored["check"]
    stored |= change
    (tmp_path / MEMORY).write_text(json.dumps({**stored, "check": digest_of(stored)}))
    assert (AlarmLog(tmp_path).damage, AlarmLog(tmp_path).latch) == (("memory-damaged",), HALT)


def test_a_memory_that_is_nested_beyond_reason_or_is_a_folder_is_damage(tmp_path: Path) -> None:
    filled(tmp_path, 3, HALT)
    (tmp_path / MEMORY).write_bytes(b"[" * 100_000)
    assert (AlarmLog(tmp_path).damage, AlarmLog(tmp_path).latch) == (("memory-damaged",), HALT)
    (tmp_path / MEMORY).unlink()
    (tmp_path / MEMORY).mkdir()
    assert (AlarmLog(tmp_path).damage, AlarmLog(tmp_path).latch) == (("memory-damaged",), HALT)


def two_chains(folder: Path) -> list[Path]:
    """Entries 1 to 4, and after a loss of the memory, which a person accepted, 5 to 8; its two segments."""
    filled(folder, 3)
    (folder / MEMORY).unlink()
    again = filled(folder, 2)
    again.damage = ()
    again.append(NOON, 9, "state", {"state": "monitoring"}, None)
    assert ([entry.number for entry in read_log(folder).entries], faults(folder)) == ([*range(1, 9)], [])
    first, second = segments(folder)
    return [first, second]


@pytest.mark.parametrize("moved", [False, True], ids=["copied", "moved"])
def test_a_line_in_another_place_shows_also_where_it_begins_a_chain(tmp_path: Path, moved: bool) -> None:
    """Every line of two chains at every other place of both segments."""
    files = two_chains(tmp_path)
    whole = [file.read_bytes().splitlines(keepends=True) for file in files]
    places = [(f, at) for f in range(2) for at in range(5)]
    unseen = []
    for source, taken in ((f, at) for f in range(2) for at in range(4)):
        for target, at in places:
            if moved and target == source and at in (taken, taken + 1):
                continue
            lines = [list(part) for part in whole]
            lines[target].insert(at, whole[source][taken])
            if moved:
                del lines[source][taken + (source == target and at <= taken)]
            for file, part in zip(files, lines, strict=True):
                file.write_bytes(b"".join(part))
            if "log-damaged" not in faults(tmp_path):
                unseen.append((source, taken, target, at))
    assert unseen == []


def test_a_beginning_of_a_chain_that_stands_twice_is_said_to_be_moved_or_copied(tmp_path: Path) -> None:
    _, second = two_chains(tmp_path)
    lines = second.read_bytes().splitlines(keepends=True)
    second.write_bytes(b"".join([*lines, lines[0]]))
    assert any("which begins a chain, follows entry 8" in one.what for one in read_log(tmp_path).damages)


def test_a_segment_under_another_name_shows(tmp_path: Path) -> None:
    _, second = two_chains(tmp_path)
    content = second.read_bytes()
    for name in ("alarms-00000004.jsonl", "alarms-00000006.jsonl", "alarms-00000099.jsonl"):
        copy = tmp_path / name
        copy.write_bytes(content)
        assert "log-damaged" in faults(tmp_path), name
        copy.unlink()
    second.rename(tmp_path / "alarms-00000006.jsonl")
    assert "log-damaged" in faults(tmp_path)


@pytest.mark.parametrize("kept", [1, 2, 3])
def test_a_chain_that_was_cut_before_the_next_one_began_shows(tmp_path: Path, kept: int) -> None:
    """Nothing but the beginning of the next chain says where the one before it ended."""
    first, _ = two_chains(tmp_path)
    first.write_bytes(b"".join(first.read_bytes().splitlines(keepends=True)[:kept]))
    assert "log-damaged" in faults(tmp_path)


def test_a_chain_of_an_earlier_version_is_whole(tmp_path: Path) -> None:
    """Its first entry does not say where the one before it ended."""
    _, second = two_chains(tmp_path)
    lines = second.read_bytes().splitlines(keepends=True)
    entries = [json.loads(line) for line in lines]
    del entries[0]["data"][AFTER]
    previous = entries[0]["previous"]
    for entry in entries:
        entry["previous"] = previous
        del entry["digest"]
        previous = entry["digest"] = digest_of(entry)
    second.write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    memory = json.loads((tmp_path / MEMORY).read_text())
    del memory["check"]
    memory["digest"] = previous
    (tmp_path / MEMORY).write_text(json.dumps({**memory, "check": digest_of(memory)}))
    assert read_log(tmp_path).damages == ()
