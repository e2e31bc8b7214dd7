"""The service as a process: what latches stays latched, what is written survives, and nobody on the socket matters."""

import contextlib
import errno
import json
import os
import random
import signal
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from appliance.service.control.client import ControlClient
from appliance.service.control.server import ControlRefused
from appliance.storage.alarm_chain import MEMORY, read_log
from tests.support.demo_cart import PROBEWATCH, Cart
from tests.support.polling import until
from tests.support.signals import family, stop
from tools.commands import ack, lamp_test, pause, status
from tools.simulators.whole_cart import Part

pytestmark = pytest.mark.alone

ALARM_S = 2.0
WITH_FILE = ("propose-calibration", "end-recalibration")
HOSTILE_BODIES = (
    ', "seconds": 1e999',
    ', "file": "/dev/zero"',
    ', "file": 7',
    ', "reason": [1]',
    ', "reason": "\\ud800 \\ud800"',
)


@pytest.fixture
def monitoring(cart: Cart) -> Iterator[Cart]:
    cart.wait_for("monitoring")
    until(cart.contact)
    yield cart
    cart.say(None)


def log_folder(cart: Cart) -> Path:
    return cart.folder / "alarms"


def acknowledge(cart: Cart) -> None:
    with ControlClient(cart.socket) as client:
        client.acknowledge()


def restart(cart: Cart) -> float:
    """SIGKILL, as when the power goes, and start again."""
    assert cart.daemon is not None
    cart.daemon.end(kill=True)
    restarted_s = time.monotonic()
    cart.start_daemon()
    return restarted_s


@pytest.mark.parametrize("state", ["halt", "recalibration requested"])
def test_a_latched_state_outlives_the_process_and_needs_a_person(monitoring: Cart, state: str) -> None:
    monitoring.say("scale")
    monitoring.wait_for(state)
    until(lambda: read_log(log_folder(monitoring)).entries[-1].latch)
    restart(monitoring)
    latched = until(lambda: (now := monitoring.status()) and now)
    assert latched["latched"] in {"halt", "recalibration requested"}
    assert (latched["fault"], latched["energised"], latched["acknowledged"]) == ("scale", False, False)
    monitoring.say(None)
    until(lambda: monitoring.status().get("verdict") == "OK")
    time.sleep(1.5)
    assert monitoring.status()["latched"] is not None, "verification alone frees nothing"
    acknowledge(monitoring)
    monitoring.wait_for("monitoring")


def test_acknowledging_while_the_cause_stands_waits_for_the_verification(monitoring: Cart) -> None:
    monitoring.say("scale")
    monitoring.wait_for("recalibration requested")
    acknowledge(monitoring)
    with pytest.raises(ControlRefused, match="verified again"):
        acknowledge(monitoring)
    assert monitoring.status()["audio"]["mode"] == "acknowledged"
    monitoring.say(None)
    monitoring.wait_for("monitoring")


def test_a_full_disk_takes_no_alarm_away_and_loses_no_entry(monitoring: Cart) -> None:
    written = len(read_log(log_folder(monitoring)).entries)
    make_room = monitoring.fill_disk()
    began_s = time.monotonic()
    try:
        monitoring.say("scale")
        monitoring.open_contact(began_s, ALARM_S)
        monitoring.wait_for("halt")
        until(lambda: monitoring.status()["notices"])
        assert monitoring.status()["log"]["failing"]
        assert monitoring.status()["tick"]["p99_ms"] < 200
    finally:
        make_room()
    monitoring.say(None)
    acknowledge(monitoring)
    monitoring.wait_for("monitoring")
    until(lambda: monitoring.status()["log"]["waiting"] == 0)
    reading = read_log(log_folder(monitoring))
    assert reading.damages == ()
    states = [entry.data["state"] for entry in reading.entries[written:] if entry.event == "state"]
    assert {"warning", "halt"} <= set(states), "what happened meanwhile is in the log"
    assert states[-1] == "monitoring"
    assert monitoring.status()["notices"] == []


def test_a_changed_configuration_is_taken_or_refused_whole(monitoring: Cart) -> None:
    text = monitoring.config.read_text()
    assert monitoring.daemon is not None
    try:
        monitoring.config.write_text(text + "limits.scale_procent = 3\n")
        with ControlClient(monitoring.socket) as client, pytest.raises(ControlRefused, match="scale_percent"):
            client.reload()
        monitoring.config.write_text(text.replace("deadline_ms=250", "deadline_ms=251"))
        with ControlClient(monitoring.socket) as client, pytest.raises(ControlRefused, match=r"\[tracker\]"):
            client.reload()
        monitoring.config.write_text(text + 'alarm.language = "de"\n')
        monitoring.daemon.process.send_signal(signal.SIGHUP)
        until(lambda: monitoring.status()["text"] == "SIMULIERT · Kalibrierung bestätigt")
        until(lambda: read_log(log_folder(monitoring)).entries[-1].event == "reloaded")
    finally:
        monitoring.config.write_text(text)
    with ControlClient(monitoring.socket) as client:
        client.reload()
    assert monitoring.status()["text"] == "SIMULATED · Calibration verified"


