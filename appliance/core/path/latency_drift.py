"""Tracks a latency that drifts: what short windows found at their middles is extrapolated to now."""

from collections import deque
from math import hypot, sqrt

import numpy as np

from probewatch.appliance.core.path.latency import Latency
from probewatch.appliance.core.times import CHANGE_WINDOW_NS

_SPAN_NS, _LEAST_NS = 3 * CHANGE_WINDOW_NS // 2 + 250_000_000, 3 * CHANGE_WINDOW_NS // 2 - 250_000_000
"""Span, ns, of the estimates on the line, at most and at least; one estimate comes each .33 s. Much below one and a
half windows, a step within the limit looks like a drift beyond it; with a longer span, a drift is named later: at 10 ms
per s from 0, six seconds name it at 77 to 80 ms.
"""
_FLOOR_S = 0.002
"""Least scatter, s, of the estimates about the line that is believed. Those of a healthy hand scatter by 1 to 2 ms."""
_SHARPEST_S = 0.015
"""Sigma, s, up to which an estimate counts: a quarter of the limit as shipped. Not measured."""
_OVERLAP_NS = CHANGE_WINDOW_NS // 2
"""Time, ns, below which estimates are too close to one another to be independent: half of their window."""
_SIGNIFICANT = 4.0
"""Number of sigmas from which a rate is a drift. Less extrapolates noise, more leaves a slow drift to the windows. Not
measured.
"""


class LatencyDrift:
    """Tracks the estimates of the last seconds, and the line through them."""

    def __init__(self) -> None:
        self._estimates: deque[tuple[int, float]] = deque()

    def clear(self) -> None:
        """Discards all estimates."""
        self._estimates.clear()

    def note(self, t_ns: int, latency: Latency) -> None:
        """Takes the next estimate, which is of t_ns; one that is not later, or too uncertain, is left out."""
        if not latency.sigma_s <= _SHARPEST_S or (self._estimates and t_ns <= self._estimates[-1][0]):
            return
        self._estimates.append((t_ns, latency.value_s))
        while t_ns - self._estimates[0][0] > _SPAN_NS:
            self._estimates.popleft()

    def carried_to(self, now_ns: int) -> Latency | None:
        """Returns the latency at now_ns; None where it does not drift, or too little is known."""
        if len(self._estimates) < 2 or self._estimates[-1][0] - self._estimates[0][0] < _LEAST_NS:
            return None
        if now_ns - self._estimates[-1][0] > _SPAN_NS:
            return None
        t_s = np.array([t_ns - now_ns for t_ns, _ in self._estimates]) / 1e9
        values = np.array([value for _, value in self._estimates])
        middle_s, spread = float(t_s.mean()), float(np.square(t_s - t_s.mean()).mean())
        rate = float((t_s - middle_s) @ values) / (spread * t_s.size)
        left = values - values.mean() - rate * (t_s - middle_s)
        scatter_s = max(sqrt(float(np.square(left).mean())), _FLOOR_S)
        # Windows overlap, so the estimates are fewer than they seem.
        independent = float(np.ptp(t_s)) / (_OVERLAP_NS / 1e9)
        rate_sigma = scatter_s / sqrt(independent * spread)
        if abs(rate) < _SIGNIFICANT * rate_sigma:
            return None
        value = float(values.mean()) - rate * middle_s
        return Latency(value, hypot(scatter_s / sqrt(independent), rate_sigma * middle_s))
