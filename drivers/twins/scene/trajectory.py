"""The hand that moves the simulated probe: a seeded, smooth pose of the picture in the tissue.

Every program is a sum of sine waves per axis, so the motion has derivatives of all orders; the one pause of the
clinical sweep bends time itself, smoothly to its second derivative.
"""

from dataclasses import dataclass
from math import pi, radians, sin

import numpy as np
from scipy.spatial.transform import Rotation

from drivers.errors import ConfigurationError
from drivers.samples import Matrix4

_AXES = ("lateral_mm", "axial_mm", "elevational_mm", "tilt_lateral_deg", "tilt_axial_deg", "turn_deg")

_PROGRAMS: dict[str, dict[str, tuple[tuple[float, float], ...]]] = {
    "sweep": {
        "lateral_mm": ((7.0, 7.4), (0.7, 2.7)),
        "axial_mm": ((4.2, 5.3), (0.5, 2.1)),
        "elevational_mm": ((0.14, 11.0),),
        "tilt_lateral_deg": ((1.4, 8.7),),
        "tilt_axial_deg": ((1.2, 6.3),),
        "turn_deg": ((6.2, 9.3),),
    },
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

_MOVES_S, _EASES_S, _RESTS_S = 10.0, 1.0, 1.0
"""A clinical sweep rests now and then; checks must stand it. In 26 s the hand is at rest for 1.5 to 4 s
(tests/drivers/twins/test_world.py). Longer rests leave less motion to verify by."""


def _moved_s(t_s: float) -> float:
    """Time the hand has moved: 10 s, a stop eased in over 1 s, 1 s of rest, a start eased over 1 s, and again."""
    cycles, t_s = divmod(t_s, _MOVES_S + 2 * _EASES_S + _RESTS_S)
    stopping = min(max((t_s - _MOVES_S) / _EASES_S, 0.0), 1.0)
    starting = min(max((t_s - _MOVES_S - _EASES_S - _RESTS_S) / _EASES_S, 0.0), 1.0)
    eased = stopping - (stopping**3 - stopping**4 / 2) + (starting**3 - starting**4 / 2)
    return cycles * (_MOVES_S + _EASES_S) + min(t_s, _MOVES_S) + _EASES_S * eased


@dataclass(frozen=True, slots=True)
class _Wave:
    amplitude: float
    period_s: float
    phase_rad: float

    def at(self, t_s: float) -> float:
        return self.amplitude * sin(2 * pi * t_s / self.period_s + self.phase_rad)


class Trajectory:
    """pose(t_s) of one program. Amplitudes, periods and phases vary by some percent with the seed.

    Raises ConfigurationError for a program that does not exist.
    """

    def __init__(self, seed: int, program: str) -> None:
        if program not in _PROGRAMS:
            known = ", ".join(PROGRAMS)
            raise ConfigurationError(f"'{program}' is not a known motion", "trajectory", f"Use one of {known}")
        self._pauses = program == "sweep"
        random = np.random.default_rng((seed, 11))
        self._waves = {
            axis: tuple(
                # Phases within ±45° of the zero crossing: the hand moves from the first instant on.
                _Wave(
                    size * random.uniform(0.9, 1.05), period_s * random.uniform(0.95, 1.08), random.uniform(-0.8, 0.8)
                )
                for size, period_s in _PROGRAMS[program].get(axis, ())
            )
            for axis in _AXES
        }

    def _axis(self, axis: str, t_s: float) -> float:
        return sum(wave.at(t_s) for wave in self._waves[axis])

    def pose(self, t_s: float) -> Matrix4:
        """(4, 4) picture P → tissue C, mm, at world time t_s.

        The tissue's origin (the crossing of a cross-wire) stays at the programmed place of the picture whatever the
        tilt, so freehand motion circles about it.
        """
        if self._pauses:
            t_s = _moved_s(t_s)
        place_mm = [self._axis(axis, t_s) for axis in _AXES[:3]]
        turn_rad = [radians(self._axis(axis, t_s)) for axis in _AXES[3:]]
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_rotvec(turn_rad).as_matrix()
        pose[:3, 3] = -pose[:3, :3] @ place_mm
        return pose
