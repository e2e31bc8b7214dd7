"""Models the hand that moves the simulated probe: a seeded, smooth pose of the picture in the tissue.

Every program is a sum of sine waves per axis, so the motion has derivatives of all orders; the one pause of the
clinical sweep bends time itself, and the verification gesture comes and goes, smoothly to the second derivative.
"""

from dataclasses import dataclass
from math import pi, radians, sin

import numpy as np
from scipy.spatial.transform import Rotation

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.samples import Matrix4

_AXES = ("lateral_mm", "axial_mm", "elevational_mm", "tilt_lateral_deg", "tilt_axial_deg", "turn_deg")

_Waves = dict[str, tuple[tuple[float, float], ...]]

_SWEEP: _Waves = {
    "lateral_mm": ((7.0, 7.4), (0.7, 2.7)),
    "axial_mm": ((4.2, 5.3), (0.5, 2.1)),
    "elevational_mm": ((0.14, 11.0),),
    "tilt_lateral_deg": ((1.4, 8.7),),
    "tilt_axial_deg": ((1.2, 6.3),),
    "turn_deg": ((6.2, 9.3),),
}
_PROGRAMS: dict[str, _Waves] = {
    "sweep": _SWEEP,
    "gestured": _SWEEP,
    "still": {},
    "elevational": {"elevational_mm": ((4.0, 9.0),)},
    "lateral": {"lateral_mm": ((8.0, 7.5),)},
    "rotation": {"turn_deg": ((7.0, 8.0),)},
    "freehand": {
        "lateral_mm": ((5.0, 11.0),),
        "axial_mm": ((4.0, 7.0),),
        "elevational_mm": ((2.5, 2.3),),
        "tilt_lateral_deg": ((17.0, 14.0),),
        "tilt_axial_deg": ((15.0, 9.5),),
        "turn_deg": ((8.0, 17.0),),
    },
    "guided": {
        "lateral_mm": ((14.0, 37.0),),
        "axial_mm": ((9.0, 23.0),),
        "elevational_mm": ((2.5, 2.3),),
        "tilt_lateral_deg": ((17.0, 29.0),),
        "tilt_axial_deg": ((15.0, 17.5),),
        "turn_deg": ((14.0, 43.0),),
    },
}
"""Program → axis → (amplitude, period in s) of each wave; tilts and turn are a rotation vector about x, y, z."""

PROGRAMS = tuple(sorted(_PROGRAMS))
USUAL_PROGRAM = "gestured"
"""Program of simulated devices: a cart's contact closes only after the gesture, so their hand makes it by itself."""

_GESTURE: _Waves = {
    "tilt_lateral_deg": ((6.0, 3.4),),
    "tilt_axial_deg": ((6.0, 3.0),),
    "turn_deg": ((5.0, 2.6),),
}
"""Waves that "gestured" adds to the sweep now and then, the verification gesture (docs/gesture.md): fan, twist and
rock. The sweep slides and presses by itself."""
_GESTURE_FROM_S, _GESTURE_TO_S, _GESTURE_EASE_S = 4.0, 10.0, 1.2
"""Seconds within each cycle of the sweep: after the service has started, and before the rest. Quicker easing jerks the
probe."""

_MOVES_S, _EASES_S, _RESTS_S = 10.0, 1.0, 1.0
"""Seconds. A clinical sweep rests now and then; checks must tolerate it. In 26 s the hand is at rest for 1.5 to 4 s
(tests/drivers/twins/test_world.py). Longer rests leave less motion to verify by."""


def _moved_s(t_s: float) -> float:
    """Returns the time for which the hand has moved: 10 s, a stop eased in over 1 s, 1 s of rest, a start eased over 1
    s, and again.
    """
    cycles, t_s = divmod(t_s, _MOVES_S + 2 * _EASES_S + _RESTS_S)
    stopping = min(max((t_s - _MOVES_S) / _EASES_S, 0.0), 1.0)
    starting = min(max((t_s - _MOVES_S - _EASES_S - _RESTS_S) / _EASES_S, 0.0), 1.0)
    eased = stopping - (stopping**3 - stopping**4 / 2) + (starting**3 - starting**4 / 2)
    return cycles * (_MOVES_S + _EASES_S) + min(t_s, _MOVES_S) + _EASES_S * eased


def _gestured(moved_s: float) -> float:
    """Returns the share of the gesture, 0 … 1, when the hand has moved for moved_s."""
    since_s = moved_s % (_MOVES_S + _EASES_S)
    come = min(max((since_s - _GESTURE_FROM_S) / _GESTURE_EASE_S, 0.0), 1.0)
    gone = min(max((_GESTURE_TO_S - since_s) / _GESTURE_EASE_S, 0.0), 1.0)
    share = min(come, gone)
    return share**3 * (10 - 15 * share + 6 * share**2)


@dataclass(frozen=True, slots=True)
class _Wave:
    amplitude: float
    period_s: float
    phase_rad: float

    def at(self, t_s: float) -> float:
        return self.amplitude * sin(2 * pi * t_s / self.period_s + self.phase_rad)


def _drawn(waves: tuple[tuple[float, float], ...], random: np.random.Generator) -> tuple[_Wave, ...]:
    """Draws waves with phases within ±45° of the zero crossing, so that the hand moves from the first instant on."""
    return tuple(
        _Wave(size * random.uniform(0.9, 1.05), period_s * random.uniform(0.95, 1.08), random.uniform(-0.8, 0.8))
        for size, period_s in waves
    )


class Trajectory:
    """Computes the poses of one program. Amplitudes, periods and phases vary by some percent with the seed.

    Raises ConfigurationError for a program that does not exist.
    """

    def __init__(self, seed: int, program: str) -> None:
        if program not in _PROGRAMS:
            known = ", ".join(PROGRAMS)
            raise ConfigurationError(f"'{program}' is not a known motion", "trajectory", f"Use one of {known}")
        self._pauses = program in ("sweep", "gestured")
        random = np.random.default_rng((seed, 11))
        self._waves = {axis: _drawn(_PROGRAMS[program].get(axis, ()), random) for axis in _AXES}
        asked = _GESTURE if program == "gestured" else {}
        self._gesture = {axis: _drawn(asked.get(axis, ()), random) for axis in _AXES}

    def _axis(self, axis: str, t_s: float, gestured: float) -> float:
        usual = sum(wave.at(t_s) for wave in self._waves[axis])
        return usual + gestured * sum(wave.at(t_s) for wave in self._gesture[axis])

    def pose(self, t_s: float) -> Matrix4:
        """Returns the pose, (4, 4) picture P → tissue C, mm, at world time t_s.

        The tissue's origin (the crossing of a cross-wire) stays at the programmed place of the picture whatever the
        tilt, so freehand motion circles about it.
        """
        if self._pauses:
            t_s = _moved_s(t_s)
        share = _gestured(t_s)
        place_mm = [self._axis(axis, t_s, share) for axis in _AXES[:3]]
        turn_rad = [radians(self._axis(axis, t_s, share)) for axis in _AXES[3:]]
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_rotvec(turn_rad).as_matrix()
        pose[:3, 3] = -pose[:3, :3] @ place_mm
        return pose
