"""What a service asks for while no motion can verify anything: a calibration, not a gesture."""

import re
from datetime import timedelta
from pathlib import Path

import pytest

from probewatch.appliance.core.quality.gesture import Gesture
from probewatch.appliance.service.control.status import alarm_fields
from probewatch.appliance.supervision.alarms import SIGNALS
from probewatch.appliance.supervision.languages import LANGUAGES, translated
from probewatch.appliance.types import AlarmState, State
from tests.appliance.service.test_daemon import moved
from tests.support.answers import answered
from tests.support.simulated_cart import SimulatedCart


class Uncalibrated(SimulatedCart):
    """Its configuration names no calibration."""

    def _write_files(self) -> None:
        super()._write_files()
        lines = self.config.read_text().splitlines(keepends=True)
        self.config.write_text("".join(line for line in lines if "calibration.file" not in line))


def test_a_cart_without_a_calibration_is_asked_for_one_not_for_a_gesture(tmp_path: Path) -> None:
    with Uncalibrated(tmp_path) as cart:
        status = cart.wait_for("not verified")
        with cart.served():
            shown = answered("status", "--socket", cart.socket)
        taken = tmp_path / "probe.toml"
        with cart.served():
            used = answered("calibration", "use", taken, "--yes", "--wait", 1, "--socket", cart.socket)
        asked = cart.status()
    assert status["gesture"] == []
    assert status["remedy"] == "Scan it: 'recalibrate --live --solve all'; or 'calibration use FILE'"
    assert shown.returncode == 3
    assert status["remedy"] in shown.stdout
    assert not re.search("probe (on|over) tissue", shown.stdout, re.IGNORECASE)
    assert "recalibrate --live --solve all" in status["reference_waits"]
    assert "of it is not shown yet" in used.stderr, "what is asked for is taken, and motion is next"
    assert asked["reference"]["number"] == 1
    assert len(asked["gesture"]) > 1


@pytest.mark.parametrize("restarted", [False, True])
def test_a_near_successor_of_a_first_calibration_that_nothing_has_shown_is_to_be_shown_wholly(
    tmp_path: Path, restarted: bool
) -> None:
    """The first calibration may be far from the truth, and so may one that is near it."""
    with Uncalibrated(tmp_path) as cart:
        cart.say("offset")
        cart.wait_for("not verified")
        with cart.client() as client:
            client.begin_recalibration()
            client.end_recalibration(tmp_path / "probe.toml")
        cart.run(1)
        first = cart.status()["reference"]
        if restarted:
            cart.end_daemon()
            cart.start_daemon()
            cart.run(1)
        with cart.client() as client:
            if cart.status()["state"] == "recalibrating":
                client.abort_recalibration()
            client.begin_recalibration()
            client.end_recalibration(moved(cart, tmp_path / "second.toml", 1))
        second = cart.status()["reference"]
        with cart.client() as client:
            client.abort_recalibration()
        last = cart.status()["reference"]
    assert (first["number"], first["verified_utc"], second["number"]) == (1, None, 2)
    assert "offset-elevational" in first["to_show"]
    assert second["to_show"] == last["to_show"] == first["to_show"], "nor is the first shown by going back to it"
    assert last["origin"] == ("went back to 1" if restarted else "recalibration")


def test_an_expired_calibration_is_to_be_renewed_not_to_be_moved(tmp_path: Path) -> None:
    with SimulatedCart(tmp_path, more='calibration.due_days = 30\ncalibration.overdue = "expires"\n') as cart:
        cart.monitoring()
        cart.utc += timedelta(days=31)
        status = cart.wait_for("not verified")
    assert (status["gesture"], status["remedy"]) == ([], "Calibration has expired: 'probewatch recalibrate --live'")


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_step_is_told_in_the_calm_state_alone(language: str) -> None:
    step = "Calibration has expired: 'probewatch recalibrate --live'"
    lost = AlarmState(State.DEVICE_LOST, 0, None, "", False, None)
    calm = AlarmState(State.NOT_VERIFIED, 0, None, "", False, None)
    wanted = (Gesture.PRESS,)
    assert alarm_fields(0, calm, language, wanted=wanted, next_step=step)["remedy"] == translated(step, language)
    assert alarm_fields(0, calm, language, wanted=wanted)["gesture"] == [translated(Gesture.PRESS.value, language)]
    assert "expired" not in alarm_fields(0, lost, language, next_step=step)["remedy"]


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_recalibration_asks_for_motion_once_it_has_taken_its_calibration(language: str) -> None:
    """It said "Finish the scan" to the end, and no motion."""
    alarm, wanted = AlarmState(State.RECALIBRATING, 0, None, "", False, None), (Gesture.PRESS,)
    scan, press = (translated(text, language) for text in (SIGNALS[State.RECALIBRATING].remedy, Gesture.PRESS.value))
    assert alarm_fields(0, alarm, language, wanted=wanted, scans=True)["remedy"] == scan
    assert alarm_fields(0, alarm, language, wanted=wanted)["remedy"].endswith(f"; {press}")
