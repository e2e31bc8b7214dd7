"""What windows show together, against closed forms and against simulated examinations whose truth is known."""

from itertools import pairwise, product
from math import sqrt

import numpy as np
import pytest

from probewatch.appliance.core.parameters import MEASURED, QUANTITIES, class_of
from probewatch.appliance.core.quality.accumulation import accumulated, pooled
from probewatch.appliance.core.quality.trend import Estimate
from probewatch.appliance.types import PARAMETERS, VerdictKind
from probewatch.tools.development.false_alarms import Played, Quiet
from probewatch.tools.study.session import Session

LEFT_OUT = 0.25
EVERY_S, DAY_S = 300.0, 86_400.0


def day(seed: int, days: int, count: int, own: float, between: float) -> list[Estimate]:
    """`count` estimates a day of a parameter that is 0; between: what each day leaves out."""
    random = np.random.default_rng(seed)
    return [
        Estimate(k * DAY_S + i * EVERY_S, left + own * float(random.standard_normal()), sqrt(own**2 + LEFT_OUT**2))
        for k in range(days)
        for left in [between * float(random.standard_normal())]
        for i in range(count)
    ]


def test_windows_of_one_examination_come_to_what_they_share() -> None:
    one = sqrt(0.6**2 + LEFT_OUT**2)
    assert pooled([0.3], [one], LEFT_OUT) == (pytest.approx(0.3), pytest.approx(one))
    value, sigma = pooled([1.0] * 36, [one] * 36, LEFT_OUT)
    assert (value, sigma) == (pytest.approx(1.0), pytest.approx(sqrt(0.1**2 + LEFT_OUT**2)))


def test_a_better_window_weighs_more_and_none_weighs_for_all() -> None:
    value, _ = pooled([0.0, 1.0], [sqrt(0.1**2 + LEFT_OUT**2), sqrt(0.2**2 + LEFT_OUT**2)], LEFT_OUT)
    assert 0.2 <= value < 0.5, "0.2 by the stated sigmas, half by so wide a scatter"
    value, sigma = pooled([0.0, 1.0], [LEFT_OUT, LEFT_OUT], LEFT_OUT)
    assert (value, sigma > LEFT_OUT) == (pytest.approx(0.5), True)


def test_nothing_shows_nothing() -> None:
    assert accumulated([], LEFT_OUT) is None
    with pytest.raises(ValueError, match="no window"):
        pooled([], [], LEFT_OUT)


def test_the_sigma_of_days_alike_is_that_of_their_mean() -> None:
    """Without any scatter the stated left-out counts as two days, so n days have 2 / (1 + n) of its variance each."""
    own = sqrt(0.2**2 + LEFT_OUT**2)
    for days in (1, 2, 9, 30):
        found = accumulated([Estimate(k * DAY_S, 0.7, own) for k in range(days)], LEFT_OUT)
        assert found is not None
        variance = (0.2**2 + LEFT_OUT**2 * 2 / (1 + days)) / days
        assert (found.value, found.sigma) == (pytest.approx(0.7), pytest.approx(sqrt(variance)))
        assert (found.estimates, found.examinations) == (days, days)


@pytest.mark.parametrize("between", [0.0, 0.25, 0.75])
@pytest.mark.parametrize("days", [1, 5, 40])
def test_what_is_stated_covers_the_truth(between: float, days: int) -> None:
    """Of 400 carts each. What one day leaves out is told as stated; of many it is learned, be it three times that."""
    found = [one for seed in range(400) if (one := accumulated(day(seed, days, 6, 0.4, between), LEFT_OUT))]
    spread = sqrt(np.mean([(one.value / one.sigma) ** 2 for one in found]))
    most = {1: max(1.0, between / LEFT_OUT) * 1.1, 5: 1.4, 40: 1.15}[days]
    assert spread < most
    if between == LEFT_OUT or days == 40:
        assert spread > 0.5
    if days == 40:
        assert np.median([one.between for one in found]) == pytest.approx(between, abs=0.1)


def test_sigma_falls_with_all_motion() -> None:
    """Half the sigma of four times as many days."""
    carts = [
        [accumulated(day(seed, days, 6, 0.4, LEFT_OUT), LEFT_OUT) for days in (1, 4, 16, 64)] for seed in range(50)
    ]
    sigmas = np.median([[one.sigma for one in cart if one] for cart in carts], axis=0)
    assert all(1.8 < before / now < 2.4 for before, now in pairwise(sigmas))


def test_a_pause_for_lunch_begins_another_examination() -> None:
    times_s = [0.0, 300.0, 600.0, 600.0 + 1801.0, 4000.0]
    found = accumulated([Estimate(t, 0.0, 0.3) for t in times_s], LEFT_OUT)
    assert found is not None
    assert found.examinations == 2


class _Listened(Played):
    """Keeps the windows of each parameter that share no motion, s of their middle → (value, sigma)."""

    def __init__(self, quiet: Quiet) -> None:
        self.windows = dict[str, list[tuple[float, float, float]]]()
        super().__init__(quiet)

    def _take(self, now_ns: int, since_ns: int, t_s: float) -> None:
        super()._take(now_ns, since_ns, t_s)
        for check in self._evidence.checks():
            if check.name in MEASURED and check.verdict is VerdictKind.OK and check.shown_ns is not None:
                known, shown_s = self.windows.setdefault(check.name, []), check.shown_ns / 1e9
                if not known or shown_s - known[-1][0] >= 30.0:
                    known.append((shown_s, check.value, check.sigma))


@pytest.mark.slow
def test_examinations_of_minutes_come_to_the_truth_within_a_third_of_a_gestures_sigma() -> None:
    """Seven of 300 s: one came to .43 to .77 of a gesture's sigma, all to .16 to .25, at z-scores of −1.7 to 1.4."""
    estimates = {name: list[Estimate]() for name in MEASURED}
    of_gesture = {name: list[float]() for name in MEASURED}
    for day, (seed, tissue) in enumerate(product((11, 12, 13), ("still", "breathing"))):
        for name, windows in _Listened(
            Quiet(Session("gesture-mixed", tissue, seed, 300.0), "gaussian")
        ).windows.items():
            of_gesture[name].append(windows[0][2])
            value, sigma = pooled([one[1] for one in windows], [one[2] for one in windows], left_out(name))
            estimates[name].append(Estimate(day * DAY_S, value, sigma))
    for name in PARAMETERS:
        found = accumulated(estimates[name], left_out(name))
        assert found is not None
        print(f"{name}: {found}, of a gesture {np.median(of_gesture[name]):.3f}")
        assert abs(found.value) < 3 * found.sigma, name
        assert found.sigma < np.median(of_gesture[name]) / 3, name


def left_out(name: str) -> float:
    return QUANTITIES[class_of(name)].left_out
