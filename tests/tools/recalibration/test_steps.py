"""The latency step: it says when it has enough, and does not wait for ever on a minute that shows nothing."""

import numpy as np

from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp
from probewatch.tools.recalibration.steps import MOST_PICTURES, LatencyStep
from probewatch.tools.recalibration.terminal import latency_text

RATE_HZ = 30


def minute(amplitude_mm: float, late_s: float = 0.05) -> LatencyStep:
    """Of as many pictures as are kept, of a bottom that moves so far; and two more."""
    step, rows = LatencyStep(), np.arange(120)
    for index in range(MOST_PICTURES + 2):
        t_s = index / RATE_HZ
        row = 60 + _height_mm(t_s, amplitude_mm) / 0.3
        line = 20 + 200 * np.exp(-(((rows - row) / 2) ** 2))
        stamp = Stamp(10**9 + round(t_s * 1e9), 500)
        step.take(Frame(stamp, index, np.repeat(line.astype(np.uint8)[:, None], 8, axis=1)))
        pose = np.eye(4)
        pose[:3, 3] = np.array([0.2, 0.9, 0.4]) * _height_mm(t_s - late_s, amplitude_mm)
        step.take(Pose(stamp, index, pose, 0.1, PoseStatus.OK))
    return step


def _height_mm(t_s: float, amplitude_mm: float) -> float:
    return amplitude_mm * float(np.sin(2 * np.pi * t_s / 2.3) + 0.3 * np.sin(2 * np.pi * t_s / 0.9))


def test_a_full_minute_that_shows_it_says_that_it_is_enough_and_takes_no_more() -> None:
    step = minute(10.0)
    step.solve()
    told = step.fields()
    assert (told["pictures"], told["full"], told["begun_anew"]) == (MOST_PICTURES, True, 0)
    assert abs(told["latency_ms"] - 50) < 5
    assert latency_text(told).endswith("· enough is collected: take it")


def test_a_minute_that_shows_nothing_is_begun_anew_and_says_so() -> None:
    step = minute(0.0)
    assert step.full
    step.solve()
    told = step.fields()
    assert (told["pictures"], told["full"], told["latency_ms"], told["begun_anew"]) == (0, False, None, 1)
    assert "started again" in latency_text(told)
    step.take(Frame(Stamp(1, 1), 1, np.zeros((120, 8), np.uint8)))
    assert step.fields()["pictures"] == 1, "it collects again"


def test_before_it_is_full_nothing_is_said_of_that() -> None:
    step = LatencyStep()
    step.take(Frame(Stamp(1, 1), 1, np.zeros((120, 8), np.uint8)))
    step.solve()
    assert latency_text(step.fields()) == "bottom seen in 0 of 1 pictures · not known yet"
