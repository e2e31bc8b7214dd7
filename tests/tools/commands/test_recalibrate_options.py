"""Options and answers of `probewatch recalibrate`: what goes with no scan, or could not be signed at its end."""

import io
from datetime import date
from pathlib import Path

import pytest

from probewatch.tools.recalibration.paperwork import Begin, Signature, sign_off
from probewatch.tools.recalibration.terminal import words
from tests.support.answering import Answering
from tests.support.answers import answered


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--output", "new.toml"), "--output has no effect with --live"),
        (("--sigma-mm", "0.2"), "--sigma-mm has no effect with --live"),
        (("--check-point", "1", "2", "3"), "--check-point has no effect with --live"),
        (("--solve", "offset"), "--live solves zeta or all"),
        (("--signed-by", "B. Stone", "--role", "physicist"), "give --probe and --preset, too"),
        (("--signed-by", "B. Stone", "--probe", "L12", "--preset", "4 cm"), "name and role of the second person"),
        (("--signed-by", "B. Stone", "--role", " ", "--probe", "L12", "--preset", "4 cm"), "name and role"),
        (
            ("--made-by", "B. Stone", "--signed-by", "b. stone", "--role", "x", "--probe", "L12", "--preset", "4 cm"),
            "made it and cannot sign it as well",
        ),
        (("--due", "2027-05-01", "--expires", "2027-04-01"), "before it is due"),
    ],
)
def test_a_live_scan_that_could_not_be_signed_or_as_asked_is_refused_before_the_service_is(
    tmp_path: Path, arguments: tuple[str, ...], said: str
) -> None:
    answer = answered("recalibrate", "--live", "--socket", tmp_path / "nobody", *arguments)
    assert answer.returncode in (2, 75, 78), answer
    assert said in " ".join(answer.stderr.split()), answer


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--recording", "scan.igs.mha", "--seed", "3"), "--seed has no effect with --recording"),
        (("--recording", "scan.igs.mha", "--latency-first"), "--latency-first has no effect with --recording"),
        (("--simulated", "--orientation", "MF"), "--orientation has no effect with --simulated"),
        (("--simulated", "--folder", "."), "--folder has no effect with --simulated"),
    ],
)
def test_an_option_of_another_kind_of_scan_is_refused(arguments: tuple[str, ...], said: str) -> None:
    answer = answered("recalibrate", *arguments)
    assert (answer.returncode, said in " ".join(answer.stderr.split())) == (2, True), answer


def test_a_live_scan_without_anybody_at_a_terminal_says_what_to_give(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())
    with Answering(tmp_path / "control"):
        answer = answered("recalibrate", "--live", "--socket", tmp_path / "control", "--folder", tmp_path)
    assert (answer.returncode, "there is no terminal to ask at. Give --probe" in answer.stderr) == (130, True), answer


def test_the_days_of_a_live_scan_stand_in_its_record() -> None:
    begun = Begin("L12", "4 cm", "A. Smith", due=date(2027, 5, 1), expires=date(2028, 5, 1))
    fields = sign_off(begun, Signature("B. Stone", "physicist")).fields()
    assert (fields["due"], fields["expires"]) == ("2027-05-01", "2028-05-01")


def test_a_blank_answer_of_a_person_is_asked_for_again(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    """A role of spaces was refused after the comment, and everything was typed again."""
    monkeypatch.setattr("sys.stdin", io.StringIO("  \n B. Stone \n"))
    assert words("name of the second person") == "B. Stone"
    assert "other than spaces" in capsys.readouterr().out


def test_who_recalibrates_already_is_told_before_anybody_is_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("click.prompt", lambda *_, **__: pytest.fail("asked, though somebody else recalibrates"))
    with Answering(tmp_path / "control") as service:
        service.changes = {
            "recalibration": {"who": "ann, process 7", "yours": False, "since_s": 8.2, "hold_s": 20.0, "ended": None}
        }
        answer = answered("recalibrate", "--live", "--socket", service.path, "--folder", tmp_path)
    assert (answer.returncode, "ann, process 7 has recalibrated for 8 s. Wait" in answer.stderr) == (75, True), answer


@pytest.mark.parametrize("state", ["device lost", "self-test", "internal fault"])
def test_a_state_in_which_nothing_is_scanned_is_told_before_anybody_is_asked(
    state: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Probe, depth and name were asked for first, and the refusal named neither what is wrong nor what to do."""
    monkeypatch.setattr("click.prompt", lambda *_, **__: pytest.fail("asked, though nothing can be scanned"))
    with Answering(tmp_path / "control") as service:
        service.changes = {"state": state, "reason": "No answer from the tracker", "remedy": "Check its cable"}
        answer = answered("recalibrate", "--live", "--socket", service.path, "--folder", tmp_path)
        service.changes |= {"language": "de", "remedy": "Sein Kabel prüfen"}
        german = answered("recalibrate", "--live", "--socket", service.path, "--folder", tmp_path)
    assert answer.returncode == german.returncode == 75
    assert f"not possible while {state}: No answer from the tracker. Check its cable" in answer.stderr
    assert ": Tracker antwortet nicht. Sein Kabel prüfen" in german.stderr
    assert "nicht möglich" in german.stderr


@pytest.mark.parametrize(
    ("language", "said"),
    [
        ("en", "depths appear 3.9 % too deep; 1.5 % is the most. Warm the water"),
        ("de", "Tiefen erscheinen 3.9 % zu tief; 1.5 % sind erlaubt. Das Wasser auf 48 °C erwärmen"),
    ],
)
def test_water_that_does_not_serve_is_told_before_anybody_is_asked(
    language: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Probe, depth and name were asked for first, and a German cart refused in English."""
    monkeypatch.setattr("click.prompt", lambda *_, **__: pytest.fail("asked, though the water does not serve"))
    with Answering(tmp_path / "control") as service:
        service.changes = {"language": language, "recalibration": None}
        given = ("--live", "--socket", service.path, "--folder", tmp_path, "--water-c", "20")
        answer = answered("recalibrate", *given)
    assert (answer.returncode, said in answer.stderr) == (75, True), answer
