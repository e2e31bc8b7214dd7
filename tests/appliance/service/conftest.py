"""Whole services in simulated time, one for each test: a start takes a tenth of a second."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.simulated_cart import SimulatedCart


@pytest.fixture
def cart(tmp_path: Path) -> Iterator[SimulatedCart]:
    """On a line that trusts every picture."""
    with SimulatedCart(tmp_path) as cart:
        yield cart


@pytest.fixture
def monitoring(cart: SimulatedCart) -> SimulatedCart:
    """Its contact is closed."""
    return cart.monitoring()
