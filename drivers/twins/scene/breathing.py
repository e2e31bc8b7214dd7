"""Models how tissue moves by itself: breath and pulse. It is seeded; time is an argument."""

import numpy as np

from probewatch.drivers.rigid import Array

_BREATH_HZ, _JITTER = 0.25, 0.1
"""Rate of quiet breathing, and how much period and depth of one breath differ from the next (standard deviation)."""
_PULSE_MM, _PULSE_HZ = 0.3, 1.1
"""Millimetres, peak to peak, beside a large vessel, and Hz."""

DIRECTIONS = {
    "lateral": (1.0, 0.0, 0.0),
    "axial": (0.0, 1.0, 0.0),
    "elevational": (0.0, 0.0, 1.0),
    "oblique": (1 / 3, (1 - 1 / 9 - 9 / 16) ** 0.5, 3 / 4),
}
"""Unit vectors in the axes of the tissue. Organs follow the diaphragm, mostly along the body, and a picture sees that
sideways or out of its plane as often as along its axis. Oblique: a third sideways, three quarters out of plane."""


class Rhythm:
    """Draws one person's breath and pulse for duration_s seconds."""

    def __init__(self, seed: int, duration_s: float) -> None:
        random = np.random.default_rng((seed, 59))
        breaths = int(duration_s * _BREATH_HZ * 2) + 2
        jitter = np.clip(1 + _JITTER * random.standard_normal((2, breaths)), 0.6, 1.4)
        first_s = -random.uniform(0, 1 / _BREATH_HZ)
        self._starts_s = np.concatenate([[first_s], jitter[0] / _BREATH_HZ]).cumsum()
        self._depth = jitter[1]
        self._phase_rad = random.uniform(0, 2 * np.pi)

    def breath_mm(self, t_s: Array, peak_to_peak_mm: float) -> Array:
        """Returns the displacement by breath, (n,) mm, from the end of breathing in. The tissue lingers at the end of
        breathing out, where the fourth power of the cosine is flat; both ways take as long.
        """
        number = np.searchsorted(self._starts_s, t_s, side="right") - 1
        share = (t_s - self._starts_s[number]) / np.diff(self._starts_s)[number]
        return np.asarray(peak_to_peak_mm * self._depth[number] * (1 - np.cos(np.pi * share) ** 4))

    def pulse_mm(self, t_s: Array) -> Array:
        """Returns the pulse, (n,) mm along the axis."""
        return np.asarray(_PULSE_MM / 2 * np.sin(2 * np.pi * _PULSE_HZ * t_s + self._phase_rad))