def test_a_proposed_calibration_is_compared_and_nothing_changes(monitoring: Cart) -> None:
    with ControlClient(monitoring.socket) as client:
        same = client.propose_calibration(monitoring.folder / "probe.toml")
        with pytest.raises(ControlRefused, match=r"none\.toml"):
            client.propose_calibration(monitoring.folder / "none.toml")
    assert same["rotation_deg"] == pytest.approx(0, abs=1e-6)
    assert (same["offset_mm"], same["same_polarity"]) == (0, True)
    assert monitoring.status()["state"] == "monitoring"


def connected(path: Path) -> socket.socket:
    """Linux refuses at once where a crowd is waiting to be accepted."""
    link = socket.socket(socket.AF_UNIX)
    link.settimeout(1)
    until(lambda: link.connect_ex(str(path)) in {0, errno.EISCONN})
    return link


def hostile(path: Path, chance: random.Random) -> None:
    """One client that does what no client should."""
    with contextlib.suppress(OSError), connected(path) as link:
        kind = chance.randrange(5)
        if kind == 0:
            link.sendall(chance.randbytes(chance.randrange(1, 3000)) + b"\n")
        elif kind == 1:
            link.sendall(b"x" * 100_000)
        elif kind == 2:
            link.sendall(b'{"v": 1, "do": "sta')
        elif kind == 3:
            do = chance.choice(
                ["status", "acknowledge", "reload", "pause-audio", "audio-off", *WITH_FILE, "?", "\\ud800"]
            )
            body = chance.choice(["", *HOSTILE_BODIES, f', "file": "{path.with_name("pipe")}"'])
            link.sendall(f'{{"v": 1, "do": "{do}"{body}}}\n'.encode() * chance.randrange(1, 20))
        if chance.random() < 0.5:
            link.recv(1)


def many_hostile(path: Path, seed: int) -> None:
    for number in range(125):
        hostile(path, random.Random(seed + number))


