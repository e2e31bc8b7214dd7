"""`probewatch calibration`: the history as a technician reads it, and what is refused."""

import io
import json
import os
import re
import signal
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from rich.console import Console

from probewatch.appliance.configuration.config import Config
from probewatch.appliance.service.control.server import Peer
from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.appliance.storage.calibration_file import parse_calibration, read_calibration, write_calibration
from probewatch.appliance.storage.reference_store import FOLDER, HISTORY, Entry, History, sha256_of, write_history
from probewatch.tools.commands.calibration import command as calibration_command
from probewatch.tools.commands.calibration import list_references
from probewatch.tools.shared.status_view import _origin
from tests.appliance.configuration.test_config import GOOD
from tests.support.answering import Answers, recorded
from tests.support.answers import answered
from tests.support.stores import PLUS, calibration, configuration, kept, log, place, settled, started, written

pytestmark = pytest.mark.usefixtures("log")
__all__ = ["log"]


@pytest.fixture
def config(tmp_path: Path) -> Config:
    """Two references: the configured one, verified, and one recalibrated 1.5 mm away in ζ."""
    config = configuration(tmp_path)
    references = started(config)
    references.note_verified()
    new = written(tmp_path / "new.toml", 0, 0, 1.5)
    references.take(references.from_content(new.read_bytes(), str(new)), "recalibration", "anna", "moved by 1.5 mm")
    settled(references)
    return config


@pytest.fixture
def said(monkeypatch, config):
    """Runs a subcommand on that history: (exit code, stdout, stderr)."""
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr("sys.stdin", io.StringIO())

    def run(*arguments: object) -> tuple[int, str, str]:
        words = [str(argument) for argument in arguments]
        where = [] if words[0] in ("use", "back") else ["--folder", str(config.alarm.folder)]
        answer = answered("calibration", *words, *where)
        assert "Traceback" not in answer.stderr
        return answer.returncode, answer.stdout, answer.stderr

    return run


def test_the_list_marks_what_is_in_force(said, config):
    code, out, _ = said("list")
    rows = [line.split() for line in out.splitlines() if "toml" in line]
    assert (code, rows[0][0], rows[1][:2]) == (0, "1", ["2", "▶"])
    assert "configuration" in rows[0]
    assert rows[1][-2:] == ["new.toml", kept(config).in_force.sha256[:12]]
    assert "no" in rows[1], "not verified yet"
    listed = json.loads(said("list", "--json")[1])
    assert [entry["number"] for entry in listed["entries"]] == [1, 2]


def test_one_is_shown_with_its_origin_and_its_content_can_be_had_again(said, tmp_path):
    code, out, _ = said("show")
    assert code == 0
    for part in ("2 (in force)", "recalibration", "anna", str(tmp_path / "new.toml"), "1.00, 2.00, 4.50 mm", "not yet"):
        assert part in out
    content = (tmp_path / "probe.toml").read_text()
    assert said("show", 1, "--content")[1] == content


def test_a_name_that_erases_its_line_shows_no_other_one_on_a_terminal(said, config):
    file = config.alarm.folder.parent / "signed.toml"
    forged = {
        "made_by": "A. Berg",
        "signed_by": "A. Berg\x1b[2K\rsigned by     O. Weiss\x1b[8m",
        "signed_role": "\u202ex",
    }
    write_calibration(file, read_calibration(config.alarm.folder.parent / "probe.toml"), forged)
    (config.alarm.folder / FOLDER / HISTORY).unlink()
    entry = kept_entry(file)
    write_history(config.alarm.folder, History(entries=(entry,)), {entry.sha256: file.read_bytes()})
    out = CliRunner().invoke(calibration_command, ["show", "--folder", str(config.alarm.folder)], color=True).output
    assert "signed by     A. Berg\ufffd[2K\ufffdsigned by     O. Weiss\ufffd[8m, \ufffdx" in out


