"""Metal near an electromagnetic tracker: through the whole cart, real protocol bytes of an Aurora and the real service;
and through the line alone, what is and what is not claimed under which motion.

`pytest -s -m slow tests/live/test_distortion.py` prints what it says and after how long.
"""

import json
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from appliance.core.line import Line
from appliance.storage.calibration_file import calibration_from_image_to_probe
from appliance.types import Verdict, VerdictKind
from drivers.samples import Pose
from drivers.twins.scene.metal import LEAVES_AT_S, near_metal
from drivers.twins.scene.world import World, WorldSettings
from tests.support.demo_cart import Cart
from tests.support.polling import until
from tests.support.sessions import ORIGIN_NS, SWEPT, session
from tools.simulators.whole_cart import TWINS

pytestmark = pytest.mark.slow

SMALL = WorldSettings(width_px=400, height_px=300, scale_mm_per_px=(0.09, 0.08))
START_S, VERIFIED_S = 60.0, 90.0
INDICATED_S = 3.0
"""The indicator passes its limit after 1.1 s; the median over a second of measurements, and a warning before it."""
UNVERIFIED_S, NAMED_S = 10.0, 20.0
DISAGREEMENT = {"scale", "rotation", "offset", "latency", "polarity"}
"""What the two paths can be told apart by; which of them it is depends on the motion, and names no cause."""


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


def verdicts(program: str, displaced_mm: float, at_s: float, duration_s: float) -> list[Verdict]:
    """Of the line, from at_s on, when the metal begins to come. Poses at the 40 Hz of an Aurora."""
    world = World(3, program, settings=SMALL)
    before, origin_ns = world.probe_pose(at_s), ORIGIN_NS + round(at_s * 1e9)
    line = Line(calibration_from_image_to_probe(world.image_to_probe, (400, 300)), SWEPT)
    said: list[Verdict] = []
    for sample in session(world, duration_s, pose_hz=40.0):
        since_s = (sample.stamp.t_ns - origin_ns) / 1e9
        if isinstance(sample, Pose) and sample.matrix is not None and since_s >= 0:
            sample = replace(sample, matrix=near_metal(sample.matrix, before, since_s, displaced_mm))  # noqa: PLW2901
        said += line.step(sample)
    return [verdict for verdict in said if verdict.t_ns >= origin_ns]


@pytest.mark.parametrize("program", ["still", "elevational", "rotation"])
def test_motion_that_need_not_show_the_distortion_verifies_nothing_either(program: str) -> None:
    found = {verdict.kind for verdict in verdicts(program, 12.0, 3.0, 15.0)}
    assert VerdictKind.NOT_VERIFIED in found
    assert VerdictKind.OK not in found


@pytest.mark.parametrize(("displaced_mm", "named"), [(1.0, False), (3.0, False), (6.0, True)])
def test_what_a_sweep_makes_of_weak_and_strong_distortion(displaced_mm: float, named: bool) -> None:
    """Once the metal has lain there for as long as evidence is kept."""
    settled_ns = ORIGIN_NS + 22 * 10**9
    found = {verdict.kind for verdict in verdicts("sweep", displaced_mm, 10.0, 36.0) if verdict.t_ns > settled_ns}
    print(f"{displaced_mm:g} mm: {sorted(one.value for one in found)}")
    assert (VerdictKind.FAULT in found) is named
    assert VerdictKind.OK not in found
