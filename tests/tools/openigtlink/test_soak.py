"""A quarter of an hour of OpenIGTLink traffic as fast as it goes leaves nothing behind; 8 h are `make igtl-soak`."""

from collections.abc import Callable

import pytest

from tests.tools.openigtlink import soak

HOURS = 0.25


@pytest.mark.thorough
@pytest.mark.parametrize("half", [soak.incoming, soak.outgoing])
def test_a_quarter_of_an_hour_leaks_nothing(half: Callable[[float], soak.Half]) -> None:
    found = half(HOURS)
    assert found.messages >= HOURS * soak.HOUR_S * soak.ROUNDS_HZ
    assert not found.leaks, found
