"""The service reports what was deleted from the alarm log at its next start, and the contact stays open until a person
acknowledges.
"""

import shutil
from pathlib import Path

from tests.appliance.service.test_daemon import moved
from tests.support.answers import Answer, answered
from tests.support.simulated_cart import SimulatedCart


def halted(cart: SimulatedCart) -> None:
    """HALT is latched, and the service killed."""
    cart.monitoring()
    cart.say("offset")
    cart.until(lambda: cart.status()["latched"], 60)
    cart.kill_daemon()
    cart.say(None)


def remove_log(cart: SimulatedCart) -> None:
    for file in cart.alarms.glob("alarm*"):
        file.unlink()


def verified(cart: SimulatedCart) -> Answer:
    return answered("log", "--verify", "--config", cart.config)


def expect_told_until_acknowledged(cart: SimulatedCart) -> None:
    """Once: another start says nothing of it."""
    began_s = cart.now_s()
    cart.start_daemon()
    cart.run(15)
    assert cart.status()["fault"] == "log-damaged"
    assert not any(closed for _, closed in cart.switched(began_s))
    cart.kill_daemon()
    cart.start_daemon()
    cart.run(15)
    assert cart.status()["fault"] == "log-damaged", "also when it was killed before"
    assert cart.acknowledge()
    cart.monitoring()
    for _ in range(2):
        cart.end_daemon()
        cart.start_daemon()
        cart.monitoring()
    assert verified(cart).returncode == 0


def test_a_log_that_was_deleted_with_its_memory_beside_kept_references_is_told(tmp_path: Path) -> None:
    with SimulatedCart(tmp_path) as cart:
        halted(cart)
        remove_log(cart)
        told = verified(cart)
        assert (told.returncode, "reference 1 was in force" in told.stderr) == (65, True), told.stderr
        expect_told_until_acknowledged(cart)


def test_a_log_put_back_to_an_older_copy_beside_newer_references_is_told(tmp_path: Path) -> None:
    with SimulatedCart(tmp_path) as cart:
        cart.monitoring()
        cart.end_daemon()
        shutil.copytree(cart.alarms, tmp_path / "copy")
        cart.start_daemon()
        cart.monitoring()
        with cart.client() as client:
            client.begin_recalibration()
            client.end_recalibration(moved(cart, tmp_path / "new.toml", 1))
        halted(cart)
        remove_log(cart)
        for file in (tmp_path / "copy").glob("alarm*"):
            shutil.copy(file, cart.alarms / file.name)
        told = verified(cart)
        assert (told.returncode, "reference 2 was in force" in told.stderr) == (65, True), told.stderr
        report = answered("report", "--config", cart.config, "--folder", tmp_path, "--of", f"{cart.utc:%Y-%m-%d}")
        assert report.returncode == 65
        assert "the alarm log is damaged" in report.stderr
        expect_told_until_acknowledged(cart)


def test_what_is_taken_from_a_chain_that_was_damaged_before_is_told(tmp_path: Path) -> None:
    """Two chains were damaged and acknowledged; then entries of the first one are taken away."""
    with SimulatedCart(tmp_path) as cart:
        cart.monitoring()
        for _ in range(2):
            cart.end_daemon()
            last = sorted(cart.alarms.glob("alarms-*.jsonl"))[-1]
            last.write_bytes(last.read_bytes().replace(b'"event": "started"', b'"event": "startet"', 1))
            cart.start_daemon()
            cart.run(5)
            assert cart.status()["fault"] == "log-damaged"
            assert cart.acknowledge()
            cart.monitoring()
        cart.end_daemon()
        cart.start_daemon()
        cart.monitoring()
        cart.end_daemon()
        first = min(cart.alarms.glob("alarms-*.jsonl"))
        first.write_bytes(b"".join(first.read_bytes().splitlines(True)[:2]))
        cart.start_daemon()
        cart.run(5)
        assert cart.status()["fault"] == "log-damaged"
        assert cart.contact() is False
        assert cart.acknowledge()
        cart.monitoring()
        cart.end_daemon()
        cart.start_daemon()
        cart.monitoring()
