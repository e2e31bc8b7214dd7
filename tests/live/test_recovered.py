"""A bent marker body on a whole cart: what motion says of it is proposed, written down, taken by a person, verified."""

import subprocess
from pathlib import Path

from drivers.twins.faults import Episode, Schedule
from tests.support.demo_cart import PROBEWATCH, Cart
from tests.support.polling import until

RATE = 0.2
"""Of the cart's time: recovering takes about a minute of it, and no computer is too busy for a fifth of it."""
SHOWN_S = 60.0
"""Of the cart, for motion to measure a bent body, and to verify the calibration that was made of it."""


def ran(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(PROBEWATCH), *map(str, words)], capture_output=True, text=True, timeout=600, check=False)


def test_a_bent_body_is_recovered_without_a_phantom_and_never_by_itself(tmp_path: Path) -> None:
    with Cart(tmp_path, seed=1, rate=RATE) as cart:
        until(lambda: cart.status().get("energised"), SHOWN_S / RATE, 0.25, cart.status)
        assert cart.status()["proposal"] is None
        new, socket = tmp_path / "new.toml", ("--socket", cart.socket)
        refused = ran("calibration", "recover", "--output", new, *socket)
        assert refused.returncode == 78
        assert "proposes nothing" in refused.stderr
        cart.show_faults(Schedule((Episode("bend-marker", cart.now_s() + 0.3),)))
        until(lambda: (cart.status()["proposal"] or {}).get("image_to_probe"), SHOWN_S / RATE, 0.25, cart.status)
        assert not cart.status()["energised"]
        written = ran("calibration", "recover", "--output", new, *socket)
        assert written.returncode == 0, written.stderr
        assert "rotation-" in written.stdout
        assert cart.status()["reference"]["number"] == 1, "nothing is applied"
        taken = ran("calibration", "use", new, "--yes", "--wait", 600, *socket)
        assert taken.returncode == 0, taken.stdout + taken.stderr
        assert cart.status()["reference"]["number"] == 2
