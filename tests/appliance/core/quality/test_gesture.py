"""The gesture that is asked for shows what is missing, by bounds that were not made by the line."""

from itertools import combinations

import numpy as np
import pytest

from probewatch.appliance.core.parameters import MEASURED, PER_UNIT, limit_of_each
from probewatch.appliance.core.quality.gesture import Gesture, gestures
from probewatch.appliance.limits import Limits
from probewatch.drivers.rigid import Array
from probewatch.tools.study import hand
from probewatch.tools.study.bound import bounds
from probewatch.tools.study.session import Session

LIMITS = Limits()
MOST = dict(zip(MEASURED, PER_UNIT * limit_of_each(LIMITS), strict=True))
ROWS = {
    Gesture.SIDEWAYS: (0, 5.0, 1.75, 0.0),
    Gesture.PRESS: (1, 3.0, 0.65, np.pi / 2),
    Gesture.ROCK: (5, 8.0, 1.4, 0.0),
    Gesture.TWIST: (4, 8.0, 2.15, 0.0),
    Gesture.TILT: (3, 8.0, 2.65, 0.0),
}
"""Row of a program, amplitude mm or deg, period s, phase: what the words of the gesture ask for."""


def shown_by(wanted: tuple[Gesture, ...], monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Parameters that five seconds of it show within their limits, by the Cramér–Rao bound."""

    def program(t_s: Array, random: np.random.Generator) -> Array:
        rows = hand.tremor(t_s, random, 0.3)
        for gesture in wanted:
            row, amplitude, period_s, phase = ROWS[gesture]
            rows[row] += amplitude * np.sin(2 * np.pi * t_s / period_s + phase)
        return rows

    monkeypatch.setitem(hand.ALL, "gesture", (program, 5.0))  # type: ignore[arg-type]
    sigmas = bounds.__wrapped__(Session("gesture", "still", 1, 5.0), 0.1, 0.02, 5.0)
    found = dict(zip(MOST, sigmas, strict=True))
    return {name for name, most in MOST.items() if LIMITS.confidence_sigma * found[name] <= most}


@pytest.mark.parametrize("name", MOST)
def test_the_gesture_for_a_parameter_shows_it(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert name in shown_by(gestures([name]), monkeypatch)


def test_the_gesture_for_everything_shows_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = gestures([*MOST, "polarity"])
    assert wanted == tuple(Gesture)
    assert shown_by(wanted, monkeypatch) == set(MOST)


@pytest.mark.parametrize("name", MOST)
def test_without_it_the_parameter_stays_unshown(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """So nothing needless is asked for: no fewer of its motions show it."""
    wanted = gestures([name])
    for fewer in combinations(wanted, len(wanted) - 1):
        assert name not in shown_by(fewer, monkeypatch) or name in ("latency", "rotation-elevational")


def test_nothing_missing_asks_for_nothing() -> None:
    assert gestures(()) == ()
