"""`probewatch log` as a clinical engineer uses it."""

import csv
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from probewatch.appliance.storage import alarm_chain
from probewatch.appliance.storage.alarm_chain import Event, Latch, segments
from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.commands.log import command
from tests.support.answers import answered

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


def test_the_end_of_an_overload_is_no_change_to_the_state_in_which_it_came(folder: Path) -> None:
    """It was counted among the halts of a year."""
    AlarmLog(folder).append(NOON, 9, "overload-ended", {"for_s": 9, "state": "halt", "fault": "scale"}, None)
    assert [int(line.split()[0]) for line in asked(folder, "--state", "halt").stdout.splitlines()] == [3]
    assert [int(line.split()[0]) for line in asked(folder, "--fault", "scale").stdout.splitlines()] == [2, 3, 6]


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
        (["--state", "device lost"], []),
        (["--verify"], []),
    ],
)
def test_filters(folder: Path, arguments: list[str], numbers: list[int]) -> None:
    result = asked(folder, *arguments)
    assert [int(line.split()[0]) for line in result.stdout.splitlines()] == numbers


REFERENCE = {"number": 2, "origin": "configuration", "file": "x.toml", "sha256": "cd"}
DATA: dict[Event, dict[str, Any]] = {
    Event.CHAIN_BEGUN: {"found": []},
    Event.STARTED: {"software": "0.1", "reference": {"number": 1, "sha256": "ab"}, "found": [], "simulated": ["sim:x"]},
    Event.STOPPED: {},
    Event.STATE: {"state": "monitoring", "fault": None, "reason": "calibration verified"},
    Event.REQUEST: {"do": "use-reference", "who": "anna", "reason": None, "number": 2},
    Event.REFERENCE: {"reference": {"number": 2, "origin": "file", "file": "x.toml", "sha256": "cd"}},
    Event.RELOADED: {"changed": ["limits"], "noise": None},
    Event.ESTIMATE: {"reference": 2, "checks": {"rotation-axial": [0.12, 0.3, 3.0], "latency": [4.0, 2.0, 60.0]}},
    Event.PROPOSAL: {"text": "rotation-axial is now 9 ± .5 deg", "about": ["rotation-axial"]},
    Event.UNDECIDED: {"text": "cause undecided", "names": ["latency", "scale-axial"]},
    Event.GIVEN_UP: {"who": "process 7", "why": "its connection is gone"},
    Event.OVERDUE: {"overdue": "since 2026-01-01"},
    Event.OVERLOADED: {"dropped": 3},
    Event.OVERLOAD_ENDED: {"dropped": 31, "for_s": 4.5},
    Event.WALL_CLOCK: {"by_s": -3600.0},
    Event.SLEPT: {"for_s": 28800.0},
}
"""As the service writes them, of each one: a reference is a number in one and a table in another."""


@pytest.fixture
def every(tmp_path: Path) -> Path:
    log = AlarmLog(tmp_path / "every")
    for number, event in enumerate(Event):
        if event is not Event.CHAIN_BEGUN:
            log.append(NOON + timedelta(hours=number), number, event, DATA[event], None)
    log.append(NOON + timedelta(days=2), 99, "of another version", {"reference": [3], "state": {"x": 1}}, None)
    return tmp_path / "every"


@pytest.mark.parametrize("event", Event)
def test_every_kind_of_entry_is_read_by_every_option(every: Path, tmp_path: Path, event: Event) -> None:
    for arguments in (["--event", event], ["--event", event, "--last", "1"], ["--event", event, "--csv", "out.csv"]):
        where = [str(tmp_path / one) if one == "out.csv" else one for one in arguments]
        result = asked(every, *where)
        assert result.exit_code == 0, result.output
        assert result.stdout.count("\n") == 1
    asked_for = asked(every, "--event", event).stdout
    assert f" {event}" in asked_for
    assert (f" {event}: " in asked_for) == bool(DATA.get(event)), "what it holds is told, in words"


def test_what_is_shown_of_an_estimate_can_be_read(every: Path) -> None:
    told = asked(every, "--event", "estimate").stdout
    assert "reference 2: rotation-axial 0.12 ± 0.3 deg, latency 4.0 ± 2.0 ms" in told
    assert len(asked(every, "--since", "2026-01-01").stdout.splitlines()) == len(Event) + 1
    assert "of another version: " in asked(every, "--last", "1").stdout


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--state", "bogus"], "Use one of self-test, "),
        (["--state", "hlat"], "Did you mean 'halt'?"),
        (["--event", "overload"], "Did you mean 'overloaded' or 'overload-ended'?"),
        (["--fault", "scales"], "Did you mean 'scale'?"),
    ],
)
def test_a_name_that_is_none_is_refused_with_those_that_are(folder: Path, arguments: list[str], told: str) -> None:
    result = asked(folder, *arguments)
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.replace("│", " ").split())


