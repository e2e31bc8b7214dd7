"""A leap is of the marker body or of the tracker's camera: the text names both, and scanning on tells them apart.

With a reference tool a bump of the camera is no leap: the contact stays closed, and the tracker's remarks name it.
"""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from probewatch.appliance.supervision.alarms import operator_text
from probewatch.drivers.clock.device_clock import DeviceClock
from probewatch.drivers.rigid import rigid, rotation_from_vector
from probewatch.drivers.samples import Pose, PoseStatus, Sample
from probewatch.drivers.trackers.ndi.exchange import Answer
from probewatch.drivers.trackers.ndi.identity import ReplyKind
from probewatch.drivers.trackers.ndi.negotiation import Agreed
from probewatch.drivers.trackers.ndi.pose_assembly import Bodies, PoseAssembly
from probewatch.drivers.trackers.ndi.readings import Reading, Snapshot, dialect
from probewatch.drivers.trackers.ndi.tools import Tool
from probewatch.drivers.twins.ndi.measurement import transform_of
from tests.invariant.cart import ORIGIN_NS, Cart
from tests.invariant.machine import CLOSED_AGAIN_WITHIN_S
from tests.invariant.scenarios import VERIFIED_WITHIN_S, verified_cart
from tests.invariant.world import BENT

BUMP = rigid(rotation_from_vector(np.deg2rad([1.0, 4.0, -1.0])), np.array([5.0, 0.0, -3.0]))


def told(cart: Cart) -> tuple[str, str]:
    assert cart.run(1.0, until=lambda: not cart.closed and cart.alarm is not None and cart.alarm.fault is not None)
    assert cart.alarm is not None
    assert cart.alarm.fault is not None
    assert cart.alarm.fault in ("rotation", "offset")
    return operator_text(cart.alarm.state, cart.alarm.fault)


@pytest.mark.thorough
@pytest.mark.parametrize("bumped", [True, pytest.param(False, marks=pytest.mark.thorough)])
def test_scanning_on_verifies_again_only_where_the_camera_moved(bumped: bool) -> None:
    cart = verified_cart(1, fps=15.0)
    if bumped:
        cart.tracker.moved = BUMP
    else:
        cart.change(BENT)
    text, remedy = told(cart)
    assert "Marker body or tracker" in text
    assert "if it verifies, the tracker moved" in remedy
    assert cart.run(CLOSED_AGAIN_WITHIN_S if bumped else 15.0, until=lambda: cart.closed) is bumped, cart.told()


REFERENCE_TOOL = rigid(rotation_from_vector(np.array([0.3, -0.5, 0.2])), np.array([150.0, -40.0, -1700.0]))
PROBE_PORT, REFERENCE_PORT = 1, 2


class ReferencedCart(Cart):
    """Its poses go through the assembly of an NDI tracker with a reference tool, which is measured once in so many
    measurements of the probe, as devices that measure kinds of tools in turn do.
    """

    def __init__(self, seed: int, one_in: int) -> None:
        super().__init__(seed, fps=15.0)
        self.reference_tool = REFERENCE_TOOL
        self._one_in = one_in
        spoken, device_clock = dialect(ReplyKind.BX2), DeviceClock()
        agreed = cast(Agreed, SimpleNamespace(dialect=spoken, tick_ns=1.0, device_clock=device_clock))
        tools = (Tool(port, None, None, five_dof=False) for port in (PROBE_PORT, REFERENCE_PORT))
        self.assembly = PoseAssembly(Bodies(*tools), agreed, latency_ms=0.0)

    def _deliver(self, sample: Sample) -> None:
        if not isinstance(sample, Pose) or sample.matrix is None:
            super()._deliver(sample)
            return
        t_ns = sample.stamp.t_ns
        seen = {PROBE_PORT: sample.matrix}
        if sample.sequence % self._one_in == 0:
            seen[REFERENCE_PORT] = self.tracker.moved @ self.reference_tool
        tools = {
            port: Reading((PoseStatus.OK, ""), transform_of(pose, 0.1), t_ns, sample.sequence)
            for port, pose in seen.items()
        }
        answer = Answer(Snapshot(tools), t_ns - 2_000_000, t_ns, detailed=False)
        if self.assembly.take(answer) and (measured := self.assembly.measured(answer)) is not None:
            super()._deliver(self.assembly.new_pose(measured, (PoseStatus.OK, "")))

    @property
    def remarks(self) -> tuple[str, ...]:
        return self.assembly.reference_place.remarks(round(self.t_s * 1e9) + ORIGIN_NS)


@pytest.mark.thorough
@pytest.mark.parametrize("one_in", [1, 3])
def test_with_a_reference_tool_a_bumped_camera_is_told_and_opens_nothing(one_in: int) -> None:
    cart = ReferencedCart(1, one_in)
    assert cart.run(VERIFIED_WITHIN_S, until=lambda: cart.closed), cart.told()
    cart.run(1.0)
    assert cart.remarks == ()
    cart.tracker.moved = BUMP
    assert not cart.run(4.0, until=lambda: not cart.closed), cart.told()
    assert "the tracker or the reference tool was moved" in cart.remarks[0]
    cart.tracker.moved = np.linalg.inv(BUMP)
    assert not cart.run(3.0, until=lambda: not cart.closed), cart.told()


@pytest.mark.thorough
def test_a_reference_tool_that_is_moved_is_named_as_a_bumped_camera_is_without_one() -> None:
    """All poses leap alike, so what the text says of the tracker holds of it: scanning on verifies again."""
    cart = ReferencedCart(1, 1)
    assert cart.run(VERIFIED_WITHIN_S, until=lambda: cart.closed), cart.told()
    cart.run(1.0)
    cart.reference_tool = BUMP @ REFERENCE_TOOL
    text, _ = told(cart)
    assert "Marker body or tracker" in text
    cart.run(4.0)
    assert "unless rotation or offset is named" in cart.remarks[0]
    assert cart.run(CLOSED_AGAIN_WITHIN_S, until=lambda: cart.closed), cart.told()
