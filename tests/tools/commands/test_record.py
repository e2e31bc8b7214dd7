"""`probewatch record status`: what a recorder answers, in words."""

import json
import os
import pwd
import re
import threading
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from probewatch.appliance.configuration.config import load_config
from probewatch.appliance.service.control.server import ControlRefused
from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.commands.record import _print, command, told
from probewatch.tools.recorder.run import RecorderService, ask
from tests.appliance.configuration.test_config import GOOD
from tests.support.answers import answered

ANSWER: dict[str, Any] = {
    "ok": True,
    "session": "20260105T080000Z",
    "recording": True,
    "failing": None,
    "marked": False,
    "ring_bytes": 12_400_000,
    "kept_bytes": 0,
    "ring_files": 1,
    "kept_files": 0,
    "evicted_files": 0,
    "free_bytes": 41_200_000_000,
    "lost_samples": 0,
    "withheld_pictures": 0,
}


def test_what_a_recorder_that_is_well_says() -> None:
    assert told(ANSWER) == [
        ("recorder", "recording"),
        ("this stretch", "not marked"),
        ("ring", "12.4 MB in 1 file"),
        ("kept", "0.0 MB in 0 files"),
        ("disk", "41.2 GB free"),
        ("lost", "nothing"),
        ("withheld", "nothing"),
        ("session", "20260105T080000Z"),
    ]


@pytest.mark.parametrize(
    ("changed", "row"),
    [
        ({"recording": False}, ("recorder", "waits for the service")),
        ({"recording": False, "failing": "No space left"}, ("recorder", "NOT recording: No space left")),
        ({"marked": True}, ("this stretch", "marked: it is kept")),
        ({"ring_files": 7, "evicted_files": 3}, ("ring", "12.4 MB in 7 files, 3 older files gone")),
        ({"lost_samples": 12}, ("lost", "12 samples")),
        ({"withheld_pictures": 4}, ("withheld", "4 pictures")),
    ],
)
def test_what_is_not_as_it_should_be_is_said(changed: dict[str, Any], row: tuple[str, str]) -> None:
    assert row in told({**ANSWER, **changed})


def test_every_field_of_a_recorder_is_told() -> None:
    """One that is added there is not left out here."""
    for name, value in ANSWER.items():
        if name != "ok":
            other = (
                "other" if isinstance(value, str) or value is None else not value if isinstance(value, bool) else 7e9
            )
            assert told({**ANSWER, name: other}) != told(ANSWER), name


@pytest.mark.parametrize("action", ["status", "start", "stop"])
def test_where_no_recorder_answers_the_start_of_this_carts_is_named(tmp_path: Path, action: str) -> None:
    """The unit's is another cart's."""
    template = (Path(__file__).parents[3] / "config" / "probewatch.toml").read_text()
    file = tmp_path / "cart.toml"
    file.write_text(
        template.replace('# socket = "/run/probewatch-recorder/control"', f'socket = "{tmp_path}/recorder"')
    )
    answer = answered("record", action, "--config", file)
    said = f"{tmp_path}/recorder: no recorder answers (no such file or directory). Start it: probewatch record --config"
    assert (answer.returncode, answer.stderr.strip()) == (69, f"probewatch: {said} {file}")


@pytest.mark.parametrize("key", ["folder", "socket"])
def test_of_folder_and_socket_the_one_that_cannot_be_used_is_named(tmp_path: Path, key: str) -> None:
    """The folder was named for a socket without one, with "[Errno 2]"."""
    places = {"folder": tmp_path / "boxes", "socket": tmp_path / "control"} | {key: tmp_path / "file" / "x"}
    (tmp_path / "file").write_text("")
    told_places = "".join(f'{name} = "{place}"\n' for name, place in places.items())
    config = tmp_path / "cart.toml"
    config.write_text(f"{GOOD}[recorder]\n{told_places}")
    said = str(CliRunner().invoke(command, ["--config", str(config)]).exception)
    assert said.startswith(f"[recorder] {key} = '{places[key]}': cannot be used (")
    assert said.endswith(f"Give [recorder] {key} a place that exists and that this user may write to")
    assert "Errno" not in said
    asked = str(CliRunner().invoke(command, ["status", "--config", str(config)]).exception)
    assert re.search(r"no recorder answers \((no such file or|not a) directory\)", asked), asked
    assert "Errno" not in asked


