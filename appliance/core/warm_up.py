"""Runs the rare paths of the line once, so that the first real fault does not wait for code to be read from disk."""

import cv2
import numpy as np

from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.core.detectors.picture_chain import PictureChain
from probewatch.appliance.core.registration.realtime_tracker import RealTimeTracker
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration
from probewatch.drivers.samples import GreyImage

_FRAME_NS = 33_000_000
"""Time between the pictures, ns: 30 a second."""


def warm_up(width_px: int = 640, height_px: int = 480) -> None:
    """Processes a few still pictures, then one that does not follow them: it is searched for, and taken for
    mirrored.
    """
    noise = np.random.default_rng(1).integers(0, 255, (height_px, width_px), dtype=np.uint8)
    picture: GreyImage = np.asarray(cv2.GaussianBlur(noise, (0, 0), 3), dtype=np.uint8)
    pictures = [*([picture] * 8), np.asarray(cv2.flip(picture, 1), dtype=np.uint8)]
    any_probe = Calibration(np.eye(3), (1, 1), np.ones(2), np.zeros(3), (width_px, height_px))
    tracker = RealTimeTracker(1.0)
    chain = PictureChain(Limits(), any_probe, lambda: tracker.mask, lambda: True, 10 * _FRAME_NS)
    for number, image in enumerate(pictures):
        tracked = tracker.step(image, number)
        followed = tracked.registration is not None
        chain.see(Observation(number * _FRAME_NS, image, repeated=False, followed=followed, warp=tracked.step))
