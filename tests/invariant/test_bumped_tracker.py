"""A leap is of the marker body or of the tracker's camera: the text names both, and scanning on tells them apart."""

import numpy as np
import pytest

from appliance.supervision.alarms import operator_text
from drivers.rigid import rigid, rotation_from_vector
from tests.invariant.cart import Cart
from tests.invariant.machine import CLOSED_AGAIN_WITHIN_S
from tests.invariant.scenarios import verified_cart
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