def test_an_empty_or_a_wrong_folder_is_no_whole_chain(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("x")
    for arguments in (["--verify"], []):
        error = asked(tmp_path, *arguments).exception
        assert isinstance(error, ConfigurationError)
        assert "holds no alarm log" in str(error)


def test_damage_is_said_and_is_exit_65(folder: Path) -> None:
    file = segments(folder)[0]
    file.write_bytes(file.read_bytes().replace(b"anna", b"otto"))
    result = asked(folder, "--verify")
    assert result.exit_code == 65
    assert "line 5: is not an entry (it was changed)" in result.stderr
    assert "NOT whole" in result.stderr


def test_of_a_folder_that_is_not_the_carts_it_does_not_ask_to_acknowledge_here(folder: Path, tmp_path: Path) -> None:
    """`ack` changes the log of the cart that this command belongs to, and no copy."""
    file = segments(folder)[0]
    file.write_bytes(file.read_bytes().replace(b"anna", b"otto"))
    cart = tmp_path / "cart.toml"
    cart.write_text(f'[alarm]\nfolder = "{folder}"\n')
    own = CliRunner().invoke(command, ["--config", str(cart), "--verify"])
    assert "then probewatch ack" in own.stderr
    copied = asked(folder, "--verify")
    assert (copied.exit_code, "probewatch ack is for the cart's own" in copied.stderr) == (65, True)


@pytest.mark.parametrize(
    ("line", "said"), [(b"\xff\xfe\n", "it is not UTF-8 text"), (b'{"number": \n', "it is not JSON, or a part of it")]
)
def test_a_line_that_no_entry_can_be_is_told_in_words_for_a_person(folder: Path, line: bytes, said: str) -> None:
    file = segments(folder)[0]
    lines = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(b"".join([*lines[:2], line, *lines[3:]]))
    assert f"line 3: is not an entry ({said}" in asked(folder, "--verify").stderr


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


def test_csv_has_an_empty_cell_where_there_is_no_fault(folder: Path, tmp_path: Path) -> None:
    AlarmLog(folder).append(NOON, 0, Event.STATE, {"state": "monitoring", "fault": None}, None)
    AlarmLog(folder).append(NOON, 0, Event.GIVEN_UP, {"who": "root", "why": "given up for root"}, None)
    asked(folder, "--last", "2", "--csv", str(tmp_path / "out.csv"))
    with (tmp_path / "out.csv").open(newline="", encoding="utf-8") as stream:
        row, other = csv.DictReader(stream)
    assert (row["state"], row["fault"]) == ("monitoring", "")
    assert other["text"] == "given up for root", "as the log tells it: no column has it"


def test_an_export_writes_over_nothing_and_not_into_the_log(folder: Path, tmp_path: Path) -> None:
    """An export replaced a segment of the log of a running cart, and the command said that the chain was whole."""
    (part,) = folder.glob("*.jsonl")
    before = part.read_bytes()
    for place in (part, folder / "new.csv"):
        assert isinstance(asked(folder, "--csv", str(place)).exception, ConfigurationError)
    assert part.read_bytes() == before
    assert not (folder / "new.csv").exists()


@pytest.mark.parametrize(
    "arguments", [("--verify", "--state", "halt"), ("--since", "2026-02-01", "--until", "2026-01-01")]
)
def test_options_that_contradict_one_another_are_refused(folder: Path, arguments: tuple[str, ...]) -> None:
    assert asked(folder, *arguments).exit_code == 2


def test_it_says_that_nothing_is_what_was_asked_for(folder: Path) -> None:
    assert "none of the 5 entries matches" in asked(folder, "--since", "2100-01-01").stderr


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


WRITTEN = {
    Event.CHAIN_BEGUN: ({"found": ["alarms-1.jsonl line 2: it was changed"], "after": "0" * 64}, "because of alarms-1"),
    Event.STOPPED: ({}, "stopped\n"),
    Event.RELOADED: (
        {"file": "/etc/p.toml", "sha256": "ab" * 32, "noise": None, "limits": {"profile": "fine", "beside": {}}},
        "/etc/p.toml, SHA-256 abababababab · limits: fine",
    ),
    Event.GIVEN_UP: ({"who": "anna", "why": "given up for anna, gone"}, "given up for anna, gone"),
    Event.OVERDUE: ({"overdue": None}, "not overdue any more"),
    Event.OVERLOADED: (
        {"pressure": 0.62, "late": 0.1, "waiting_frames": 3, "overloaded_s": 0.0},
        "62 % of the last second waiting for a processor, 10 % of its ticks late, 3 pictures waiting",
    ),
    Event.OVERLOAD_ENDED: (
        {"for_s": 7.5, "device_losses": 2, "repeated": {"warning (video-lost)": 3}, "state": "warning", "fault": None},
        "after 7.5 s, 2 losses of devices meanwhile, without an entry each: warning (video-lost) 3 times",
    ),
    Event.WALL_CLOCK: ({"by_s": -3600.0}, "stepped by -3600 s"),
    Event.SLEPT: ({"for_s": 28800.0}, "slept for 28800"),
    "of another version": ({"cause": {"a": [1, 2]}, "seen": True, "none": None}, "cause (a 1, 2), seen yes"),
}


@pytest.mark.parametrize("event", WRITTEN, ids=str)
def test_every_kind_of_entry_is_told_in_words(event: str, tmp_path: Path) -> None:
    """Braces, quotes and null are for programs: --csv and the file itself."""
    data, words = WRITTEN[event]
    AlarmLog(tmp_path).append(NOON, 1, event, data, None)
    line = asked(tmp_path, "--last", "1").stdout
    assert words in line
    assert not set('{}"[]') & set(line), line
    assert "null" not in line


def test_a_pause_of_the_sound_says_how_long_it_was(tmp_path: Path) -> None:
    log = AlarmLog(tmp_path / "alarms")
    log.append(NOON, 0, "request", {"do": "pause-audio", "who": "anna, process 7", "seconds": "30.0"}, None)
    assert "request: pause-audio by anna, process 7: 30 s\n" in asked(tmp_path / "alarms").stdout


def test_the_log_of_a_german_cart_is_told_in_german(folder: Path) -> None:
    """It was English beside a German status; a reason that cannot be translated whole stays English."""
    reason = "polarity +1 axes, limit 0.5 axes"
    data = {"state": "halt", "fault": "polarity", "reason": reason}
    AlarmLog(folder).append(NOON, 9, "state", data, Latch("halt", "polarity"))
    seen = {"do": "acknowledge", "who": "anna", "acknowledged": f"halt: {reason}"}
    AlarmLog(folder).append(NOON, 9, "request", seen, None)
    cart = folder.parent / "cart.toml"
    cart.write_text('[alarm]\nlanguage = "de"\n')
    result = asked(folder, "--config", str(cart))
    told = result.stdout.splitlines()
    assert told[2].endswith("state: halt (scale) · as it is [latched: halt]"), "whole in one language"
    assert told[0].endswith("Kette begonnen: eines neuen Protokolls")
    assert told[4].endswith("Anfrage: acknowledge durch anna, Prozess 7")
    assert told[5].endswith("Zustand: Halt (polarity) · Spiegelung +1 Achsen, Grenze 0.5 Achsen [gehalten: Halt]")
    assert told[6].endswith("Anfrage: acknowledge durch anna: Halt: Spiegelung +1 Achsen, Grenze 0.5 Achsen")
    assert result.stderr == "7 Einträge, die Kette ist heil\n"
    none = asked(folder, "--config", str(cart), "--state", "recalibrating")
    assert none.stderr.startswith("keiner der 7 Einträge passt\n")
    chosen = asked(folder, "--config", str(cart), "--state", "halt").stdout
    assert len(chosen.splitlines()) == 2, "options keep the words of the log"


@pytest.mark.parametrize(
    ("event", "data", "said"),
    [
        (Event.OVERLOADED, {"pressure": 0.62, "waiting_frames": 3}, "überlastet: 62 % der letzten Sekunde"),
        (Event.OVERLOADED, {"late": 0.1}, "überlastet: 10 % seiner Takte verspätet"),
        (
            Event.OVERLOAD_ENDED,
            {"for_s": 7.5, "device_losses": 2, "repeated": {"warning (video-lost)": 3, "halt (scale)": 1}},
            "2-mal ein Gerät verloren, ohne eigenen Eintrag: Warnung (video-lost) 3-mal, Halt (scale) 1-mal",
        ),
        (
            Event.OVERLOAD_ENDED,
            {"for_s": 7.5, "repeated": {"not verified": 2, "monitoring": 1}},
            "Überlastung beendet: nach 7.5 s, ohne eigenen Eintrag: nicht bestätigt 2-mal, überwacht 1-mal",
        ),
        (
            Event.ESTIMATE,
            {"reference": 4, "checks": {"scale-axial": [0.1, 0.02, 5.0], "latency": [3.1, 5.0, 60.0]}},
            "Schätzung: Referenz 4: Maßstab axial 0.1 ± 0.02 %, Verzögerung 3.1 ± 5.0 ms",
        ),
        (Event.ESTIMATE, {"reference": 4, "checks": "of another version"}, "estimate: reference 4, checks of another"),
        (
            Event.STARTED,
            {"software": "0.2", "configuration": {"sha256": "ab" * 32}, "reference": REFERENCE, "simulated": ["sim:x"]},
            "gestartet: probewatch 0.2 · Konfiguration abababababab · Referenz 2, Konfiguration, x.toml, SHA-256 cd · "
            "SIMULIERT: sim:x",
        ),
        (
            Event.STATE,
            {
                "state": "halt",
                "fault": "offset",
                "reason": "HALT: calibration is wrong · Marker body or tracker has moved",
            },
            "Zustand: Halt (offset) · HALT: Kalibrierung ist falsch · Markerkörper oder Tracker ist verrutscht",
        ),
        (Event.STATE, {"state": "halt", "reason": "HALT: calibration is wrong · a dream"}, "state: halt · HALT: calib"),
        (Event.STARTED, {"found": ["a gap"]}, "started: found a gap"),
        (
            Event.REFERENCE,
            {"reference": {**REFERENCE, "who": "anna, process 7", "origin": "went back to 1"}},
            "Referenz: Referenz 2, zurück zu 1, x.toml, SHA-256 cd durch anna, Prozess 7",
        ),
        (Event.REFERENCE, {"reference": {**REFERENCE, "origin": "a dream"}}, "reference: reference 2, a dream, x.toml"),
        (
            Event.RELOADED,
            {"file": "/etc/p.toml", "sha256": "ab" * 32, "noise": {"file": "n.toml"}},
            "neu gelesen: /etc/p.toml, SHA-256 abababababab · Schwelle für einen Namen nach n.toml",
        ),
        (
            Event.REQUEST,
            {"do": "propose-calibration", "who": "anna, process 7", "number": 2},
            "Anfrage: propose-calibration durch anna, Prozess 7: Referenz 2",
        ),
        (Event.OVERDUE, {"overdue": None}, "Kalibrierfrist: nicht mehr überfällig"),
        (Event.WALL_CLOCK, {"by_s": -3600.0}, "Uhrzeit: verstellt um -3600 s"),
        (Event.SLEPT, {"for_s": 28800.0}, "der Rechner hat 28800.0 s lang geschlafen"),
        (Event.GIVEN_UP, {"why": "given up for anna, gone"}, "recalibration given up: given up for anna, gone"),
    ],
)
def test_figures_of_a_german_log_are_told_in_german_whole_or_not_at_all(
    event: Event, data: dict[str, object], said: str, tmp_path: Path
) -> None:
    """Every five minutes a German log had an English line, and at every overload two."""
    AlarmLog(tmp_path / "alarms").append(NOON, 1, event, data, None)
    cart = tmp_path / "cart.toml"
    cart.write_text('[alarm]\nlanguage = "de"\n')
    assert said in asked(tmp_path / "alarms", "--config", str(cart), "--last", "1").stdout


def test_what_is_wrong_with_the_log_of_a_german_cart_is_told_in_german(folder: Path, tmp_path: Path) -> None:
    cart = tmp_path / "cart.toml"
    cart.write_text('[alarm]\nlanguage = "de"\n')
    (segment,) = folder.glob("alarms-*.jsonl")
    first, *rest = segment.read_bytes().splitlines(keepends=True)
    segment.write_bytes(b"".join([first, b"no JSON\n", *rest]))
    wrong = f"{segment.name} Zeile 2: ist kein Eintrag (kein JSON, oder ein Teil davon fehlt)"
    shown = answered("log", folder, "--config", cart, "--verify")
    assert (shown.returncode, shown.stderr.splitlines()[0]) == (65, wrong)
    assert "die Kette ist NICHT heil" in shown.stderr
    told = answered("trend", folder, "--config", cart).stderr
    assert (
        told
        == f"das Alarmprotokoll ist beschädigt: {wrong}; gezeigt ist, was es noch hat. Siehe: probewatch log --verify\n"
    )
