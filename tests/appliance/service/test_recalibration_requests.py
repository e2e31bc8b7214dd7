"""Recalibration over the control socket, the whole service in simulated time."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.storage.alarm_chain import read_log
from tests.appliance.service.test_daemon import moved
from tests.support.simulated_cart import SimulatedCart


def test_recalibration_over_the_control_socket(monitoring: SimulatedCart, tmp_path: Path) -> None:
    good = monitoring.config.with_name("probe.toml")
    with monitoring.client() as client:
        with pytest.raises(ControlRefused, match="not possible while monitoring"):
            client.acknowledge()
        began_s = monitoring.now_s()
        client.begin_recalibration()
        monitoring.open_contact(began_s, 1)
        with pytest.raises(ControlRefused, match=r"missing\.toml"):
            client.end_recalibration(tmp_path / "missing.toml")
        assert client.status()["state"] == "recalibrating"
        client.end_recalibration(good)
    monitoring.wait_for("monitoring")
    assert monitoring.said(event="request granted", request="end_recalibration")


def test_a_far_calibration_is_not_taken_before_its_difference_is_repeated(
    monitoring: SimulatedCart, tmp_path: Path
) -> None:
    far = moved(monitoring, tmp_path / "far.toml", 30)
    with monitoring.client() as client:
        client.begin_recalibration()
        with pytest.raises(ControlRefused, match="differs from the reference in force"):
            client.end_recalibration(far)
        assert client.status()["reference"]["number"] == 1
        client.end_recalibration(far, client.propose_calibration(far)["text"])
        assert client.status()["reference"]["number"] == 2


def test_a_file_that_was_exchanged_after_its_proposal_is_not_taken(monitoring: SimulatedCart, tmp_path: Path) -> None:
    """Two files may differ from the reference in the same words, such as by 8 degrees about other axes."""
    proposed = moved(monitoring, tmp_path / "proposed.toml", 30)
    with monitoring.client() as client:
        proposal = client.propose_calibration(proposed)
        with proposed.open("a") as file:
            file.write("# another\n")
        assert client.propose_calibration(proposed)["text"] == proposal["text"]
        client.begin_recalibration()
        with pytest.raises(ControlRefused, match="is not the file that was proposed"):
            client.end_recalibration(proposed, proposal["text"], proposal["sha256"])
        assert client.status()["reference"]["number"] == 1
        assert client.status()["state"] == "recalibrating"
        client.end_recalibration(proposed, proposal["text"], client.propose_calibration(proposed)["sha256"])
        assert client.status()["reference"]["number"] == 2


def test_a_new_calibration_that_a_lost_device_keeps_from_its_proof_is_gone_back_from(
    monitoring: SimulatedCart, tmp_path: Path
) -> None:
    assert monitoring.status()["reference"]["verified_utc"]
    monitoring.tracker.plugged = False
    with monitoring.client() as client:
        client.begin_recalibration()
        client.end_recalibration(moved(monitoring, tmp_path / "new.toml", 1))
        new = client.status()["reference"]
    assert (new["number"], new["verified_utc"]) == (2, None)
    monitoring.wait_for("device lost")
    monitoring.tracker.plugged = True
    reference = monitoring.wait_for("monitoring")["reference"]
    assert (reference["origin"], reference["file"]) == ("went back to 1", str(monitoring.folder / "probe.toml"))


def test_aborted_recalibration_is_verified_again(monitoring: SimulatedCart) -> None:
    with monitoring.client() as client:
        client.begin_recalibration()
        client.abort_recalibration()
        assert client.status()["state"] in {"not verified", "monitoring"}
    monitoring.wait_for("monitoring")


def test_a_second_recalibration_is_refused_by_name_and_ends_nothing_when_it_leaves(monitoring: SimulatedCart) -> None:
    """Of another process, which also tries to end what it did not begin; the first one goes on and ends its own."""
    asked = [{"v": 1, "do": f"{do}-recalibration", "hold_s": 20, "number": 1} for do in ("begin", "end", "abort")]
    script = (
        f"import socket; link = socket.socket(socket.AF_UNIX); link.connect({str(monitoring.socket)!r})\n"
        "lines = link.makefile('rw')\n"
        f"for line in {[json.dumps(one) for one in asked]!r}:\n"
        "    print(line, file=lines, flush=True); print(lines.readline(), end='')"
    )
    with monitoring.client() as client:
        client.begin_recalibration(20)
        with monitoring.served():
            second = subprocess.run(
                [sys.executable, "-c", script], capture_output=True, text=True, timeout=20, check=True
            )
        for line in second.stdout.splitlines():
            assert f"process {os.getpid()} has recalibrated for " in json.loads(line).get("error", ""), line
        monitoring.run(0.2)
        status = client.status()
        assert (status["state"], status["recalibration"]["yours"]) == ("recalibrating", True)
        client.abort_recalibration()
    monitoring.wait_for("monitoring")


def test_whoever_began_and_falls_silent_is_given_up_after_the_time_he_asked_for(monitoring: SimulatedCart) -> None:
    with monitoring.client() as client:
        client.begin_recalibration(20)
        monitoring.run(19.5)
        assert client.status()["state"] == "recalibrating"
        monitoring.run(20.2)
        assert monitoring.daemon is not None
        given_up = [entry.data for entry in read_log(monitoring.alarms).entries if "given up" in entry.event]
        assert "has been silent for 20 s" in given_up[-1]["why"]
    monitoring.wait_for("monitoring")


def test_whoever_began_and_is_gone_leaves_no_cart_that_waits_for_him(monitoring: SimulatedCart) -> None:
    """The service gives the scan up, says for whom and why, in the log too, and closes nothing unverified."""
    with monitoring.client() as client:
        client.begin_recalibration(20)
        held = client.status()["recalibration"]
        monitoring.tracker.sends = False
        monitoring.run(0.3)
    assert (held["hold_s"], held["ended"]) == (20, None)
    assert held["silent_s"] < 10
    began_s = monitoring.now_s()
    status = monitoring.until(lambda: (now := monitoring.status())["state"] != "recalibrating" and now, 0.2)
    told = status["recalibration"]["ended"]
    assert f"given up for {held['who']}, whose connection is gone" in told
    given_up = [entry.data["why"] for entry in read_log(monitoring.alarms).entries if "given up" in entry.event]
    assert given_up == [told]
    monitoring.run(0.3)
    assert not monitoring.contact(began_s)
    monitoring.tracker.sends = True
    monitoring.wait_for("monitoring")
    assert monitoring.status()["recalibration"] is None