@pytest.mark.parametrize("there", [True, False])
def test_a_start_that_fails_makes_no_folder(tmp_path: Path, there: bool) -> None:
    """It left an empty one behind, with a lock in it, that of the first try and of no recording."""
    boxes, config = tmp_path / "boxes", tmp_path / "cart.toml"
    config.write_text(f'{GOOD}[recorder]\nfolder = "{boxes}"\nsocket = "{tmp_path}/none/x"\n')
    if there:
        boxes.mkdir()
    assert "socket" in str(CliRunner().invoke(command, ["--config", str(config)]).exception)
    assert [one.name for one in boxes.glob("*")] == ([".lock"] if there else [])
    assert boxes.exists() is there


def test_a_second_recorder_leaves_the_first_its_socket(tmp_path: Path) -> None:
    config = tmp_path / "cart.toml"
    config.write_text(f'{GOOD}[recorder]\nfolder = "{tmp_path}/boxes"\nsocket = "{tmp_path}/recorder"\n')
    with RecorderService(load_config(config), lambda _: None):
        own = (tmp_path / "recorder").stat().st_ino
        with pytest.raises(ConfigurationError, match="another recorder writes there"):
            RecorderService(load_config(config))
        assert "Stop that one first" in answered("record", "--config", config).stderr
        assert (tmp_path / "recorder").stat().st_ino == own


def test_a_folder_that_cannot_be_used_leaves_no_socket(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    config = tmp_path / "cart.toml"
    config.write_text(f'{GOOD}[recorder]\nfolder = "{tmp_path}/file/x"\nsocket = "{tmp_path}/recorder"\n')
    with pytest.raises(ConfigurationError, match="folder"):
        RecorderService(load_config(config))
    assert not (tmp_path / "recorder").exists()


def test_a_stretch_that_is_started_or_stopped_twice_is_told_in_words_and_no_lost_recorder(tmp_path: Path) -> None:
    """It ended with 69, no recorder answers, and said no more than "refused: nothing was started"."""
    config = tmp_path / "cart.toml"
    places = f'folder = "{tmp_path}/boxes"\nsocket = "{tmp_path}/recorder"\n'
    config.write_text(f'{GOOD}[recorder]\n{places}[control]\nsocket = "{tmp_path}/control"\n')
    ended = threading.Event()
    with RecorderService(load_config(config), say=lambda _: None) as service:
        writer = threading.Thread(target=service.run, args=(ended.is_set,))
        writer.start()
        try:
            asked = ("stop", "start", "start", "stop", "stop")
            answers = [answered("record", action, "--config", config) for action in asked]
        finally:
            ended.set()
            writer.join()
    assert [answer.returncode for answer in answers] == [75, 0, 75, 0, 75]
    neither = (
        "probewatch: no stretch is being kept: none was started, or it has ended, as it does after an hour. "
        "Begin one: probewatch record start\n"
    )
    assert answers[0].stderr == answers[4].stderr == neither
    already = "probewatch: a stretch is being kept already. End it: probewatch record stop\n"
    assert answers[2].stderr == already


@pytest.mark.parametrize("viewer", [True, False])
def test_who_may_look_on_alone_marks_nothing(tmp_path: Path, viewer: bool) -> None:
    """Whatever group he is in: a stretch that is marked pushes kept alarms out."""
    viewers = [pwd.getpwuid(os.getuid()).pw_name] if viewer else []
    config = tmp_path / "probewatch.toml"
    recorder = f'[recorder]\nfolder = "{tmp_path / "boxes"}"\nsocket = "{tmp_path / "recorder"}"\n'
    config.write_text(f"{GOOD}[control]\nviewers = {json.dumps(viewers)}\n{recorder}")
    ended = threading.Event()
    with RecorderService(load_config(config), lambda _: None) as service:
        writing = threading.Thread(target=service.run, args=(ended.is_set,))
        writing.start()
        try:
            assert not ask(tmp_path / "recorder", "status")["marked"]
            if viewer:
                with pytest.raises(ControlRefused, match="may look on and request nothing"):
                    ask(tmp_path / "recorder", "start")
            else:
                ask(tmp_path / "recorder", "start")
            assert ask(tmp_path / "recorder", "status")["marked"] is not viewer
        finally:
            ended.set()
            writing.join()


def test_a_german_name_does_not_run_into_what_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    """It was "dieser Abschnittnicht markiert"."""
    _print({**ANSWER, "marked": False}, "de")
    assert "dieser Abschnitt nicht markiert" in capsys.readouterr().out.replace("  ", " ")
