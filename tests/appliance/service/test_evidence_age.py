"""The contact of a whole cart never outlives its evidence: a bend with a slide that no motion could show.

The real line over rendered pictures, in simulated time. With `pytest -s -m slow` it prints what was seen with the times
of the default configuration; the others take a shorter max_verification_age, so that they are over sooner.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from probewatch.appliance.limits import SWEPT_AGE_S
from probewatch.appliance.supervision.supervisor import TICK_NS
from probewatch.appliance.types import State
from probewatch.drivers.twins.faults import Episode, Schedule
from tests.support.simulated_cart import WorldCart

DISTURBANCES = {
    "one pose in twelve": "sparse-poses",
    "one future picture": "future-stamp",
    "flickering blank pictures": "flicker-blank",
}
SHIPPED_S = SWEPT_AGE_S
SHORTER_S = 12.0
WATCHED_S = {SHIPPED_S: 75.0, SHORTER_S: 35.0}
"""How old what a sweep shows may be → how long after the bend is watched."""

VERIFIED_WITHIN_S = 120.0
FRESH = 0.5
"""Share of max_verification_age that may have passed when the disturbance begins; older evidence opens the contact
sooner."""
DISTURBED_S, HIDDEN_S, BENT_S, SEEN_S = 0.0, 0.5, 0.8, 1.0
"""From the beginning of the disturbance: the body is bent while the tracker does not see it, as no leap then tells."""
TICK_S = TICK_NS / 1e9


@dataclass
class Watch:
    """What the service said, seconds of the cart. shown_s: the newest time at which motion showed the calibration.
    states: in order, with when each was first seen.
    """

    shown_s: float = 0.0
    ages: list[tuple[float, float]] = field(default_factory=list)
    states: list[tuple[float, str]] = field(default_factory=list)

    def look(self, cart: WorldCart) -> None:
        """Ask once; somebody in the room acknowledges whatever is latched."""
        asked_s, status = cart.now_s(), cart.status()
        age_s = status["verification_age_s"]
        if age_s is not None:
            self.shown_s = max(self.shown_s, cart.now_s() - age_s)
            self.ages.append((asked_s, age_s))
        told = f"{status['state']}, {status['fault'] or 'no fault'}"
        if not self.states or self.states[-1][1] != told:
            self.states.append((asked_s, told))
        if status["latched"] is not None and not status["acknowledged"]:
            cart.acknowledge()

    def until(self, cart: WorldCart, end_s: float) -> None:
        """Keep looking, once a tick."""
        while cart.now_s() < end_s:
            self.look(cart)


@contextmanager
def verified_cart(folder: Path, seed: int, age_s: float) -> Iterator[WorldCart]:
    """Its contact is closed, and what it was shown is fresh."""
    with WorldCart(folder, seed, f"supervisor.max_verification_age_s = {age_s}\n") as cart:
        cart.wait_for(State.MONITORING.value, VERIFIED_WITHIN_S)
        cart.until(lambda: cart.contact() and _fresh(cart, FRESH * age_s), VERIFIED_WITHIN_S)
        yield cart


def _fresh(cart: WorldCart, oldest_s: float) -> bool:
    age_s = cart.status().get("verification_age_s")
    return age_s is not None and age_s <= oldest_s


def bend_behind(cart: WorldCart, disturbance: str) -> tuple[float, float]:
    """Seconds of the cart at which the disturbance begins and the body is bent; both are soon."""
    began_s = cart.now_s() + 0.3
    cart.faults = Schedule(
        (
            Episode(disturbance, began_s + DISTURBED_S),
            Episode("missing", began_s + HIDDEN_S, began_s + SEEN_S),
            Episode("bend-marker", began_s + BENT_S),
            Episode("slide-marker", began_s + BENT_S),
        )
    )
    return began_s, began_s + BENT_S


@pytest.mark.parametrize(
    ("seed", "age_s"),
    [
        pytest.param(1, SHORTER_S, marks=pytest.mark.thorough),
        *(pytest.param(seed, SHIPPED_S, marks=pytest.mark.slow) for seed in (1, 2, 3)),
    ],
)
@pytest.mark.parametrize("disturbance", DISTURBANCES)
def test_a_bend_that_no_motion_shows_opens_the_contact_for_good(
    disturbance: str, seed: int, age_s: float, tmp_path: Path
) -> None:
    watch = Watch()
    with verified_cart(tmp_path, seed, age_s) as cart:
        began_s, bent_s = bend_behind(cart, DISTURBANCES[disturbance])
        watch.until(cart, bent_s + WATCHED_S[age_s])
        changes = cart.switched(began_s)
        counters = cart.status()["counters"]
    opened_s = next((t_s for t_s, closed in changes if not closed), float("inf"))
    told = "\n".join(f"{t_s - bent_s:8.2f} s  {what}" for t_s, what in watch.states)
    contact = ", ".join(f"{'closed' if closed else 'open'} at {t_s - bent_s:.2f} s" for t_s, closed in changes)
    print(
        f"\n{disturbance}, seed {seed}, {age_s:g} s: contact {contact or 'as it was'}; last shown "
        f"{watch.shown_s - bent_s:.2f} s; opened {opened_s - watch.shown_s:.2f} s after it\n{told}\n{counters}"
    )
    assert watch.shown_s <= bent_s, "younger than the bend"
    assert opened_s - bent_s <= age_s + TICK_S
    assert opened_s - watch.shown_s <= age_s + TICK_S
    assert not any(closed for t_s, closed in changes if t_s > bent_s), "closed again"
    assert all(asked_s - age <= bent_s for asked_s, age in watch.ages)
    assert (counters["early_stamps"] == 1) == (disturbance == "one future picture")