def test_who_signed_it_and_when_it_is_due_are_shown(said, config):
    def shown(**stated: str) -> str:
        file = config.alarm.folder.parent / "signed.toml"
        calibration = read_calibration(config.alarm.folder.parent / "probe.toml")
        write_calibration(file, calibration, stated)
        (config.alarm.folder / FOLDER / HISTORY).unlink()
        entry = kept_entry(file)
        write_history(config.alarm.folder, History(entries=(entry,)), {entry.sha256: file.read_bytes()})
        code, out, _ = said("show")
        assert code == 0
        return re.sub(" +", " ", out)

    good = {
        "made_by": "Anna Berg",
        "signed_by": "Otto Weiss",
        "signed_role": "physicist",
        "when": "2026-01-01T08:00:00Z",
    }
    told = shown(**good, signed_at="2026-01-02T08:00:00+00:00", due="2199-05-01", expires="2199-06-01")
    for line in (
        "made by Anna Berg",
        "signed by Otto Weiss, physicist, 2026-01-02 08:00:00 UTC",
        "next check 2199-05-02 00:00 UTC",
        "expires 2199-06-02 00:00 UTC",
    ):
        assert line in told, line
    assert "!" not in told
    bare = shown()
    for line in ("made by not stated", "signed by nobody", "next check no date is set", "! it is not signed"):
        assert line in bare, line
    for stated, remark in (
        ({**good, "signed_by": "Name"}, "who signed it is 'Name': that is a placeholder"),
        ({**good, "made_by": "<TODO>"}, "who made it is '<TODO>': that is a placeholder"),
        ({**good, "signed_role": "..."}, "the signer's role is '...': that is a placeholder"),
        ({**good, "signed_by": "anna  berg"}, "signed by who made it"),
        ({**good, "signed_at": "2199-01-01T08:00:00Z"}, "signed on 2199-01-01 08:00 UTC, which lies in the future"),
        ({**good, "signed_at": "2025-01-01T08:00:00Z"}, "signed on 2025-01-01, before it was made on 2026-01-01"),
        ({**good, "signed_at": "yesterday"}, "'yesterday', no time"),
        ({**good, "due": "2026-02-01"}, "it is due since 2026-02-02"),
        ({**good, "due": "soon"}, "'due' is 'soon', no day"),
    ):
        assert "! " in (told := shown(**stated)), stated
        assert remark in told, remark


def kept_entry(file: Path) -> Entry:
    made_of = {"file": str(file), "sha256": sha256_of(file.read_bytes()), "image_size_px": (640, 480)}
    utc = "2026-01-03T08:00:00+00:00"
    return Entry(number=1, origin="configuration", utc=utc, software="1", probe="Probe", simulated=False, **made_of)


