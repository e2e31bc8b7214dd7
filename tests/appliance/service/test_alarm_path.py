"""The whole service in simulated time: what latches stays latched, what is written survives, what a person may do."""

import json
import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.storage.alarm_chain import MEMORY, read_log
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.twins.relay_board import RelayBoard
from tests.support.answers import Answer, answered
from tests.support.boards import running_board
from tests.support.manual_clock import TimelessClock
from tests.support.simulated_cart import SimulatedCart

ALARM_S = 2.0


def restart(cart: SimulatedCart) -> None:
    """SIGKILL, as when the power goes, and start again."""
    cart.kill_daemon()
    cart.start_daemon()


@pytest.mark.parametrize("state", ["halt", "recalibration requested"])
def test_a_latched_state_outlives_the_process_and_needs_a_person(monitoring: SimulatedCart, state: str) -> None:
    monitoring.say("scale")
    monitoring.wait_for(state)
    assert read_log(monitoring.alarms).entries[-1].latch
    restart(monitoring)
    latched = monitoring.status()
    assert latched["latched"] in {"halt", "recalibration requested"}
    assert (latched["fault"], latched["energised"], latched["acknowledged"]) == ("scale", False, False)
    monitoring.say(None)
    monitoring.until(lambda: monitoring.status().get("verdict") == "OK")
    monitoring.run(10)
    assert monitoring.status()["latched"] is not None, "verification alone frees nothing"
    assert monitoring.acknowledge()
    monitoring.wait_for("monitoring")


def test_a_second_service_on_the_same_folder_takes_no_latch_away(monitoring: SimulatedCart, tmp_path: Path) -> None:
    """As one that was started by hand with another socket: it was acknowledged there, and the first one then forgot."""

    class Beside(SimulatedCart):
        @property
        def alarms(self) -> Path:
            return monitoring.alarms

    monitoring.say("scale")
    monitoring.wait_for("halt")
    before = monitoring.until(lambda: not monitoring.status()["log"]["waiting"] and monitoring.status()["log"])
    beside = tmp_path / "beside"
    beside.mkdir()
    with pytest.raises(DeviceLost, match="another probewatch service keeps its alarm log there"):
        Beside(beside).__enter__()
    assert len(read_log(monitoring.alarms).entries) == before["entries"]
    monitoring.say(None)
    restart(monitoring)
    assert monitoring.status()["latched"] == "halt"


def test_acknowledging_while_the_cause_stands_waits_for_the_verification(monitoring: SimulatedCart) -> None:
    monitoring.say("scale")
    monitoring.wait_for("recalibration requested")
    with monitoring.client() as client:
        client.acknowledge()
        with pytest.raises(ControlRefused, match="verified again"):
            client.acknowledge()
    assert monitoring.status()["audio"]["mode"] == "acknowledged"
    monitoring.say(None)
    monitoring.wait_for("monitoring")


