"""Measures how often two marker bodies that nobody touched are named, and how soon two that were: `python -m
probewatch.tools.development.witness_law`.

It simulates the noise of two bodies, hour by hour, under the very windows and thresholds of the detector
(appliance.core.detectors.witness), many at a time: the tests compare the two.
"""

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from probewatch.appliance.core.detectors.witness import (
    BLOCKS,
    FRESH_BLOCKS,
    LEARN_NS,
    LEARN_READINGS,
    LOOK_NS,
    SETTLED_BLOCKS,
    WINDOW_NS,
    extents,
    first_scale,
    readings_of_window,
    scale_of,
    thresholds,
)
from probewatch.appliance.limits import Limits
from probewatch.drivers.rigid import Array

HOURS = 1000
"""Hours simulated for each tracker: the promise is one false alarm in as many. More takes longer, less shows less."""
_SESSION_S = 3600
"""Seconds after which the tracker is switched on again, and noise and relative pose are learned anew. Longer: more
rarely."""
_RADIUS_MM, _LEVER_MM, _MARKERS = 40.0, 80.0, 4
"""Millimetres from the middle of a body to its markers and between the two bodies, and the number of markers of a body:
those of usual tools."""
_STEPS = 100
"""Changes simulated for each delay."""
_PLACE_S = 5.0
"""Seconds in which an error by place changes: a hand goes from one end of the field to the other."""


@dataclass(frozen=True, slots=True)
class Tracker:
    """Describes a tracker. marker_mm: standard deviation of a marker along an axis. smooth: share of the last reading
    in the next. tail: share of readings with ten times the noise. place_mm, place_deg: standard deviation of the error
    by place.
    """

    name: str
    rate_hz: float = 60.0
    marker_mm: float = 0.1
    smooth: float = 0.0
    tail: float = 0.0
    place_mm: float = 0.0
    place_deg: float = 0.0


TRACKERS = (
    Tracker("optical, 60 Hz"),
    Tracker("optical, 20 Hz", rate_hz=20.0),
    Tracker("noise of .25 mm", marker_mm=0.25),
    Tracker("one outlier in 50", tail=0.02),
    Tracker("smooths by .8", smooth=0.8),
    Tracker("errs by place, .1 mm and .1 deg", place_mm=0.1, place_deg=0.1),
    Tracker("errs by place, .2 mm and .2 deg", place_mm=0.2, place_deg=0.2),
    Tracker("smooths by .8 and errs by place, .4 mm and .4 deg", smooth=0.8, place_mm=0.4, place_deg=0.4),
)
"""Trackers of the promise, then each way in which a tracker is worse by itself; the last in two ways, far beyond what a
body of usual size shows."""


def noise(tracker: Tracker, readings: int, rng: np.random.Generator) -> Array:
    """Returns one relative pose against its mean, (readings, 6): shift, mm, and turn, deg, in the axes of the first
    body.
    """
    shift_mm = tracker.marker_mm / np.sqrt(_MARKERS)
    turn_deg = np.rad2deg(tracker.marker_mm / (_RADIUS_MM * np.sqrt(_MARKERS / 2)))
    sizes = np.repeat([shift_mm, turn_deg], 3)
    first, second = (rng.standard_normal((readings, 6), dtype=np.float32) * sizes for _ in range(2))
    apart = (second - first).astype(np.float32)
    apart[:, 1] += np.deg2rad(first[:, 5]) * _LEVER_MM  # the second lies along x of the first, whose turns swing it
    apart[:, 2] -= np.deg2rad(first[:, 4]) * _LEVER_MM
    if tracker.tail:
        apart *= np.where(rng.random((readings, 1)) < tracker.tail, 10.0, 1.0)
    if tracker.smooth:
        apart = _smoothed(apart, tracker.smooth)
    if tracker.place_mm or tracker.place_deg:
        sizes = np.repeat([tracker.place_mm, tracker.place_deg], 3)
        slow = _smoothed(rng.standard_normal((readings, 6)), float(np.exp(-1 / (tracker.rate_hz * _PLACE_S))))
        apart = apart + sizes * slow / slow.std(axis=0)
    return np.asarray(apart, np.float32)