@pytest.mark.parametrize("columns", [60, 80, 120])
def test_the_list_fits_the_terminal(config, columns: int) -> None:
    """File and SHA-256 were torn into columns of a few letters."""
    out = io.StringIO()
    console = Console(file=out, width=columns, force_terminal=True, color_system=None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("probewatch.tools.commands.calibration.Console", lambda **_: console)
        list_references.main(["--folder", str(config.alarm.folder)], standalone_mode=False)
    assert max(map(len, out.getvalue().splitlines())) <= columns
    assert kept(config).in_force.sha256[:12] in out.getvalue()
    assert "new.toml" in out.getvalue()


def test_two_are_compared_by_number_or_file(said, tmp_path):
    _, out, _ = said("diff", 1, 2)
    assert "1.50 mm (lateral +0.00, axial +0.00, ζ +1.50)" in out
    assert "+0.00 % lateral" in out
    assert "beyond" not in out
    far = written(tmp_path / "far.toml", 0, -30, 0)
    assert "a person must accept it before a service uses it" in said("diff", 2, far)[1]
    change = json.loads(said("diff", far, 1, "--json")[1])
    assert change["offset_along_mm"] == [0.0, 30.0, 0.0]


def test_what_a_person_must_accept_is_by_the_limits_of_the_cart(config, tmp_path, monkeypatch):
    """1.5 mm: within the shipped 4 mm, beyond the 1 mm of this cart."""
    numbers = [1, 2, "--folder", config.alarm.folder]
    assert "beyond" not in answered("calibration", "diff", *numbers).stdout
    assert not json.loads(answered("calibration", "diff", *numbers, "--json").stdout)["beyond_limits"]
    cart = tmp_path / "cart.toml"
    cart.write_text(f"{GOOD}[limits]\noffset_mm = 1.0\n")
    told = answered("calibration", "diff", *numbers, "--config", cart)
    assert "beyond the limits of the checks of the cart: a person must accept it before" in told.stdout, told.stderr
    assert json.loads(answered("calibration", "diff", *numbers, "--config", cart, "--json").stdout)["beyond_limits"]


def test_a_device_set_is_compared_for_the_pictures_of_the_other(said, tmp_path):
    device_set = tmp_path / "set.xml"
    device_set.write_text(PLUS)
    read = parse_calibration(PLUS.encode(), device_set, (640, 480))
    change = json.loads(said("diff", device_set, 1, "--json")[1])
    assert change["size_taken_from_the_other"] == str(device_set)
    assert f"{device_set} states no picture size: " in said("diff", device_set, 1)[1]
    assert "states no picture size" not in said("diff", 1, 1)[1]
    assert change["same_image_size"]
    assert change["offset_along_mm"] == pytest.approx(
        [1 - read.offset_mm[0], 2 - read.offset_mm[1], 3 - read.offset_mm[2]]
    )


def test_what_there_is_not_is_refused(said, tmp_path):
    assert "there are 1 to 2" in said("show", 3)[2]
    assert "none.toml: cannot be read" in said("diff", 1, tmp_path / "none.toml")[2]
    assert "no service answers" in said("back", 1, "--socket", tmp_path / "control")[2]
    assert "no service answers" in said("use", tmp_path / "new.toml", "--socket", tmp_path / "control")[2]


def test_a_damaged_history_is_named_and_can_be_set_aside(said, config, tmp_path):
    (place(config) / HISTORY).write_text("[]")
    code, _, err = said("list")
    assert (code, err.count("\\n")) == (78, 0)
    assert "history.json: cannot be understood" in err
    code, _, err = said("reset", "--socket", tmp_path / "control")
    assert (code, "Give --yes to accept it" in err) == (75, True), "nobody could be asked"
    code, out, _ = said("reset", "--yes", "--socket", tmp_path / "control")
    assert (code, "kept as" in out) == (0, True)
    assert "holds no reference yet" in said("list")[2]
    assert settled(started(config)).current.entry.origin == "configuration"


def test_the_alarm_log_tells_a_start_and_a_change_in_a_line(config):
    reference = kept(config).in_force.model_dump(mode="json")
    started_with = {"software": "1.2.3", "configuration": {"file": "/etc/x.toml", "sha256": "ab" * 32}}
    log = AlarmLog(config.alarm.folder)
    now = datetime.now(UTC)
    log.append(now, 1, "started", {**started_with, "reference": reference, "simulated": ["sim:/x"], "found": []}, None)
    log.append(now, 2, "reference", {"reference": {**reference, "number": 3}}, None)
    lines = answered("log", config.alarm.folder).stdout.splitlines()
    start, change = [line for line in lines if "SHA-256" in line]
    told = f"recalibration, {reference['file']}, SHA-256 {reference['sha256'][:12]} by anna, moved by 1.5 mm"
    assert start.endswith(
        f"started: probewatch 1.2.3 · configuration abababababab · reference 2, {told} · SIMULATED: sim:/x"
    )
    assert change.endswith(f"reference: reference 3, {told}")


def test_the_status_names_the_reference_and_what_is_not_in_force(config):
    reference = kept(config).in_force.model_dump(mode="json")
    console = Console(file=io.StringIO(), width=100)
    for line in _origin({"reference": {**reference, "simulated": True}, "calibration_changed": "x was changed"}):
        console.print(line)
    first, second = console.file.getvalue().splitlines()
    assert first.startswith(
        f"reference 2 · recalibration, SIMULATED · new.toml · {reference['sha256'][:12]} · since 20"
    )
    assert second == "! x was changed"


class Interrupted(Answers):
    """A service in whose answer to `at` somebody presses Ctrl-C before the command: of each kind the last is meant.

    numbers: of the reference, and what its content is, as a real one changes them.
    """

    def __init__(self, path: Path, at: str) -> None:
        super().__init__(path)
        self._at, self.number, self.sha256, self.state = at, 1, "before", "monitoring"

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        if do == "begin-recalibration":
            self.state = "recalibrating"
        elif do == "end-recalibration":
            self.number, self.sha256 = 2, "new"
        elif do == "abort-recalibration":
            self.state = "not verified"
            if self.sha256 == "new":
                self.number, self.sha256 = 3, "before"
        if do == self._at or (self._at == "proof" and do == "status" and self.number == 2):
            self._at = ""
            os.kill(os.getpid(), signal.SIGINT)
        reference = {**recorded()["reference"], "number": self.number, "sha256": self.sha256}
        proposal = {"text": "hardly", "confirm": False, "sha256": "new"}
        return {"status": recorded(state=self.state, reference=reference), "proposal": proposal}


def test_a_reset_that_is_declined_says_that_nothing_was_changed(
    monkeypatch: pytest.MonkeyPatch, config: Config, tmp_path: Path
) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr("sys.stdin", Terminal("n\n"))
    where = ("--folder", config.alarm.folder, "--socket", tmp_path / "control")
    shown = answered("calibration", "reset", *where)
    assert (shown.returncode, shown.stderr) == (130, "probewatch: stopped: nothing was changed\n")


@pytest.mark.parametrize("content", [None, "", "scale = 1\n"])
def test_a_file_that_no_service_could_use_ends_with_78_and_none_is_asked(tmp_path: Path, content: str | None) -> None:
    file = tmp_path / "new.toml"
    if content is not None:
        file.write_text(content)
    with Interrupted(tmp_path / "control", "nothing") as service:
        answer = answered("calibration", "use", file, "--yes", "--socket", service.path)
    assert (answer.returncode, str(file) in answer.stderr) == (78, True), answer
    assert service.number == 1


def test_a_number_is_no_file_and_the_command_for_it_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    answer = answered("calibration", "use", 2, "--yes", "--socket", tmp_path / "nobody")
    assert (answer.returncode, "probewatch calibration back 2" in answer.stderr) == (78, True), answer


def test_a_cart_before_its_first_calibration_is_told_how_to_get_one(tmp_path: Path) -> None:
    answer = answered("calibration", "list", "--folder", tmp_path)
    assert (answer.returncode, "recalibrate --live --solve all" in answer.stderr) == (78, True)


@pytest.mark.parametrize("name", ["a.xml", "a.TFM", "a.h5"])
def test_our_file_is_not_written_under_the_name_of_another_program(tmp_path: Path, name: str) -> None:
    """PLUS and 3D Slicer would be given TOML."""
    (device_set := tmp_path / "set.xml").write_text(PLUS)
    (scan := tmp_path / "scan.igs.mha").write_bytes(b"")
    to = tmp_path / name
    for words in (
        ("calibration", "import", device_set, "--image-size", 640, 480, "--output", to),
        ("calibration", "recover", "--output", to, "--socket", tmp_path / "nobody"),
        ("recalibrate", "--simulated", "--duration", 1, "--output", to),
        ("replay", scan, "--calibration", device_set, "--estimate", to),
    ):
        answer = answered(*words)
        assert (answer.returncode, "is TOML, not ." in answer.stderr) == (78, True), (words, answer)
        assert not to.exists()


def test_a_calibration_of_ours_is_not_imported(tmp_path: Path) -> None:
    """It asked for the size of the pictures, and dropped signature, due date and covariance."""
    write_calibration(file := tmp_path / "a.toml", calibration(), {"due": "2999-01-01"})
    answer = answered("calibration", "import", file, "--output", tmp_path / "b.toml")
    said = f"{file}: is a calibration of probewatch already. Give it to the service: probewatch calibration use {file}"
    assert (answer.returncode, answer.stderr) == (78, f"probewatch: {said}\n")