@contextmanager
def full_disk() -> Iterator[None]:
    """A file size limit of zero: every write to a file fails, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_takes_no_alarm_away_and_loses_no_entry(monitoring: SimulatedCart) -> None:
    written = len(read_log(monitoring.alarms).entries)
    began_s = monitoring.now_s()
    with full_disk():
        monitoring.say("scale")
        monitoring.open_contact(began_s, ALARM_S)
        monitoring.wait_for("halt")
        monitoring.until(lambda: monitoring.status()["notices"])
        assert monitoring.status()["log"]["failing"]
    monitoring.say(None)
    assert monitoring.acknowledge()
    monitoring.wait_for("monitoring")
    monitoring.until(lambda: monitoring.status()["log"]["waiting"] == 0)
    reading = read_log(monitoring.alarms)
    assert reading.damages == ()
    states = [entry.data["state"] for entry in reading.entries[written:] if entry.event == "state"]
    assert {"warning", "halt"} <= set(states), "what happened meanwhile is in the log"
    assert states[-1] == "monitoring"
    assert monitoring.status()["notices"] == []


def test_a_changed_configuration_is_taken_or_refused_whole(monitoring: SimulatedCart) -> None:
    text = monitoring.config.read_text()
    with monitoring.client() as client:
        monitoring.config.write_text(text + "limits.scale_procent = 3\n")
        with pytest.raises(ControlRefused, match="scale_percent"):
            client.reload()
        monitoring.config.write_text(text.replace("deadline_ms=250", "deadline_ms=251"))
        with pytest.raises(ControlRefused, match=r"\[tracker\]"):
            client.reload()
        monitoring.config.write_text(text + 'alarm.language = "de"\n')
        monitoring.daemon.reload_soon()  # as SIGHUP does
        monitoring.tick()
        assert monitoring.status()["text"] == "SIMULIERT · Kalibrierung bestätigt"
        assert read_log(monitoring.alarms).entries[-1].event == "reloaded"
        monitoring.config.write_text(text)
        client.reload()
    assert monitoring.status()["text"] == "SIMULATED · Calibration verified"


def test_a_proposed_calibration_is_compared_and_nothing_changes(monitoring: SimulatedCart) -> None:
    with monitoring.client() as client:
        same = client.propose_calibration(monitoring.folder / "probe.toml")
        with pytest.raises(ControlRefused, match=r"none\.toml"):
            client.propose_calibration(monitoring.folder / "none.toml")
    assert same["rotation_deg"] == pytest.approx(0, abs=1e-6)
    assert (same["offset_mm"], same["same_polarity"]) == (0, True)
    assert monitoring.status()["state"] == "monitoring"


def test_a_tick_that_comes_a_second_late_is_counted_and_holds_no_lock_on_the_recovery(
    monitoring: SimulatedCart,
) -> None:
    """The output opens by itself meanwhile."""
    began_s, before = monitoring.now_s(), monitoring.status()["counters"]["late_ticks"]
    monitoring.lateness_s = 1.0
    monitoring.tick()
    monitoring.tick()
    monitoring.lateness_s = 0.0
    monitoring.wait_for("monitoring")
    (opened_s, _), (closed_s, closed) = monitoring.switched(began_s)
    assert opened_s - began_s <= 0.35, "a tick, and the life of a command"
    assert closed
    assert closed_s - began_s > 1.0
    assert monitoring.status()["counters"]["late_ticks"] >= before + 1


def told(cart: SimulatedCart, *words: str) -> Answer:
    with cart.served():
        return answered(*words, "--socket", cart.socket)


def test_the_operators_commands(monitoring: SimulatedCart) -> None:
    shown = told(monitoring, "status")
    assert shown.returncode == 0
    assert all(part in shown.stdout for part in ("MONITORING", "contact closed (safe)", "video presence"))
    assert json.loads(told(monitoring, "status", "--json").stdout)["state"] == "monitoring"
    refused = told(monitoring, "ack")
    assert (refused.returncode, "not possible while monitoring" in refused.stderr) == (75, True)
    assert "silent for 30 s; this cart has no tone output" in told(monitoring, "pause", "30").stdout
    assert monitoring.status()["audio"]["mode"] == "paused"
    assert told(monitoring, "pause", "121").returncode == 2
    assert told(monitoring, "pause", "--off", " ").returncode == 75
    assert "until 'probewatch pause --on'" in told(monitoring, "pause", "--off", "room empty").stdout
    assert monitoring.status()["audio"]["reason"] == "room empty"
    assert "is on again" in told(monitoring, "pause", "--on").stdout
    assert monitoring.status()["audio"]["mode"] == "on"
    assert "no lamp and no tone" in told(monitoring, "lamp-test").stdout
    monitoring.say("scale")
    monitoring.wait_for("halt")
    assert told(monitoring, "status").returncode == 1
    assert "acknowledged · " in told(monitoring, "ack").stdout
    monitoring.say(None)
    monitoring.wait_for("monitoring")
    noted = [entry.data["do"] for entry in read_log(monitoring.alarms).entries if entry.event == "request"]
    assert {"pause-audio", "audio-off", "audio-on", "lamp-test", "acknowledge"} <= set(noted)


def test_a_pause_of_the_sound_ends_by_itself(monitoring: SimulatedCart) -> None:
    with monitoring.client() as client:
        client.pause_audio(30)
        monitoring.run(29)
        assert client.status()["audio"]["mode"] == "paused"
        monitoring.run(2)
        assert client.status()["audio"]["mode"] == "on"


class Changes:
    """What a second board has told. contacts: channel → closed."""

    board: RelayBoard

    def __init__(self, cart: SimulatedCart) -> None:
        self._cart, self._all = cart, list[dict[str, int | bool]]()

    def __call__(self, change: dict[str, int | bool]) -> None:
        self._all.append(change)

    @property
    def contacts(self) -> dict[int, bool]:
        return {int(one["channel"]): bool(one["energised"]) for one in self._all}

    def during(self, channel: int, seconds: float) -> int:
        """How often a contact moves from now on."""
        began = len(self._all)
        self._cart.run(seconds)
        return sum(one["channel"] == channel for one in self._all[began:])


@pytest.fixture
def second(monitoring: SimulatedCart) -> Iterator[Changes]:
    """A relay board of three channels beside the cart's own: contact, red lamp, sounder."""
    text, link, changes = monitoring.config.read_text(), monitoring.folder / "second", Changes(monitoring)
    urls = [(f"relay:{link}?channel={n}", role) for n, role in ((1, "contact"), (2, "red"), (3, "tone"))]
    more = "".join(f', {{ url = "{url}", signal = "{role}" }}' for url, role in urls)
    monitoring.config.write_text(text.replace(" }]", " }" + more + "]"))
    with running_board(link, TimelessClock(told_ns=monitoring.clock.told_ns), 3, on_change=changes) as board:
        changes.board = board
        monitoring.end_daemon()
        monitoring.start_daemon()
        yield changes
        monitoring.end_daemon()


