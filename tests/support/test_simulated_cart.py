"""The cart in simulated time does the same every time, to the nanosecond, and waits for nobody's clock but its own."""

import threading
from pathlib import Path

import pytest

from tests.support.manual_clock import SteppedClock
from tests.support.simulated_cart import SimulatedCart


def day(folder: Path) -> tuple[object, ...]:
    """Half a minute, with an alarm, an acknowledgement, and a tracker that is away."""
    folder.mkdir()
    with SimulatedCart(folder) as cart:
        cart.monitoring()
        cart.run(2.0)
        cart.say("scale")
        cart.run(5.0)
        cart.say(None)
        granted = cart.acknowledge()
        cart.run(5.0)
        cart.tracker.plugged = False
        cart.run(5.0)
        cart.tracker.plugged = True
        cart.run(10.0)
        states = [(line["state"], line["fault"]) for line in cart.said(event="state")]
        return granted, states, cart.switched(), cart.status()["counters"]


def test_two_runs_are_the_same_to_the_nanosecond(tmp_path: Path) -> None:
    first, second = day(tmp_path / "first"), day(tmp_path / "second")
    assert first == second
    granted, states, switched, _ = first
    assert granted
    assert [state for state, _ in states][-3:] == ["device lost", "not verified", "monitoring"]
    assert [closed for _, closed in switched][-3:] == [True, False, True]


def test_a_thread_that_waits_is_woken_by_its_event_or_its_time_and_by_nothing_else() -> None:
    clock, event, seen = SteppedClock(), threading.Event(), list[tuple[int, bool]]()

    def wait() -> None:
        for _ in range(2):
            come = clock.wait(event, 1.0)
            event.clear()
            seen.append((clock.now_ns(), come))

    thread, began_ns = threading.Thread(target=wait), clock.now_ns()
    thread.start()
    clock.settle([thread])
    assert clock.next_ns() == began_ns + 1_000_000_000
    clock.move(began_ns + 999_999_999)
    clock.settle([thread])
    assert seen == []
    event.set()
    clock.settle([thread])
    assert seen == [(began_ns + 999_999_999, True)]
    clock.move(began_ns + 1_999_999_999)
    clock.settle([thread])
    thread.join()
    assert seen[1:] == [(began_ns + 1_999_999_999, False)]
    assert clock.next_ns() == float("inf")


def test_a_line_that_raises_is_an_estimator_that_has_ended(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    class Broken:
        relative_pose = None

        def __init__(self, *_: object) -> None: ...

        def step(self, _: object) -> tuple[()]:
            raise RuntimeError("as the test wishes")

    with SimulatedCart(tmp_path, Broken) as cart:
        cart.until(lambda: str(cart.status()["estimator"]).startswith("ended with exit code 1"))
        assert cart.status()["energised"] is False
    assert "as the test wishes" in capfd.readouterr().err
