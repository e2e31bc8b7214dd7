"""`python -m tests.bench`: time per 640×480 picture on one thread, and ratios against OpenCV's ECC in the same run."""

import time
from collections.abc import Callable
from statistics import median

import cv2
import numpy as np

from appliance.calibration_file import calibration_from_image_to_probe
from appliance.core.line import Line
from appliance.core.registration import Keyframe, pyramid
from appliance.limits import Limits
from drivers.samples import Frame
from drivers.twins.world import World
from tests.sessions import session

_PAIRS = 12


def main() -> None:
    """Print medians in ms and ratios."""
    cv2.setNumThreads(1)
    world = World(seed=1)
    whole_line(world)
    registration(world)


def whole_line(world: World) -> None:
    """Processor time of Line.step per picture, after the window has filled."""
    line = Line(calibration_from_image_to_probe(world.image_to_probe, (640, 480)), Limits())
    samples = list(session(world, 14.0))
    spent = [0.0]
    for sample in samples:
        start = time.process_time()
        line.step(sample)
        spent[-1] += time.process_time() - start
        if isinstance(sample, Frame):
            spent.append(0.0)
    settled = np.array(spent[330:-1]) * 1e3
    print(f"whole line          {settled.mean():7.2f} ms a picture, median {np.median(settled):.2f}")


def registration(world: World) -> None:
    """Pairs three frames apart in a sweep: ours cold and with the keyframe kept, and ECC."""
    times_s = 2.0 + np.arange(_PAIRS) * 0.37
    pairs = [(world.frame(t, 2 * k), world.frame(t + 0.1, 2 * k + 1)) for k, t in enumerate(times_s)]
    aspect = world.settings.scale_mm_per_px[1] / world.settings.scale_mm_per_px[0]
    kept = [Keyframe(pyramid(first), aspect) for first, _ in pairs]
    cold = timed([lambda a=a, b=b: Keyframe(pyramid(a), aspect).register(pyramid(b)) for a, b in pairs])
    warm = timed([lambda k=k, b=b: k.register(pyramid(b)) for k, (_, b) in zip(kept, pairs, strict=True)])
    ecc = timed([lambda a=a, b=b: _ecc(a, b) for a, b in pairs])
    print(f"register, cold      {cold:7.2f} ms")
    print(f"register, keyframe  {warm:7.2f} ms")
    print(f"findTransformECC    {ecc:7.2f} ms: {ecc / cold:.1f} × cold, {ecc / warm:.1f} × keyframe")


def timed(calls: list[Callable[[], object]]) -> float:
    """Median ms over the calls."""
    spent = []
    for call in calls:
        start = time.perf_counter()
        call()
        spent.append(time.perf_counter() - start)
    return 1e3 * median(spent)


def _ecc(first: np.ndarray, second: np.ndarray) -> None:
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
    try:
        cv2.findTransformECC(first, second, np.eye(2, 3, dtype=np.float32), cv2.MOTION_EUCLIDEAN, criteria)
    except cv2.error:
        return


if __name__ == "__main__":
    main()
