"""What a tracker says of itself, all the way to the contact in the room and back, through the real service."""

import json
import time
from pathlib import Path

import pytest

from probewatch.appliance.service.control.client import ControlClient
from tests.support.demo_cart import Cart
from tests.support.polling import until

ALARM_S = 2.0
"""For a timeout of half a second, the median over a second of measurements, and a tick."""

BUMPED = "the position sensor was bumped"


def show(cart: Cart, *faults: str) -> float:
    """Exactly these faults of the tracker from now on. Returns the host's time, s."""
    file, fresh = Path(f"{cart.folder}/polaris.json"), Path(f"{cart.folder}/polaris.new")
    fresh.write_text(json.dumps(faults))
    fresh.replace(file)
    return time.monotonic()


def alarmed(cart: Cart, fault: str, since_s: float, within_s: float) -> None:
    cart.open_contact(since_s, within_s)
    assert cart.wait_for("device lost", within_s)["fault"] == fault


def _figures(cart: Cart) -> dict[str, float | None]:
    return {check["name"]: check["value"] for check in cart.status()["devices"]}


def test_a_loose_marker_opens_the_contact_and_mends_by_itself(cart: Cart) -> None:
    cart.wait_for("monitoring")
    until(cart.contact)
    figures = until(lambda: (now := _figures(cart))["marker geometry"] is not None and now)
    assert figures["marker fit"] == pytest.approx(0.2)
    assert figures["marker geometry"] == pytest.approx(0, abs=0.05)
    assert figures["field indicator"] is None
    alarmed(cart, "marker-body", show(cart, "marker-drift"), ALARM_S + 2)  # the marker needs a second or two to drift
    show(cart)
    cart.wait_for("monitoring")


def test_a_bump_opens_the_contact_until_it_is_cleared_over_the_control_socket(cart: Cart) -> None:
    cart.wait_for("monitoring")
    alarmed(cart, "tracker-alert", show(cart, "bump"), ALARM_S)
    show(cart)
    status = cart.wait_for("device lost")
    assert status["remarks"][0] == BUMPED
    assert "probewatch ack --bump" in status["remedy"]
    with ControlClient(cart.socket) as client:
        client.clear_bump()
    assert BUMPED not in cart.wait_for("monitoring")["remarks"]


def test_a_bump_outlives_the_tracker_connection(cart: Cart) -> None:
    cart.wait_for("monitoring")
    show(cart, "bump")
    cart.wait_for("device lost")
    show(cart, "unplug")
    until(lambda: cart.status()["lost"])
    show(cart)
    until(lambda: cart.status()["remarks"][:1] == [BUMPED])
    assert cart.status()["fault"] == "tracker-alert"
    with ControlClient(cart.socket) as client:
        client.clear_bump()
    cart.wait_for("monitoring")
