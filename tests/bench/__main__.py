"""`make bench`: registration side by side with its peers, the self-check, the bounds, the cost of the line and of
a frame's way to it.

Prints tables and writes results/bench.json; `python -m tests.bench --help` names the options.
"""

import json
import os
import platform
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import click  # noqa: E402
import cv2  # noqa: E402
import numpy as np  # noqa: E402
import SimpleITK as sitk  # noqa: E402, N813
from rich.progress import Progress  # noqa: E402

from tests.bench import accuracy, bounds, cost, cross_spectrum, handover, report, selfcheck  # noqa: E402
from tests.bench.peers import COARSE, FINE, SMOOTHED_PX, one_thread  # noqa: E402
from tests.bench.scenes import CLEAN, DECORRELATED, SCENES, Scene  # noqa: E402

RESULTS = Path("results/bench.json")
_STEPS = 7


@click.command()
@click.option("--pairs", type=click.IntRange(1, 100), default=6, show_default=True, help="pairs a scene")
@click.option(
    "--scene",
    "names",
    multiple=True,
    type=click.Choice([one.name for one in SCENES]),
    help="only this; may be repeated",
)
def main(pairs: int, names: tuple[str, ...]) -> None:
    """Measure registration beside its peers, the bounds, the cost of the line; about four minutes on one core."""
    scenes = [scene for scene in SCENES if not names or scene.name in names]
    one_thread()
    with Progress() as progress:
        task = progress.add_task("bench", total=len(scenes) * pairs + _STEPS)
        result = measure(scenes, pairs, lambda: progress.advance(task))
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(result, indent=1, ensure_ascii=False))
    report.show(result)
    print(RESULTS)


def measure(scenes: Sequence[Scene], count: int, done: Callable[[], None]) -> dict[str, Any]:
    """All figures; `done` is called len(scenes) · count + 7 times on the way."""
    started = os.getloadavg()[0]
    rows = accuracy.measure(scenes, count, done)
    result: dict[str, Any] = {"errors": accuracy.errors(rows), "times": accuracy.times(rows)}
    result["coverage"] = accuracy.coverage(scenes, 4 * count)
    done()
    result["self-check"] = selfcheck.measure(40 * count)
    done()
    white = bounds.white_noise_px()
    result["bounds_px"] = {
        scene.name: bounds.decorrelation_px(scene.elevation_mm) if scene.name in DECORRELATED else white
        for scene in scenes
        if scene.name in (*CLEAN, *DECORRELATED)
    }
    done()
    changed = [scene for scene in scenes if scene.name in DECORRELATED]
    result["reached_px"] = {scene.name: cross_spectrum.reached_px(scene, count) for scene in changed}
    done()
    result["line"] = [cost.line((640, 480)), cost.line(cost.FULL_HD)]
    done()
    result["world_ms"] = cost.world_ms()
    done()
    result["handover"] = handover.measure()
    done()
    return {"environment": environment(started, count), **result, "pairs": rows}


def environment(load_at_start: float, count: int) -> dict[str, Any]:
    """What the figures depend on."""
    return {
        "versions": f"OpenCV {cv2.__version__}, SimpleITK {sitk.Version.VersionString()}, NumPy {np.__version__}, "
        f"Python {platform.python_version()}, {platform.machine()}",
        "load of the machine": f"{load_at_start:.1f} at the start, {os.getloadavg()[0]:.1f} at the end, "
        f"{os.cpu_count()} cores; every method on one thread",
        "pairs a scene": count,
        "ECC": _ecc("findTransformECC", COARSE),
        "ECC 1e-6": _ecc("findTransformECC", FINE),
        "ECC pyramid": _ecc(f"findTransformECCMultiScale, {cv2.ECCParameters().nlevels} levels", FINE),
    }


def _ecc(function: str, criteria: tuple[int, int, float]) -> str:
    stop = f"at most {criteria[1]} iterations or until the gain is below {criteria[2]:g}"
    return f"{function}, Euclidean, {stop}, Gaussian of {SMOOTHED_PX} px"


if __name__ == "__main__":
    main()