def test_several_outputs_show_each_its_own_and_one_that_breaks_holds_up_no_other(
    monitoring: SimulatedCart, second: Changes
) -> None:
    monitoring.wait_for("monitoring")
    monitoring.until(lambda: second.contacts == {1: True, 2: True, 3: True})
    with monitoring.client() as client:
        client.test_lamps()
    monitoring.until(lambda: second.contacts == {1: True, 2: False, 3: False})
    monitoring.say("scale")
    monitoring.wait_for("halt")
    monitoring.until(lambda: second.contacts[1] is False)
    monitoring.until(lambda: not monitoring.status()["audio"]["lamp_test"])
    assert 4 <= second.during(2, 3.0) <= 14, "the red lamp flashes twice a second"
    assert monitoring.acknowledge()
    monitoring.until(lambda: second.contacts[3])
    assert second.during(3, 3.0) == 0, "acknowledged is silent"
    monitoring.say(None)
    monitoring.monitoring()
    began_s = monitoring.now_s()
    second.board.stuck = True
    monitoring.say("scale")
    monitoring.open_contact(began_s, ALARM_S)
    assert second.contacts[1], "its contact is stuck"
    assert any("did not switch" in said for said in monitoring.status()["lost"].values())


@pytest.mark.thorough
def test_an_alarm_sounds_until_it_is_acknowledged_and_reminds_of_itself_once_a_minute(
    monitoring: SimulatedCart, second: Changes
) -> None:
    monitoring.monitoring()
    assert second.during(3, 5.0) == 0, "all is well"
    monitoring.say("scale")
    monitoring.wait_for("recalibration requested")
    assert second.during(3, 16.0) > 4
    assert monitoring.acknowledge()
    monitoring.run(1.0)
    assert second.during(3, 55.0) == 0
    assert second.during(3, 10.0) > 0, "nobody has mended it"


@pytest.mark.parametrize("damage", ["memory", "log"])
def test_damage_is_reported_and_alarms_until_acknowledged(monitoring: SimulatedCart, damage: str) -> None:
    monitoring.end_daemon()
    file = monitoring.alarms / MEMORY if damage == "memory" else sorted(monitoring.alarms.glob("*.jsonl"))[-1]
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    monitoring.start_daemon()
    status = monitoring.wait_for("internal fault")
    assert (status["fault"], status["energised"]) == (f"{damage}-damaged", False)
    restart(monitoring)
    monitoring.wait_for("internal fault")
    assert monitoring.acknowledge()
    monitoring.wait_for("monitoring")
    restart(monitoring)
    monitoring.wait_for("monitoring")


def test_an_estimator_that_says_nothing_more_is_silent_then_hung_and_replaced(monitoring: SimulatedCart) -> None:
    began_s = monitoring.now_s()
    assert monitoring.estimator.here is not None
    monitoring.estimator.here.stopped = True
    monitoring.open_contact(began_s, ALARM_S)
    assert monitoring.wait_for("internal fault")["fault"] == "estimator-silent"
    monitoring.wait_for("monitoring")
    assert monitoring.status()["estimator"].startswith("hung, silent for 5.")
    assert monitoring.estimator.here.code is None
    monitoring.kill_estimator(signal.SIGSEGV)
    monitoring.until(lambda: monitoring.status()["estimator"] == "killed by SIGSEGV, restart 2")
