"""What a person is told while the service verifies a new reference."""

from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from probewatch.appliance.service.control.server import ControlRefused, Peer
from probewatch.appliance.supervision.languages import translated_text
from probewatch.appliance.types import State
from probewatch.tools.commands import calibration
from probewatch.tools.shared.verification import ask, motions_for, waits_for, with_motions
from tests.support.answering import Answers, recorded

WAITING = {"state": State.RECALIBRATING.value, "reason": "Recalibrating", "missing": ["scale-axial", "latency"]}


def status(**fields: Any) -> dict[str, Any]:
    return recorded(**{"reference_waits": None, **WAITING, **fields})


def test_what_no_motion_has_shown_yet_is_named_in_each_language() -> None:
    assert waits_for(status()) == "not shown yet: scale-axial, latency"
    assert translated_text(waits_for(status()), "de") == "noch nicht gezeigt: Maßstab axial, Verzögerung"


def test_what_keeps_motion_from_showing_anything_is_named_before_that() -> None:
    empty = status()
    for check in empty["checks"]:
        if check["name"] == "no-picture":
            check["verdict"], check["value"] = "NOT_VERIFIED", 1.0
    assert waits_for(empty) == "No ultrasound in the picture"


def test_what_the_service_says_itself_goes_before() -> None:
    assert waits_for(status(reference_waits="it is not on the disk yet")) == "it is not on the disk yet"
    assert waits_for(status(reason="Alarm output does not respond")) == "Alarm output does not respond"
    assert waits_for(status(missing=[])) == "Recalibrating"


class _Unverified(Answers):
    """A service that takes every reference and never verifies one. status: what it says."""

    def __init__(self, path: Path, said: dict[str, Any] | None = None) -> None:
        super().__init__(path)
        self._said = said or status()

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        proposal = {"text": "nothing", "confirm": False, "sha256": "new"}
        return {"status": {"status": self._said}, "propose-calibration": {"proposal": proposal}}.get(do, {})


@pytest.mark.parametrize("command", ["use", "back"])
def test_a_wait_that_ends_in_vain_says_what_was_missing(tmp_path: Path, command: str) -> None:
    wanted = str(Path(__file__).parents[3] / "config" / "calibration.toml") if command == "use" else "1"
    with _Unverified(tmp_path / "control") as service:
        words = [command, wanted, "--socket", str(service.path), "--wait", "1"]
        refusal = CliRunner().invoke(calibration.command, words).exception
    assert "not verified within 1 s: not shown yet: scale-axial, latency. The contact stays open" in str(refusal)
    motions = "slide it sideways, 10 mm to and fro; press and release quickly, 6 mm"
    assert f"to show it, on tissue: {motions}" in str(refusal), "not any motion: the one that is missing"


@pytest.mark.parametrize(("language", "told"), [("en", "rock it in the"), ("de", "in der Bildebene wippen")])
def test_a_wait_in_vain_names_the_motion_and_the_way_back(tmp_path: Path, language: str, told: str) -> None:
    """It said to move the probe over tissue, whatever was missing, and not how the cart works again."""
    waits = "it is far from the one before, and of it is not shown yet: offset-axial"
    given = status(language=language, reference_waits=waits, reference={"number": 5, "sha256": "ab"})
    with _Unverified(tmp_path / "control", given) as service:
        words = ["back", "1", "--socket", str(service.path), "--wait", "1"]
        refusal = str(CliRunner().invoke(calibration.command, words).exception)
    assert told in refusal
    assert refusal.endswith("probewatch calibration back 4")


def test_a_question_that_nobody_can_answer_is_refused_in_one_language() -> None:
    """It was a German question with an English reason, and the question ran into it."""
    with pytest.raises(ControlRefused) as refused:
        ask("Das annehmen?", False, "de")
    assert str(refused.value) == (
        "'Das annehmen?': das muss ein Mensch annehmen; nichts wurde geändert. Mit --yes annehmen"
    )


def test_nothing_is_asked_for_where_no_parameter_is_missing() -> None:
    assert motions_for("No ultrasound in the picture") == ""
    assert with_motions("No ultrasound in the picture", "de") == "Kein Ultraschall im Bild"


class _Declining(Answers):
    """A service that begins a recalibration and declines what it is given. reference: in force."""

    def __init__(self, path: Path, reference: dict[str, Any] | None) -> None:
        super().__init__(path)
        self._reference = reference

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        if do == "end-recalibration":
            raise ControlRefused("the disk is full")
        proposal = {"text": "nothing", "confirm": False, "sha256": "new"}
        told = {"status": {"status": status(reference=self._reference)}, "propose-calibration": {"proposal": proposal}}
        return told.get(do, {})


@pytest.mark.parametrize(
    ("reference", "said"),
    [
        (recorded()["reference"] | {"number": 4}, "reference 4 is in force, as before; the contact closes once motion"),
        (None, "there is no calibration, as before"),
    ],
)
def test_what_is_declined_after_the_contact_opened_says_what_is_in_force(
    tmp_path: Path, reference: dict[str, Any] | None, said: str
) -> None:
    with _Declining(tmp_path / "control", reference) as service:
        result = CliRunner().invoke(calibration.command, ["back", "1", "--socket", str(service.path)])
    assert (said in result.stderr, "the disk is full" in str(result.exception)) == (True, True), result.output


class _Halted(_Unverified):
    """A service that falls back to halt once a recalibration has begun, as where the tracker reports a fault."""

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        if do == "end-recalibration":
            raise ControlRefused("not possible while halt")
        return super()._answer(do, request, who)


@pytest.mark.parametrize(
    ("language", "said"),
    [
        ("en", "not possible while halt. What stands in its way: probewatch status"),
        ("de", "nicht möglich während eines Halts. Was im Wege steht: probewatch status"),
    ],
)
def test_what_the_state_does_not_allow_names_where_its_cause_is_told(tmp_path: Path, language: str, said: str) -> None:
    """It was "not possible while halt" and no more, in English."""
    with _Halted(tmp_path / "control", status(language=language)) as service:
        result = CliRunner().invoke(calibration.command, ["back", "1", "--socket", str(service.path)])
    assert said in str(result.exception)
