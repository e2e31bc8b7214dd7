"""A bent marker body on a cart: what motion says of it is proposed, written down, taken by a person, verified."""

from pathlib import Path

import pytest

from probewatch.drivers.twins.faults import Episode, Schedule
from tests.support.answers import Answer, answered
from tests.support.simulated_cart import WorldCart

SHOWN_S = 60.0
"""Of the cart, for motion to measure a bent body, and to verify the calibration that was made of it."""


def ran(cart: WorldCart, *words: object) -> Answer:
    with cart.served():
        return answered("calibration", *words, "--socket", cart.socket)


@pytest.mark.thorough
def test_a_bent_body_is_recovered_without_a_phantom_and_never_by_itself(tmp_path: Path) -> None:
    with WorldCart(tmp_path) as cart:
        cart.until(lambda: cart.status()["energised"], SHOWN_S)
        assert cart.status()["proposal"] is None
        new = tmp_path / "new.toml"
        refused = ran(cart, "recover", "--output", new)
        assert refused.returncode == 78
        assert "proposes nothing" in refused.stderr
        cart.faults = Schedule((Episode("bend-marker", cart.now_s() + 0.3),))
        cart.until(lambda: (cart.status()["proposal"] or {}).get("image_to_probe"), SHOWN_S)
        assert not cart.status()["energised"]
        written = ran(cart, "recover", "--output", new)
        assert written.returncode == 0, written.stderr
        assert "rotation-" in written.stdout
        assert cart.status()["reference"]["number"] == 1, "nothing is applied"
        taken = ran(cart, "use", new, "--yes", "--wait", 60)
        assert taken.returncode == 0, taken.stdout + taken.stderr
        assert cart.status()["reference"]["number"] == 2
