"""Models how a hand moves a probe in ordinary scanning, as functions of time. It is pure and seeded.

Rows are lateral, axial and elevational, mm, then the rotation vector about the same axes, deg. A probe turns about its
middle on the skin, where it is held.
"""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from probewatch.drivers.rigid import Array

Program = Callable[[Array, np.random.Generator], Array]
"""(n,) s → (6, n) mm and deg."""

_TREMOR_RMS = np.array([0.5, 0.35, 0.25, 0.3, 0.3, 0.3])
_TREMOR_HZ = np.geomspace(0.5, 8.0, 12)
"""RMS of each row, mm and deg, and the frequencies whose waves make up the tremor, its amplitude ∝ 1 ÷ frequency: a
hand at rest on a patient, from the literature on physiological tremor and not measured here. More shows more of the
calibration."""
_STROKE_MM = 40.0
"""Length of an elevational sweep: a liver or a thyroid. Longer ones turn less often, and turns show the latency."""
_EASE_S = 0.4
"""Seconds in which a sweep turns back: a hand that neither stops nor jerks. Not measured."""
_CIRCLE_MM, _PRESS_MM, _CIRCLE_S = 5.0, 2.0, 3.1
"""Radius of the lateral path and of the press, and the time of one round: up to 10 mm/s, as in a search."""
_FAN_DEG, _FAN_S = 20.0, 8.0
"""Degrees either way, and seconds to and fro: as when looking along an organ from one window."""
_DRIFT_MM = ((1.0, 11.0), (0.6, 7.0))
"""Amplitude, mm, and period, s, of the slow in-plane drift of a sweep, lateral and axial."""
_GESTURE = ((0, 5.0, 1.75), (1, 3.0, 0.65), (5, 8.0, 1.4), (4, 8.0, 2.15), (3, 8.0, 2.65))
"""Row, amplitude, mm or deg, and period, s, of each motion of the verification gesture. Slower shows less in its time;
quicker blurs the registration. The press is quicker than a breath, for which it would be taken: pressed once in 2 s,
not one of 20 was verified with breathing. Two motions of one pace go in step and hide one another: with rock and twist
both at 1.6 s, no OK came within 8 s (seeds 2 and 19); so no two are within the tenth by which a hand's pace differs."""
GESTURE_S, _FROM_GESTURE_S = 6.0, 1.0
"""Seconds for which the gesture lasts: as long as a person is asked to continue it; and in which it merges smoothly
into what follows. In .4 s the turn would reach 68 °/s at once in a fan, quicker than the slip watch assumes of a
hand."""
_PHASES_S = (14.0, 14.0, 10.0, 4.0)
_LIFTED = 3
"""Seconds of the phases of a mixed session, which repeat: search, sweep, hold, lifted off the skin. Where sessions
begin with the gesture, it comes again after each time off the skin, as the instrument asks for it."""


def tremor(t_s: Array, random: np.random.Generator, share: float = 1.0) -> Array:
    """Returns the tremor, (6, n). share: that of the usual RMS."""
    amplitude = np.sqrt(2 / np.sum(_TREMOR_HZ**-2.0)) / _TREMOR_HZ
    phase = random.uniform(0, 2 * np.pi, (6, _TREMOR_HZ.size))
    hz = _TREMOR_HZ * random.uniform(0.9, 1.1, (6, _TREMOR_HZ.size))
    waves = np.sin(2 * np.pi * hz[..., None] * t_s + phase[..., None])
    return np.asarray(share * _TREMOR_RMS[:, None] * np.einsum("f,afn->an", amplitude, waves))


def in_plane(t_s: Array, random: np.random.Generator) -> Array:
    """Returns a circle sideways with a press."""
    turn = 2 * np.pi * t_s / (_CIRCLE_S * random.uniform(0.9, 1.1)) + random.uniform(0, 2 * np.pi)
    rows = tremor(t_s, random)
    rows[0] += _CIRCLE_MM * np.sin(turn)
    rows[1] += _PRESS_MM * np.cos(turn)
    return rows


def elevational(speed_mm_s: float, drift: float = 1.0) -> Program:
    """Returns a program that sweeps to and fro out of the plane. drift: multiple of the usual in-plane drift."""

    def program(t_s: Array, random: np.random.Generator) -> Array:
        rows = tremor(t_s, random)
        rows[2] += _to_and_fro(t_s + random.uniform(0, 2 * _STROKE_MM / speed_mm_s), speed_mm_s)
        for row, (amplitude_mm, period_s) in enumerate(_DRIFT_MM):
            phase = random.uniform(0, 2 * np.pi)
            rows[row] += drift * amplitude_mm * np.sin(2 * np.pi * t_s / (period_s * random.uniform(0.9, 1.1)) + phase)
        return rows

    return program


def fan(t_s: Array, random: np.random.Generator) -> Array:
    """Returns a tilt about the lateral axis at one place of the skin."""
    rows = tremor(t_s, random)
    phase = random.uniform(0, 2 * np.pi)
    rows[3] += _FAN_DEG * np.sin(2 * np.pi * t_s / (_FAN_S * random.uniform(0.9, 1.1)) + phase)
    return rows


