"""Processor time of the whole line per picture, and of the simulated world that feeds it."""

from time import process_time
from typing import Any

import cv2
import numpy as np

from probewatch.appliance.core.line import Line
from probewatch.appliance.limits import Limits
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.drivers.samples import Frame
from probewatch.drivers.twins.scene.world import World, WorldSettings
from tests.support.sessions import session

_SECONDS, _SETTLED = 14.0, 330
FULL_HD = (1920, 1080)


def line(size_px: tuple[int, int]) -> dict[str, Any]:
    """Median and mean ms a picture once the window of the solver is full; larger pictures are the same, stretched."""
    world = World(1, settings=WorldSettings(scale_mm_per_px=(0.075, 0.075)))
    image_to_probe = world.image_to_probe @ np.diag([640 / size_px[0], 480 / size_px[1], 1, 1])
    watched = Line(calibration_from_image_to_probe(image_to_probe, size_px), Limits())
    spent_ms = [0.0]
    for drawn in session(world, _SECONDS):
        sample = _enlarged(drawn, size_px) if isinstance(drawn, Frame) else drawn
        start = process_time()
        watched.step(sample)
        spent_ms[-1] += 1e3 * (process_time() - start)
        if isinstance(sample, Frame):
            spent_ms.append(0.0)
    settled = np.array(spent_ms[_SETTLED:-1])
    return {
        "size_px": list(size_px),
        "median_ms": float(np.median(settled)),
        "mean_ms": float(settled.mean()),
        "p95_ms": float(np.quantile(settled, 0.95)),
        "p99_ms": float(np.quantile(settled, 0.99)),
    }


def _enlarged(frame: Frame, size_px: tuple[int, int]) -> Frame:
    if size_px == (640, 480):
        return frame
    return Frame(frame.stamp, frame.sequence, np.asarray(cv2.resize(frame.image, size_px), np.uint8))


def world_ms(frames: int = 60) -> float:
    """Processor time of one simulated picture, 640 × 480."""
    world = World()
    world.frame(0.0, 0)
    start = process_time()
    for index in range(frames):
        world.frame(index / 30, index)
    return 1e3 * (process_time() - start) / frames
