"""`probewatch recalibrate --live` on a running cart: the session of the page, driven from a terminal."""

import signal
import subprocess
import tomllib
from pathlib import Path

import pytest

from tests.support.demo_cart import PROBEWATCH, Cart
from tests.support.polling import until


def started(folder: Path, cart: Cart, *arguments: str) -> "subprocess.Popen[str]":
    command = [str(PROBEWATCH), "recalibrate", "--live", "--config", str(cart.config), "--folder", str(folder)]
    options = ["--probe", "L12-5", "--preset", "4 cm", "--made-by", "A. Smith", *arguments]
    return subprocess.Popen(
        [*command, *options], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def test_a_scan_that_two_people_have_signed_is_proved_and_in_force(cart: Cart, tmp_path: Path) -> None:
    number = cart.wait_for("monitoring", 60)["reference"]["number"]
    cart.tank.touch()
    process = started(tmp_path, cart, "--solve", "zeta", "--signed-by", "B. Jones", "--role", "clinical engineer")
    cart.wait_for("recalibrating", 30)
    until(lambda: cart.contact() is False)
    until(lambda: process.poll() is not None or cart.status()["reference"]["number"] > number, 180, 0.2)
    cart.tank.unlink()
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert "the service has verified the new calibration and monitors again" in out
    (file,) = tmp_path.glob("L12_5-4_cm-*.toml")
    assert cart.status()["reference"]["file"] == str(file)
    said = tomllib.loads(file.read_text())["provenance"]
    assert (said["signed_by"], said["signed_role"]) == ("B. Jones", "clinical engineer")
    until(cart.contact)


def test_an_interrupted_scan_leaves_the_calibration_before_in_force(cart: Cart, tmp_path: Path) -> None:
    cart.wait_for("monitoring", 60)
    before = cart.status()["reference"]["sha256"]
    process = started(tmp_path, cart)
    cart.wait_for("recalibrating", 30)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=30)
    said = "probewatch: stopped: nothing was changed, reference 2 is in force, as before"
    assert (process.returncode, err.strip()) == (130, said)
    cart.wait_for("monitoring", 40)
    assert cart.status()["reference"]["sha256"] == before
    assert list(tmp_path.glob("*.toml")) == []


@pytest.mark.slow
def test_a_new_cart_comes_to_monitoring_by_its_own_first_calibration(tmp_path: Path) -> None:
    """No calibration is known to it; the real line proves all eight parameters of the scan."""
    with Cart(tmp_path) as cart:
        cart.daemon.end()
        lines = [line for line in cart.config_text.splitlines(True) if "calibration.file" not in line]
        cart.config.write_text("".join(lines))
        cart.start_daemon()
        until(lambda: "no calibration yet" in (cart.status().get("reference_waits") or ""), 60)
        cart.tank.touch()
        process = started(tmp_path, cart, "--solve", "all", "--signed-by", "B. Jones", "--role", "engineer")
        cart.wait_for("recalibrating", 60)
        until(lambda: process.poll() is not None or cart.status()["reference"], 300, 0.2)
        assert not cart.contact(), "nothing has been proved"
        cart.tank.unlink()
        out, err = process.communicate(timeout=300)
        assert process.returncode == 0, f"{out}\n{err}\n{cart.status()['reason']}"
        status = cart.wait_for("monitoring", 30)
        assert status["reference"]["number"] == 1
        until(cart.contact)
