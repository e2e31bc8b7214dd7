"""Metal near an electromagnetic tracker: through the whole cart, real protocol bytes of an Aurora and the real service.
What the line alone makes of it: tests/appliance/core/test_metal.py.

`pytest -s -m slow tests/live/test_distortion.py` prints what it says and after how long.
"""

import json
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from probewatch.drivers.twins.scene.metal import LEAVES_AT_S
from probewatch.tools.simulators.whole_cart import TWINS
from tests.support.demo_cart import Cart
from tests.support.polling import until

pytestmark = pytest.mark.slow

START_S, VERIFIED_S = 60.0, 90.0
INDICATED_S = 3.0
"""The indicator passes its limit after 1.1 s; the median over a second of measurements, and a warning before it."""
UNVERIFIED_S, NAMED_S = 10.0, 20.0
DISAGREEMENT = {"field-distortion", "scale", "rotation", "offset", "latency", "polarity"}
"""What the two paths can be told apart by; which of them comes first depends on the motion."""


class AuroraCart(Cart):
    """The probe carries a sensor on a cable instead of markers."""

    def await_twin(self, name: str) -> str:
        url = super().await_twin(name)
        return f"{url.partition('?')[0]}?probe=@1" if name == "polaris" else url

    def show(self, *faults: str) -> float:
        """Exactly these faults of the tracker from now on. Returns the host's time, s."""
        file, fresh = self.folder / "polaris.json", self.folder / "polaris.new"
        fresh.write_text(json.dumps(faults))
        fresh.replace(file)
        return time.monotonic()

    def contact_opened_s(self, since_s: float, within_s: float) -> float:
        """After how many seconds."""
        self.open_contact(since_s, within_s)
        return time.monotonic() - since_s

    def named_s(self, faults: set[str], since_s: float, within_s: float) -> tuple[str, float]:
        """(which of these it named first, after how many seconds)."""
        named = until(lambda: (now := self.status().get("fault")) in faults and now, within_s)
        return str(named), time.monotonic() - since_s


@pytest.fixture
def cart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[AuroraCart]:
    monkeypatch.setitem(TWINS, "polaris", [*TWINS["polaris"][:-1], "aurora"])
    with AuroraCart(tmp_path) as cart:
        cart.wait_for("monitoring", START_S)
        until(cart.contact)
        yield cart


def test_metal_that_the_tracker_tells_of_is_named_at_once(cart: AuroraCart) -> None:
    began_s = cart.show("em-distortion")
    opened_s = cart.contact_opened_s(began_s, INDICATED_S)
    named, named_s = cart.named_s({"field-distortion"}, began_s, INDICATED_S)
    print(f"with a rising indicator: contact open after {opened_s:.1f} s, {named} after {named_s:.1f} s")
    cart.wait_for("device lost", 5)
    cart.show()
    cart.wait_for("monitoring", VERIFIED_S)


def test_metal_that_the_tracker_does_not_tell_of_ends_the_verification_and_is_found_by_motion(cart: AuroraCart) -> None:
    """Its indicator stays as it was, and no other figure of the tracker shows anything."""
    began_s = cart.show("metal")
    until(lambda: cart.status()["verdict"] != "OK", UNVERIFIED_S)
    unverified_s = time.monotonic() - began_s
    opened_s = cart.contact_opened_s(began_s, NAMED_S)
    named, named_s = cart.named_s(DISAGREEMENT, began_s, NAMED_S)
    halted_s = cart.wait_for("halt", LEAVES_AT_S) and time.monotonic() - began_s
    times = f"contact open after {opened_s:.1f} s, {named} after {named_s:.1f} s, halt after {halted_s:.1f} s"
    print(f"with a silent indicator: not verified after {unverified_s:.1f} s, {times}")
    assert {check["verdict"] for check in cart.status()["devices"]} <= {"OK", "NOT_VERIFIED"}
    time.sleep(max(0.0, began_s + LEAVES_AT_S - time.monotonic()))
    assert cart.contact(began_s) is False, "it does not close as long as the metal is there"
    until(cart.acknowledge)
    cart.wait_for("monitoring", VERIFIED_S)
