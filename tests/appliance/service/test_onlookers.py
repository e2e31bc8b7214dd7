"""Who asks the service how the cart is, in simulated time: what is told is true at every moment."""

from concurrent.futures import ThreadPoolExecutor

from probewatch.appliance.service.control.status_fields import STATUS
from probewatch.appliance.supervision.supervisor import TICK_NS
from probewatch.tools.monitoring.reading import Exposition
from tests.support.answering import RECORDED
from tests.support.simulated_cart import SimulatedCart

TICK_S = TICK_NS / 1e9


def test_every_key_that_was_recorded_is_still_in_the_status(monitoring: SimulatedCart) -> None:
    """Fields that a later version added may be missing from the recording."""
    always = {field.name for field in STATUS if not field.later}
    assert always <= RECORDED.keys() <= monitoring.status().keys(), "tests/data/status.json is of another version"


def moments_closed(switched: list[tuple[float, bool]], from_s: float, to_s: float) -> bool:
    """Whether the contact was closed at some time between the two."""
    closed = False
    for t_s, energised in switched:
        if t_s > to_s:
            break
        closed = energised if t_s <= from_s else closed or energised
    return closed


class Asking:
    """Two who ask for the metrics at the same time, again and again. seen: from when to when, and whether closed."""

    def __init__(self, cart: SimulatedCart) -> None:
        self._cart, self._exposition = cart, Exposition(cart.socket)
        self.seen: list[tuple[float, float, bool]] = []

    def during(self, seconds: float) -> None:
        end_s = self._cart.now_s() + seconds
        with ThreadPoolExecutor(2) as pool:
            while (from_s := self._cart.now_s()) < end_s:
                with self._cart.served(TICK_S):
                    texts = [one.result() for one in [pool.submit(self._exposition.text) for _ in range(2)]]
                for text in texts:
                    closed = b"\nprobewatch_contact_closed 1.0\n" in text
                    self.seen.append((from_s, self._cart.now_s(), closed))


def test_the_metrics_never_say_closed_while_the_contact_is_open(cart: SimulatedCart) -> None:
    """Over a run with faults, by the relay board's own clock, to the tick; and it changes nothing."""
    asking = Asking(cart)
    for fault in ("scale", "polarity", None):
        asking.during(1.5)
        cart.say(fault)
        if fault is not None:
            asking.during(3.0)
            cart.say(None)
            assert cart.acknowledge()
    asking.during(1.0)
    cart.kill_estimator()
    asking.during(3.0)
    cart.scanner.plugged = False
    asking.during(2.0)
    said = [one for one in asking.seen if one[2]]
    wrong = [one for one in said if not moments_closed(cart.switched(), one[0], one[1])]
    assert not wrong, f"{len(wrong)} of {len(asking.seen)}: {wrong[:3]}, {cart.switched()}"
    assert len(said) > 20
    assert len(asking.seen) - len(said) > 20
    assert sum(not energised for _, energised in cart.switched()) >= 4, "the contact opened in each of the faults"