def hours_named(tracker: Tracker, hours: int, seed: int = 1) -> tuple[int, float]:
    """Returns how many hours named something that was not there, and the largest multiple of a limit that was ever
    asked for.
    """
    rng, limits = np.random.default_rng(seed), _limits()
    named, furthest = 0, 0.0
    for _ in range(hours):
        found = session(noise(tracker, round(_SESSION_S * tracker.rate_hz), rng), tracker.rate_hz, limits)
        named += bool(found.named.any())
        furthest = max(furthest, float((found.limits / limits).max()))
    return named, furthest


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Holds what each look found. ends: readings until it. named: whether it names one. limits: (looks, 2) where it
    would.
    """

    ends: NDArray[np.intp]
    named: NDArray[np.bool_]
    limits: Array


def session(readings: Array, rate_hz: float, limits: Array) -> Found:
    """Returns what the detector makes of all readings since it was switched on. Only windows that can name something
    are computed: a median is beyond c only where half of the readings are.
    """
    learned = max(LEARN_READINGS, _readings(LEARN_NS, rate_hz) + 1)
    window = readings_of_window(1e9 / rate_hz)
    scale = first_scale(readings[:learned].astype(np.float64), window)
    rest = readings[learned:] - np.median(readings[:learned], axis=0)
    every = _readings(LOOK_NS, rate_hz)
    ends = np.arange(window, len(rest) + 1, every)
    at = np.arange(0, len(ends), max(1, int(np.ceil(round(WINDOW_NS * rate_hz / 1e9) / every))))
    # Medians of windows that do not overlap, from which the detector learns noise and relative pose.
    blocks = np.median(rest[ends[at][:, None] + np.arange(-window, 0)], axis=1)
    if len(at) >= SETTLED_BLOCKS:
        rest[ends[at[SETTLED_BLOCKS - 1]] :] -= np.median(blocks[:SETTLED_BLOCKS], axis=0)
    asked = _asked(len(ends), at, blocks, limits, scale)
    # The length of three rows is beyond a threshold only where one of them is beyond its share, 1 ÷ √3.
    per_row = (asked / np.sqrt(3)).repeat(3, axis=1).min(axis=0)
    beyond = np.zeros((len(rest) + 1, 6), np.int32)
    np.cumsum(np.abs(rest) > per_row, axis=0, out=beyond[1:])
    doubtful = np.flatnonzero((2 * (beyond[ends] - beyond[ends - window]) >= window).any(axis=1))
    named = np.zeros(len(ends), bool)
    for some in np.array_split(doubtful, max(1, len(doubtful) // 50_000)):
        places = ends[some][:, None] + np.arange(-window, 0)
        named[some] = (extents(np.median(rest[places], axis=1)) > asked[some]).any(axis=1)
    return Found(learned + ends, named, asked)


def _asked(looks: int, at: NDArray[np.intp], blocks: Array, limits: Array, scale: Array) -> Array:
    """Returns the thresholds in force at each look, (looks, 2): as learned at first, then by the windows until then,
    which end at the looks `at`.
    """
    asked = np.tile(thresholds(limits, scale, 0), (looks, 1))
    for k in range(FRESH_BLOCKS, len(blocks) + 1, FRESH_BLOCKS):
        known = np.maximum(scale, scale_of(blocks[max(0, k - BLOCKS) : k]))
        asked[at[k - 1] + 1 : at[min(k + FRESH_BLOCKS, len(at)) - 1] + 1] = thresholds(limits, known, k)
    asked[at[-1] + 1 :] = asked[at[-1]]
    return asked


def delays_s(tracker: Tracker, change: Array, seed: int = 2) -> Array:
    """Returns the seconds, (_STEPS,), from a change of (6,) mm and deg until it is named; infinite where it is not
    within 5 s.
    """
    rng, limits = np.random.default_rng(seed), _limits()
    before, after = round(70 * tracker.rate_hz), round(5 * tracker.rate_hz)
    delays = []
    for _ in range(_STEPS):
        readings = noise(tracker, before + after, rng)
        readings[before:] += change
        found = session(readings, tracker.rate_hz, limits)
        ends = found.ends[found.named & (found.ends > before)]
        delays.append((ends[0] - before) / tracker.rate_hz if len(ends) else np.inf)
    return np.array(delays)


def _readings(span_ns: int, rate_hz: float) -> int:
    """Returns the number of periods until at least span_ns has gone by."""
    return max(1, int(np.ceil(span_ns * rate_hz / 1e9 - 1e-9)))


def _limits() -> Array:
    limits = Limits()
    return np.array([limits.witness_mm, limits.witness_deg])


def _smoothed(values: Array, share: float) -> Array:
    return np.asarray(lfilter([1 - share], [1, -share], values, axis=0))


def rows(hours: int, word: str = "") -> Iterator[str]:
    """Yields a line for each tracker with that word in its name, as soon as it is known."""
    slide, bend = np.array([1.0, 0, 0, 0, 0, 0]), np.array([0, 0, 0, 0, 1.0, 0])
    yield f"{'tracker':52} {'hours':>6} {'named':>6} {'asks':>6}   1 mm: median, 95 %   1 deg: median, 95 %"
    for tracker in (one for one in TRACKERS if word in one.name):
        named, furthest = hours_named(tracker, hours)
        cells = [np.quantile(delays_s(tracker, change), (0.5, 0.95), method="higher") for change in (slide, bend)]
        told = "   ".join(f"{median:9.2f} s, {late:5.2f} s" for median, late in cells)
        yield f"{tracker.name:52} {hours:6} {named:6} {furthest:6.2f}   {told}"


def main(arguments: list[str]) -> None:
    """Simulates each tracker for HOURS of [HOURS [WORD]], 1000 unless given, or only those with WORD in their names."""
    began_s = time.monotonic()
    for row in rows(int(arguments[0]) if arguments else HOURS, *arguments[1:2]):
        print(row, flush=True)
    print(f"{time.monotonic() - began_s:.0f} s")


if __name__ == "__main__":
    main(sys.argv[1:])
