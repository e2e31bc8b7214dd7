"""`probewatch simulate cart`: what it refuses; a whole cart beside a service is in tests/live/test_simulate_cart.py."""

import pytest

from tests.support.answers import answered


@pytest.mark.parametrize("option", ["--write", "--folder"])
def test_a_place_that_cannot_be_is_refused_before_anything_starts(option: str) -> None:
    refused = answered("simulate", "cart", option, "/dev/null/at/all")
    assert (refused.returncode, refused.stdout) == (78, "")
    assert "/dev/null/at/all" in refused.stderr
