"""`python -m tests.arm64.figures SESSION FIGURES`: what this machine makes of a stored session, for another to compare.

The pictures are drawn once and stored, so that both machines register the same pixels.
"""

import json
import platform
import sys
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from probewatch.appliance.core.line import Line
from probewatch.appliance.core.registration.keyframe import Keyframe
from probewatch.appliance.core.registration.pyramid import pyramid
from probewatch.appliance.limits import Limits
from probewatch.drivers.samples import GreyImage
from probewatch.tools.study.samples import Conditions, rendered, samples
from probewatch.tools.study.session import Session

SESSION = Session("gesture", "still", 1, 6.0)
"""Seeded: the motion that shows every parameter, until all are shown; its pictures are 400 × 300 px."""
APART, PAIRS = 3, 12
"""Pictures between the two of a pair, up to 25 px of the gesture; and how many are registered from nothing."""
MOST_PX, MOST_RAD = 0.03, 1e-4
"""By which two machines may register a pair differently: the step at which the registration ends, since sums in another
order end it a step sooner; a thousandth of a turn of 6°. Measured: .0047 px, 1.0e-5 rad.
"""
MOST_SIGMAS = 0.01
"""By which a value may differ, in its own sigmas, and a sigma, of itself: no verdict at three sigmas hangs on it.
Measured: .00012.
"""
MOST_VERDICTS = 2
"""By which a verdict may come sooner or later, in pictures: a value at its limit crosses it so. Measured: 0 of 180."""

Figures = dict[str, Any]


def store(path: Path) -> None:
    """The pictures of the session."""
    np.savez(path, pictures=np.stack(rendered(SESSION, None)))


def figures(path: Path) -> Figures:
    """pairs: u px and α rad of each. checks: value and sigma of each at the end. verdicts: of each picture. *_ms: of
    the processor, for one pair and one picture.
    """
    pictures = list(np.load(path)["pictures"])
    line = Line(SESSION.reference, Limits())
    began_s = process_time()
    pairs = [_registered(pictures[k], pictures[k + APART]) for k in _starts(len(pictures))]
    between_s = process_time()
    verdicts = [
        f"{one.kind.value} {one.fault or ''}".strip()
        for sample in samples(Conditions(SESSION), pictures)
        for one in line.step(sample)
    ]
    ended_s = process_time()
    return {
        "machine": platform.machine(),
        "pairs": pairs,
        "checks": {one.name: [one.value, one.sigma] for one in line.report().checks},
        "verdicts": verdicts,
        "pair_ms": 1e3 * (between_s - began_s) / len(pairs),
        "picture_ms": 1e3 * (ended_s - between_s) / len(pictures),
    }


def differences(here: Figures, there: Figures) -> tuple[list[str], dict[str, float]]:
    """(what is further apart than stated, the largest of each kind)."""
    apart = np.abs(np.array(here["pairs"]) - np.array(there["pairs"]))
    values = {
        name: _in_sigmas(here["checks"][name], there["checks"][name])
        for name in here["checks"].keys() & there["checks"].keys()
    }
    other = sum(a != b for a, b in zip(here["verdicts"], there["verdicts"], strict=False))
    largest = {
        "px": float(apart[:, :2].max()),
        "rad": float(apart[:, 2].max()),
        "sigmas": max(values.values(), default=0.0),
        "verdicts": float(other),
    }
    limits = {"px": MOST_PX, "rad": MOST_RAD, "sigmas": MOST_SIGMAS, "verdicts": MOST_VERDICTS}
    # NaN is not within a limit either.
    beyond = [what for what, most in limits.items() if not largest[what] <= most]
    told = [f"{largest[what]:.2g} {what}, more than {limits[what]:g}" for what in beyond]
    if here["checks"].keys() != there["checks"].keys():
        told.append(f"other checks: {sorted(here['checks'].keys() ^ there['checks'].keys())}")
    if len(here["verdicts"]) != len(there["verdicts"]):
        told.append(f"{len(here['verdicts'])} verdicts here, {len(there['verdicts'])} there")
    return told, largest


def _in_sigmas(here: list[float], there: list[float]) -> float:
    """In the value's own unit where it has no sigma; infinite where only one of them knows it."""
    if np.array_equal(here, there, equal_nan=True):
        return 0.0
    apart = np.abs(np.subtract(here, there)).max()
    return float(apart / (here[1] or 1.0)) if np.isfinite(apart) else np.inf


def _starts(count: int) -> list[int]:
    return [round(k) for k in np.linspace(0, count - APART - 1, PAIRS)]


def _registered(before: GreyImage, after: GreyImage) -> list[float]:
    found = Keyframe(pyramid(before), 1.0).register(pyramid(after))
    return [*map(float, found.u_px), found.alpha_rad]


if __name__ == "__main__":
    Path(sys.argv[2]).write_text(json.dumps(figures(Path(sys.argv[1])), indent=1))
