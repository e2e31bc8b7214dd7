"""Measures the quality of a source's timestamps. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from probewatch.drivers.samples import Frame, Pose, PoseStatus

LEAST_HZ = {"video": 10.0, "tracker": 15.0}
"""Samples per second: half of the slowest rate that the line was measured with (docs/study.md). Fewer verify too
late."""
MOST_JITTER_MS = 15.0
"""ms, scatter of stamps about the straight line: a quarter of the shipped limit of the latency, 60 ms. Less rejects
grabbers that work; more hides what spoils the latency."""


@dataclass(frozen=True, slots=True)
class TimeQuality:
    """Describes the quality of the times in one stretch of samples; NaN where too few came. Bounds and delays are those
    of what the device measured: where it has sent nothing, a driver reports that with a stamp of its own, with a bound
    of 0.

    rate_hz: samples per second of their own time. step: usual count of the device's counter between two samples.
    bound_ms, worst_bound_ms: median and largest stated error bound. jitter_ms: standard deviation of the stamps about
    the best straight line over the counter. delay_ms, worst_delay_ms: time from stamp to arrival, median and largest.
    gaps: how often the counter stepped further than usual; lost: number of samples missing there. longest_ms: the
    longest time between two stamps.
    """

    samples: int
    rate_hz: float
    step: int
    bound_ms: float
    worst_bound_ms: float
    jitter_ms: float
    delay_ms: float
    worst_delay_ms: float
    gaps: int
    lost: int
    longest_ms: float


def time_quality(samples: Sequence[Frame | Pose], arrivals_ns: Sequence[int]) -> TimeQuality | None:
    """Returns the quality of the times of samples in the order in which they were read, each with its arrival on the
    same clock, ns; None for fewer than three.
    """
    if len(samples) < 3:
        return None
    t_ms = np.array([sample.stamp.t_ns - samples[0].stamp.t_ns for sample in samples]) / 1e6
    counts = np.array([sample.sequence for sample in samples], float)
    # A missing pose with a bound of 0 was stamped by the driver and shows nothing of the device's own stamps.
    of_device: list[tuple[float, float]] = [
        (arrival_ns - sample.stamp.t_ns, sample.stamp.err_ns)
        for arrival_ns, sample in zip(arrivals_ns, samples, strict=True)
        if isinstance(sample, Frame) or sample.status is not PoseStatus.MISSING or sample.stamp.err_ns > 0
    ]
    delays_ms, bounds_ms = np.array(of_device or [(np.nan, np.nan)]).T / 1e6
    # A device may count faster than it sends, so the median step is the usual one; a wider step is a gap.
    steps = np.diff(counts)
    usual = max(1.0, float(np.median(steps)))
    wide = steps > 1.5 * usual
    return TimeQuality(
        samples=len(samples),
        rate_hz=float(1e3 * (len(samples) - 1) / max(t_ms[-1], 1e-6)),
        step=round(usual),
        bound_ms=float(np.median(bounds_ms)),
        worst_bound_ms=float(bounds_ms.max()),
        jitter_ms=_jitter_ms(t_ms, counts),
        delay_ms=float(np.median(delays_ms)),
        worst_delay_ms=float(delays_ms.max()),
        gaps=int(wide.sum()),
        lost=int(np.sum(np.round(steps[wide] / usual) - 1)),
        longest_ms=float(np.diff(t_ms).max()),
    )


def _jitter_ms(t_ms: np.ndarray, counts: np.ndarray) -> float:
    """Returns the jitter; NaN for a counter that did not advance, or went backwards."""
    if np.any(np.diff(counts) <= 0):
        return float("nan")
    line = np.polynomial.Polynomial.fit(counts, t_ms, 1)
    return float(np.std(t_ms - line(counts)))
