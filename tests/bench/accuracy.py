"""Every method on every scene: error, failures, processor time; and whether ours knows its own error."""

from collections.abc import Callable, Iterator, Sequence
from time import process_time
from typing import Any

import numpy as np

from probewatch.appliance.core.registration.keyframe import Keyframe
from probewatch.appliance.core.registration.pyramid import pyramid
from tests.bench.peers import PEERS, Method, accurate, cold, kept
from tests.bench.scenes import CHANGED, CLEAN, Pair, Scene, pairs
from tests.support.rendered import Warp, rms_px

FAILED_PX = 2.0
COLD, KEPT, ACCURATE = "ours, cold", "ours, keyframe", "ours, accurate"
METHODS = (COLD, KEPT, ACCURATE, *PEERS)
_QUICK_MS, _REPEATS = 200.0, 5

Row = dict[str, Any]


def measure(scenes: Sequence[Scene], count: int, done: Callable[[], None]) -> list[Row]:
    """One row for each scene, pair and method: error px (None: gave up) and processor ms.

    All methods take a pair one after the other, so that what else the machine does meets all of them alike.
    """
    rows = []
    for scene in scenes:
        for k, pair in enumerate(pairs(scene, count)):
            for name, method in _methods(pair):
                found, ms = _timed(method, pair)
                error = None if found is None else rms_px(found, pair.truth, scene.settings)
                rows.append({"scene": scene.name, "pair": k, "method": name, "error_px": error, "ms": ms})
            done()
    return rows


def _methods(pair: Pair) -> Iterator[tuple[str, Method]]:
    yield COLD, cold
    yield KEPT, kept(Keyframe(pyramid(pair.before), 1.0, pair.mask))
    yield ACCURATE, accurate
    yield from PEERS.items()


def _timed(method: Method, pair: Pair) -> tuple[Warp | None, float]:
    """What was found, and the median of five times; what takes long is done once."""
    spent_ms: list[float] = []
    while True:
        start = process_time()
        found = method(pair.before, pair.after, pair.mask)
        spent_ms.append(1e3 * (process_time() - start))
        if len(spent_ms) == _REPEATS or spent_ms[0] > _QUICK_MS:
            return found, float(np.median(spent_ms))


def errors(rows: list[Row]) -> list[Row]:
    """For each scene and method: RMS error px of what did not fail (None: all failed), and the share that failed."""
    found = []
    for scene in dict.fromkeys(row["scene"] for row in rows):
        for name in METHODS:
            mine = [row["error_px"] for row in rows if (row["scene"], row["method"]) == (scene, name)]
            good = np.array([error for error in mine if error is not None and error <= FAILED_PX])
            rms = float(np.sqrt(np.mean(np.square(good)))) if good.size else None
            found.append({"scene": scene, "method": name, "rms_px": rms, "failed": 1 - good.size / len(mine)})
    return found


def times(rows: list[Row]) -> list[Row]:
    """For each method: median ms, and the median over all pairs of its time ÷ ours on the same pair."""
    spent = {name: np.array([row["ms"] for row in rows if row["method"] == name]) for name in METHODS}
    return [
        {
            "method": name,
            "median_ms": float(np.median(spent[name])),
            "p90_ms": float(np.quantile(spent[name], 0.9)),
            "of_cold": float(np.median(spent[name] / spent[COLD])),
            "of_keyframe": float(np.median(spent[name] / spent[KEPT])),
            "of_accurate": float(np.median(spent[name] / spent[ACCURATE])),
        }
        for name in METHODS
    ]


def coverage(scenes: Sequence[Scene], count: int) -> list[Row]:
    """Share of the errors of u within one and two stated sigmas: 68 % and 95 % are due."""
    found = []
    for label, wanted in (("shifts only", CLEAN), ("speckle changed", CHANGED)):
        chosen = [scene for scene in scenes if scene.name in wanted]
        if chosen:
            units = np.concatenate([_in_sigmas(scene, count) for scene in chosen])
            found.append(
                {
                    "pairs": label,
                    "n": units.size,
                    "within_1_sigma": float(np.mean(units < 1)),
                    "within_2_sigma": float(np.mean(units < 2)),
                }
            )
    return found


def _in_sigmas(scene: Scene, count: int) -> np.ndarray:
    units = []
    for pair in pairs(scene, count):
        found = Keyframe(pyramid(pair.before), 1.0, pair.mask).register(pyramid(pair.after))
        units.append(np.abs(found.u_px - pair.truth[0]) / np.sqrt(np.diag(found.covariance)[:2]))
    return np.concatenate(units)