def hold(t_s: Array, random: np.random.Generator) -> Array:
    """Returns tremor alone, .3 mm laterally."""
    return tremor(t_s, random, 0.6)


def gesture(t_s: Array, random: np.random.Generator) -> Array:
    """Returns the motion of a hand that has been shown the gesture: all that `appliance.core.quality.gesture` asks for,
    at once.
    """
    rows = tremor(t_s, random)
    for row, amplitude, period_s in _GESTURE:
        turn = 2 * np.pi * t_s / (period_s * random.uniform(0.9, 1.1)) + random.uniform(0, 2 * np.pi)
        rows[row] += amplitude * np.sin(turn)
    return rows


def begun_with_gesture(program: Program) -> Program:
    """Returns a program of the gesture for GESTURE_S, then the given program."""

    def begun(t_s: Array, random: np.random.Generator) -> Array:
        first, rest = gesture(t_s, random), program(t_s - GESTURE_S, random)
        way = np.clip((t_s - GESTURE_S) / _FROM_GESTURE_S, 0, 1)
        share = way * way * (3 - 2 * way)
        return np.asarray((1 - share) * first + share * rest)

    return begun


def mixed(t_s: Array, random: np.random.Generator) -> Array:
    """Returns search, sweep at 10 mm/s, hold, and off the skin, with half a second from one to the next."""
    search, sweep, still = in_plane(t_s, random), elevational(10.0)(t_s, random), hold(t_s, random)
    return _one_after_the_other(t_s, (search, sweep, still, still), _PHASES_S)


def mixed_with_gestures(t_s: Array, random: np.random.Generator) -> Array:
    """Returns the motion of `mixed`, with the gesture whenever the probe is on the skin again."""
    search, sweep, still = in_plane(t_s, random), elevational(10.0)(t_s, random), hold(t_s, random)
    return _one_after_the_other(t_s, (search, sweep, still, still, gesture(t_s, random)), (*_PHASES_S, GESTURE_S))


def lifted(name: str, t_s: Array) -> NDArray[np.bool_]:
    """Returns whether the probe is off the skin, (n,)."""
    if name.removeprefix(_BEGUN) != "mixed":
        return np.zeros(t_s.shape, dtype=bool)
    if not name.startswith(_BEGUN):
        return np.asarray(_phase(t_s, _PHASES_S) == _LIFTED)
    begun_s = t_s - GESTURE_S
    return np.asarray((begun_s >= 0) & (_phase(begun_s, (*_PHASES_S, GESTURE_S)) == _LIFTED))


PROGRAMS: Mapping[str, tuple[Program, float]] = {
    "in-plane": (in_plane, 60.0),
    "elevational-5": (elevational(5.0), 60.0),
    "elevational-10": (elevational(10.0), 60.0),
    "elevational-20": (elevational(20.0), 60.0),
    "elevational-drift": (elevational(10.0, 3.0), 60.0),
    "fan": (fan, 60.0),
    "hold": (hold, 60.0),
    "mixed": (mixed, 90.0),
}
"""Session → how the hand moves, and for how long, s: twice as long as a verification lasts, and two rounds of mixed."""
_BEGUN = "gesture-"
GESTURED: Mapping[str, tuple[Program, float]] = {
    "gesture": (gesture, 10.0),
    **{_BEGUN + name: (begun_with_gesture(program), GESTURE_S + 120.0) for name, (program, _) in PROGRAMS.items()},
    _BEGUN + "mixed": (begun_with_gesture(mixed_with_gestures), GESTURE_S + 120.0),
}
"""The gesture alone, and each session for two minutes after it; mixed makes it again after each time off the skin."""
ALL: Mapping[str, tuple[Program, float]] = {**PROGRAMS, **GESTURED}


def _to_and_fro(t_s: Array, speed_mm_s: float) -> Array:
    """Returns a path at constant speed along `_STROKE_MM` and back, the turns eased: a triangle wave averaged over
    `_EASE_S`.
    """
    period_s = 2 * _STROKE_MM / speed_mm_s
    around = np.linspace(-_EASE_S / 2, _EASE_S / 2, 9)
    share = np.abs(((t_s[:, None] + around) / period_s) % 1.0 * 2 - 1)
    return np.asarray(_STROKE_MM * (share.mean(axis=1) - 0.5))


def _phase(t_s: Array, phases_s: tuple[float, ...]) -> NDArray[np.intp]:
    ends = np.cumsum(phases_s)
    return np.asarray(np.searchsorted(ends, t_s % ends[-1], side="right"))


def _one_after_the_other(t_s: Array, parts: tuple[Array, ...], phases_s: tuple[float, ...]) -> Array:
    """Returns the parts in their phases, which merge into one another within half a second."""
    around = t_s[:, None] + np.linspace(-0.25, 0.25, 17)
    rows = np.zeros_like(parts[0])
    for number, part in enumerate(parts):
        rows += (_phase(around, phases_s) == number).mean(axis=1) * part
    return rows
