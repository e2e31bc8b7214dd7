"""`probewatch ack`: what it says where there was nothing to acknowledge."""

from pathlib import Path
from typing import Any

import pytest

from probewatch.appliance.service.control.server import ControlRefused, Peer
from probewatch.appliance.supervision.alarms import ACKNOWLEDGED
from tests.support.answering import Answers, recorded
from tests.support.answers import answered


class _Refusing(Answers):
    """A service that grants no acknowledgement. why: as its supervisor says it."""

    def __init__(self, path: Path, why: str, changes: dict[str, Any] | None = None) -> None:
        super().__init__(path)
        self._why, self.changes = why, {} if changes is None else changes

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        if do == "status":
            return {"status": recorded(**self.changes)}
        raise ControlRefused(self._why)


@pytest.mark.parametrize(
    ("why", "said"),
    [
        ("not possible while not verified", "there is nothing to acknowledge: not possible while not verified"),
        (ACKNOWLEDGED, f"probewatch: already {ACKNOWLEDGED}"),
    ],
)
def test_a_person_is_told_whether_there_is_anything_to_acknowledge(tmp_path: Path, why: str, said: str) -> None:
    with _Refusing(tmp_path / "control", why) as service:
        answer = answered("ack", "--socket", service.path)
    assert (answer.returncode, said in answer.stderr) == (75, True), answer


@pytest.mark.parametrize(("language", "ends"), [("en", "silent until then"), ("de", "bis dahin stumm")])
def test_of_an_alarm_that_cannot_be_acknowledged_it_names_how_to_silence_it(
    tmp_path: Path, language: str, ends: str
) -> None:
    """A lost device sounds until it is back; `ack` used to say only that there is nothing to acknowledge."""
    lost = {"language": language, "state": "device lost", "priority": "high"}
    with _Refusing(tmp_path / "control", "not possible while device lost", lost) as service:
        answer = answered("ack", "--socket", service.path)
        service.changes |= {"audio": recorded()["audio"] | {"mode": "paused"}}
        silent = answered("ack", "--socket", service.path)
    assert answer.stderr.endswith(f"; {ends}: probewatch pause\n")
    assert "probewatch pause" not in silent.stderr


class _Granting(Answers):
    """A service that grants what it is asked for. changes: of its status."""

    def __init__(self, path: Path, **changes: Any) -> None:
        super().__init__(path)
        self._changes = changes

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        if do == "status":
            return {"status": recorded(**self._changes)}
        return {"acknowledged": "halt: polarity +1 axes, limit 0.5 axes"} if do == "acknowledge" else {}


def test_that_a_sensor_was_checked_claims_no_bump_that_nobody_has_seen(tmp_path: Path) -> None:
    """The service does not say whether there was one."""
    with _Granting(tmp_path / "control") as service:
        answer = answered("ack", "--bump", "--socket", service.path)
    assert answer.returncode == 0, answer
    assert answer.stdout.startswith("recorded: the tracker's position sensor was checked; an alert of a bump, if")


def test_of_an_expired_calibration_it_does_not_ask_for_motion(tmp_path: Path) -> None:
    """Motion cannot verify it."""
    why = "it has expired since 2026-01-02 00:00 UTC"
    for dated in (dict.fromkeys(("reference_overdue", "reference_waits"), why), {"reference_overdue": why}):
        with _Granting(tmp_path / "control", latched="halt", acknowledged=True, **dated) as service:
            last = answered("ack", "--socket", service.path).stdout.splitlines()[-1]
        assert ("move the probe" in last) is ("reference_waits" not in dated)


def german(path: Path, **changes: Any) -> _Granting:
    return _Granting(path, language="de", **changes)


def test_a_german_cart_answers_in_german(tmp_path: Path) -> None:
    """ack, lamp-test and pause answered in English beside a German status."""
    halted = {"state": "halt", "reason": "polarity +1 axes, limit 0.5 axes", "latched": "halt", "acknowledged": True}
    with german(tmp_path / "control", **halted) as service:
        answer = answered("ack", "--socket", service.path)
        bump = answered("ack", "--bump", "--socket", service.path)
        lamps = answered("lamp-test", "--socket", service.path)
        paused = answered("pause", "30", "--socket", service.path)
    assert answer.stdout == (
        "quittiert · Halt: Spiegelung +1 Achsen, Grenze 0.5 Achsen\n"
        "jetzt · Halt: Spiegelung +1 Achsen, Grenze 0.5 Achsen\n"
        "er endet, sobald die Kalibrierung wieder bestätigt ist: Sonde über Gewebe bewegen, oder neu kalibrieren\n"
    )
    assert bump.stdout.startswith("vermerkt: der Positionssensor")
    assert lamps.stdout.startswith(("fünf Sekunden lang", "dieser Dienst hat weder"))
    assert paused.stdout.startswith("der Alarm ist 30 s lang stumm")


@pytest.mark.parametrize(
    ("why", "said"),
    [
        ("not possible while not verified", "es gibt nichts zu quittieren: nicht möglich im Zustand nicht bestätigt"),
        (ACKNOWLEDGED, "schon quittiert; er endet, sobald die Kalibrierung wieder bestätigt ist"),
    ],
)
def test_a_german_cart_refuses_in_german(tmp_path: Path, why: str, said: str) -> None:
    with _Refusing(tmp_path / "control", why, {"language": "de"}) as service:
        answer = answered("ack", "--socket", service.path)
    assert (answer.returncode, answer.stderr) == (75, f"probewatch: {said}\n")
