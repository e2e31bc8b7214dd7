"""Log lines as journal entries, read back by the definition of the protocol."""

import io
import json
import socket
from pathlib import Path

import pytest

from probewatch.appliance.service.host.journal import JournalStream, journal_entry, journal_stream


def parsed(datagram: bytes) -> dict[str, str]:
    """The protocol by its definition: NAME=value lines, or NAME, length, value."""
    fields, rest = {}, datagram
    while rest:
        name, _, tail = rest.partition(b"\n")
        if b"=" in name:
            key, _, value = name.partition(b"=")
            rest = tail
        else:
            key, length = name, int.from_bytes(tail[:8], "little")
            value, rest = tail[8 : 8 + length], tail[9 + length :]
        fields[key.decode()] = value.decode()
    return fields


def test_every_field_is_found_again() -> None:
    line = {
        "event": "device lost",
        "level": "warning",
        "timestamp": "x",
        "device": "video",
        "what": "kein Bild",
        "n": 3,
    }
    fields = parsed(journal_entry(line))
    assert fields["MESSAGE"] == "device lost device=video what=kein Bild n=3"
    assert fields["PRIORITY"] == "4"
    assert fields["PROBEWATCH_EVENT"] == "device lost"
    assert (fields["PROBEWATCH_DEVICE"], fields["PROBEWATCH_WHAT"], fields["PROBEWATCH_N"]) == (
        "video",
        "kein Bild",
        "3",
    )


def test_a_value_of_several_lines_stays_one_value() -> None:
    fields = parsed(journal_entry({"event": "crash", "exception": "a\nb=c\n", "last": "z"}))
    assert fields["PROBEWATCH_EXCEPTION"] == "a\nb=c\n"
    assert fields["PROBEWATCH_LAST"] == "z"


def test_names_are_what_the_journal_allows() -> None:
    fields = parsed(journal_entry({"event": "e", "strange-näme": 1}))
    assert fields["PROBEWATCH_STRANGE_N_ME"] == "1"


def test_lines_go_to_the_journal_and_elsewhere_when_it_has_gone(tmp_path: Path) -> None:
    elsewhere = io.StringIO()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as journal:
        journal.bind(str(tmp_path / "journal"))
        stream = JournalStream(str(tmp_path / "journal"), elsewhere)
        stream.write(json.dumps({"event": "state", "level": "info", "state": "halt"}) + "\n")
        assert parsed(journal.recv(65536))["PROBEWATCH_STATE"] == "halt"
        stream.write("no JSON\n")
    stream.write('{"event": "lost"}\n')
    stream.close()
    assert elsewhere.getvalue() == 'no JSON\n{"event": "lost"}\n'


def test_without_a_journal_behind_stderr_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JOURNAL_STREAM", "1:2")
    assert journal_stream() is None
    monkeypatch.delenv("JOURNAL_STREAM")
    assert journal_stream() is None
