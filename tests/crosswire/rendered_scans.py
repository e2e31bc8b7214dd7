"""Whole scans with pictures: what a guided minute gives, from echoes to the eight parameters.

Each seed is a hand and a noise of its own, from HELD_OUT on, so that none was ever used to set anything. A scan takes
some 20 s of a processor; what is measured is kept in a file, scan by scan, and a run goes on where the last one ended.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from probewatch.appliance.crosswire.running import RunningCalibration
from probewatch.appliance.crosswire.scan import CrosswireScan
from probewatch.tools.shared.crosswire_input import simulated
from tests.crosswire.scans import points_off_mm
from tests.crosswire.views import HELD_OUT
from tests.support.crossings import SIZE_PX, errors

DURATION_S = 60.0


def scanned_pictures(seed: int) -> dict[str, Any]:
    """One scan. ratios: (8,) error ÷ stated sigma; closed: of ζ with all else as this scan finds it. late: of the
    latency, which is none. Without solution, or with refusals, accepted is False.
    """
    scan = CrosswireScan()
    for sample in simulated(seed, DURATION_S, "guided").samples:
        scan.step(sample)
    scan.finish()
    running = RunningCalibration(SIZE_PX)
    for view in scan.views:
        running.add(view)
    state = running.state(scan.misses_mm)
    told: dict[str, Any] = {"seed": seed, "views": len(scan.views), "refusals": [one.what for one in state.refusals]}
    if state.whole is None:
        return {**told, "accepted": False}
    whole = state.whole
    off = errors(whole)
    return {
        **told,
        "accepted": not state.refusals,
        "ratios": (off / whole.sigma).tolist(),
        "zeta_off_mm": float(off[7]),
        "zeta_sigma_mm": float(whole.sigma[7]),
        "late": whole.latency_s / whole.latency_sigma_s,
        "points_mm": points_off_mm(whole.calibration, seed, quiet=False),
        "calibration_mm": points_off_mm(whole.calibration, seed, quiet=True),
        "expected_mm": whole.expected_mm,
    }


def measured(number: int, kept: Path) -> list[dict[str, Any]]:
    """The first `number` scans, of which those in `kept` are not made again."""
    kept.parent.mkdir(parents=True, exist_ok=True)
    known = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    done = {one["seed"] for one in known}
    with kept.open("a") as stream:
        for seed in range(HELD_OUT, HELD_OUT + number):
            if seed not in done:
                known.append(scanned_pictures(seed))
                stream.write(json.dumps(known[-1]) + "\n")
                stream.flush()
    return sorted(known, key=lambda one: one["seed"])[:number]


def told(found: list[dict[str, Any]]) -> str:
    """The table's line."""
    solved = [one for one in found if "ratios" in one]
    ratios = np.abs([one["ratios"] for one in solved])
    zeta_mm = np.array([one["zeta_off_mm"] for one in solved])
    points_mm, calibration_mm, stated_mm = (
        np.sqrt(np.mean([one[name] ** 2 for one in solved]))
        for name in ("points_mm", "calibration_mm", "zeta_sigma_mm")
    )
    each = ", ".join(f"{share:.0%}" for share in np.mean(ratios < 1, axis=0))
    views = np.mean([one["views"] for one in found])
    late = np.abs([one["late"] for one in solved])
    return (
        f"{len(found)} rendered scans of {DURATION_S:.0f} s, {views:.0f} views each, "
        f"{np.mean([one['accepted'] for one in found]):.1%} accepted: "
        f"ζ within 2.5 sigma {np.mean(ratios[:, 7] < 2.5):.1%}, "
        f"off {np.sqrt(np.mean(zeta_mm**2)):.3f} mm RMS, stated {stated_mm:.3f}; "
        f"eight parameters within 1 sigma {np.mean(ratios < 1):.1%} ({each}), within 2 {np.mean(ratios < 2):.1%}; "
        f"latency within 2 sigma {np.mean(late < 2):.1%}; "
        f"ten points elsewhere {points_mm:.3f} mm RMS, of which the calibration {calibration_mm:.3f}"
    )