def test_a_thousand_hostile_inputs_change_nothing_and_slow_no_tick(monitoring: Cart) -> None:
    before, calm = monitoring.status(), monitoring.status()["tick"]
    chance = random.Random(5)
    os.mkfifo(monitoring.socket.with_name("pipe"))
    with contextlib.ExitStack() as stack:
        for _ in range(200):
            stack.enter_context(connected(monitoring.socket))
        threads = [
            threading.Thread(target=many_hostile, args=(monitoring.socket, seed))
            for seed in chance.sample(range(10**6), 8)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    after = until(monitoring.status)
    with ControlClient(monitoring.socket) as client:
        client.audio_on()
    assert (after["state"], after["fault"], after["energised"]) == ("monitoring", None, True)
    changes = [event for event in monitoring.daemon.said if event.get("event") == "state"]
    assert changes[-1]["state"] == "monitoring"
    lost = [event for event in monitoring.daemon.said if event["event"] == "device lost"]
    assert after["counters"]["device_losses"] == before["counters"]["device_losses"], lost
    assert after["tick"]["longest_ms"] < max(150, 3 * calm["longest_ms"])
    restart(monitoring)  # they asked as the user who asks in the tests that follow, and too often


def test_a_stopped_service_holds_no_lock_on_its_recovery(monitoring: Cart) -> None:
    """SIGSTOP for a second: ticks come late, are counted, and monitoring goes on."""
    assert monitoring.daemon is not None
    os.kill(monitoring.daemon.process.pid, signal.SIGSTOP)
    time.sleep(1)
    os.kill(monitoring.daemon.process.pid, signal.SIGCONT)
    monitoring.wait_for("monitoring")
    assert monitoring.status()["counters"]["late_ticks"] >= 1


def told(command: click.Command, cart: Cart, *arguments: str) -> Result:
    return CliRunner().invoke(command, [*arguments, "--socket", str(cart.socket)])


def test_the_operators_commands(monitoring: Cart) -> None:
    shown = told(status.command, monitoring)
    assert shown.exit_code == 0
    assert all(part in shown.output for part in ("MONITORING", "contact closed (safe)", "video presence"))
    assert json.loads(told(status.command, monitoring, "--json").output)["state"] == "monitoring"
    assert isinstance(told(ack.command, monitoring).exception, ControlRefused)
    assert "silent for 30 s" in told(pause.command, monitoring, "30").output
    assert monitoring.status()["audio"]["mode"] == "paused"
    assert told(pause.command, monitoring, "121").exit_code == 2
    assert isinstance(told(pause.command, monitoring, "--off", " ").exception, ControlRefused)
    assert "until 'probewatch pause --on'" in told(pause.command, monitoring, "--off", "room empty").output
    assert monitoring.status()["audio"]["reason"] == "room empty"
    assert "may sound again" in told(pause.command, monitoring, "--on").output
    assert monitoring.status()["audio"]["mode"] == "on"
    assert "no lamp and no tone" in told(lamp_test.command, monitoring).output
    monitoring.say("scale")
    monitoring.wait_for("halt")
    assert told(status.command, monitoring).exit_code == 1
    assert "acknowledged · " in told(ack.command, monitoring).output
    monitoring.say(None)
    monitoring.wait_for("monitoring")
    noted = [entry.data["do"] for entry in read_log(log_folder(monitoring)).entries if entry.event == "request"]
    assert {"pause-audio", "audio-off", "audio-on", "lamp-test", "acknowledge"} <= set(noted)


@contextlib.contextmanager
def second_board(cart: Cart) -> Iterator[Part]:
    """A relay board of three channels beside the cart's own: contact, red lamp, sounder. Like all simulated devices it
    is a process of its own, which goes before other programs: in this one it answers too late on a busy computer.
    """
    text, link = cart.config.read_text(), cart.folder / "second"
    urls = [(f"relay:{link}?channel={n}", role) for n, role in ((1, "contact"), (2, "red"), (3, "tone"))]
    more = "".join(f', {{ url = "{url}", signal = "{role}" }}' for url, role in urls)
    assert cart.daemon is not None
    board = Part("second board", [str(PROBEWATCH), "simulate", "relay", "--pty", str(link), "--channels", "3"])
    try:
        until(lambda: board.find(ready=True), 30)
        cart.config.write_text(text.replace(" }]", " }" + more + "]"))
        cart.daemon.end()
        cart.start_daemon()
        yield board
    finally:
        board.end()
        cart.config.write_text(text)
        cart.daemon.end()
        cart.start_daemon()


def contacts(board: Part) -> dict[int, bool]:
    """Channel → closed, as the board said last."""
    return {event["channel"]: event["energised"] for event in tuple(board.said) if "channel" in event}


def changes(board: Part, channel: int, seconds: float) -> int:
    """How often a contact moves from now on, by the board's own clock."""
    began_s = time.monotonic()
    time.sleep(seconds)
    times = [event["t_ns"] / 1e9 - began_s for event in tuple(board.said) if event.get("channel") == channel]
    return sum(0 <= t_s < seconds for t_s in times)


def test_several_outputs_show_each_its_own_and_one_that_breaks_holds_up_no_other(monitoring: Cart) -> None:
    with second_board(monitoring) as board:
        monitoring.wait_for("monitoring")
        until(lambda: contacts(board) == {1: True, 2: True, 3: True})
        with ControlClient(monitoring.socket) as client:
            client.test_lamps()
        until(lambda: contacts(board) == {1: True, 2: False, 3: False})
        monitoring.say("scale")
        monitoring.wait_for("halt")
        until(lambda: contacts(board)[1] is False)
        until(lambda: not monitoring.status()["audio"]["lamp_test"])
        assert 4 <= changes(board, 2, 3.0) <= 14, "the red lamp flashes twice a second"
        acknowledge(monitoring)
        until(lambda: contacts(board)[3])
        assert changes(board, 3, 3.0) == 0, "acknowledged is silent"
        monitoring.say(None)
        monitoring.wait_for("monitoring")
        until(monitoring.contact)
        go_on = stop(family(board.process.pid))
        began_s = time.monotonic()
        monitoring.say("scale")
        monitoring.open_contact(began_s, ALARM_S)
        go_on()
        monitoring.say(None)


@pytest.mark.parametrize("damage", ["memory", "log"])
def test_damage_is_reported_and_alarms_until_acknowledged(monitoring: Cart, damage: str) -> None:
    assert monitoring.daemon is not None
    monitoring.daemon.end()
    file = log_folder(monitoring) / MEMORY if damage == "memory" else sorted(log_folder(monitoring).glob("*.jsonl"))[-1]
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    monitoring.start_daemon()
    status = monitoring.wait_for("internal fault")
    assert (status["fault"], status["energised"]) == (f"{damage}-damaged", False)
    restart(monitoring)
    monitoring.wait_for("internal fault")
    acknowledge(monitoring)
    monitoring.wait_for("monitoring")
    restart(monitoring)
    monitoring.wait_for("monitoring")
