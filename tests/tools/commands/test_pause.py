"""`probewatch pause`: what it takes for a time, and what it says of a sound that is off already."""

from pathlib import Path
from typing import Any

import pytest

from probewatch.appliance.service.control.server import Peer
from tests.support.answering import Answers, recorded
from tests.support.answers import answered


class _Granting(Answers):
    """A service that grants every pause. mode: of its sound. seconds: of each pause that was asked for."""

    def __init__(self, path: Path, mode: str = "paused") -> None:
        super().__init__(path)
        self._mode = mode
        self.seconds: list[float] = []

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        if do == "pause-audio":
            self.seconds.append(request["seconds"])
        audio = {"mode": self._mode, "left_s": None, "reason": "", "lamp_test": False}
        return {"status": recorded(audio=audio)} if do == "status" else {}


@pytest.mark.parametrize(
    ("typed", "seconds"), [(None, 120), ("30", 30), ("7.5", 7.5), ("30s", 30), ("1m", 60), ("2 min", 120), ("1.5M", 90)]
)
def test_a_time_is_taken_as_people_type_it(tmp_path: Path, typed: str | None, seconds: float) -> None:
    with _Granting(tmp_path / "control") as service:
        answer = answered("pause", *([] if typed is None else [typed]), "--socket", service.path)
    assert (answer.returncode, service.seconds) == (0, [seconds]), answer
    assert f"the alarm is silent for {seconds:g} s" in answer.stdout


@pytest.mark.parametrize("typed", ["0", "0.5", "121", "3m", "1h", "soon", "1e9", "nan", "m", ""])
def test_what_is_no_time_for_a_pause_is_told_with_what_is(tmp_path: Path, typed: str) -> None:
    answer = answered("pause", typed, "--socket", tmp_path / "control")
    said = f"'{typed}' is no time for a pause: 1 to 120 seconds, such as 30 or 1m. Longer: --off REASON"
    assert (answer.returncode, said in answer.stderr) == (2, True), answer


def test_a_pause_of_a_sound_that_is_off_does_not_claim_to_end(tmp_path: Path) -> None:
    with _Granting(tmp_path / "control", "off") as service:
        answer = answered("pause", "5", "--socket", service.path)
    assert answer.stdout.startswith(
        "the alarm sound is switched off already, and stays so until 'probewatch pause --on"
    )
    assert "5 s" not in answer.stdout


@pytest.mark.parametrize("other", [["--on"], ["--off", "service visit"]], ids=str)
def test_a_time_beside_what_takes_none_is_refused(tmp_path: Path, other: list[str]) -> None:
    with _Granting(tmp_path / "control") as service:
        answer = answered("pause", "30", *other, "--socket", service.path)
    assert (answer.returncode, service.seconds) == (2, [])
    assert f"SECONDS has no effect with {other[0]}; leave it out" in answer.stderr


class _Testing(Answers):
    """A service with a lamp that is lost."""

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        contact = recorded()["outputs"][0]
        lamps = [{**contact, "signal": "red", "energised": None}, {**contact, "signal": "green", "energised": True}]
        return {"status": recorded(outputs=[contact, *lamps], language="de")} if do == "status" else {}


def test_a_lamp_that_is_lost_is_told_among_those_that_must_light_up(tmp_path: Path) -> None:
    with _Testing(tmp_path / "control") as service:
        lamps = answered("lamp-test", "--socket", service.path).stdout.splitlines()[1:]
    assert [line.split()[0] for line in lamps] == ["red", "green"]
    assert [line.endswith("antwortet nicht") for line in lamps] == [True, False]
