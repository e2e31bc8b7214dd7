"""The self-check without truth: of pairs of which three in ten were made to diverge, which are refused?"""

from typing import Any

import numpy as np

from probewatch.appliance.core.registration.keyframe import Keyframe
from probewatch.appliance.core.registration.realtime_tracker import acceptable
from tests.bench.scenes import SCREEN
from tests.support.rendered import aspect, learnt_mask, levels, moved, rms_px, true_motion, world

_GOOD_PX = 1.0


def measure(count: int) -> dict[str, Any]:
    """Good pairs: up to 60 px, 1.5° and 0.4 mm of elevation, with overlay. Bad ones start 25–120 px beside the truth,
    or show another slice, or a picture turned by 20–40°. An honest descent may still recover from a bad start."""
    random = np.random.default_rng(7)
    good: list[bool] = []
    bad: list[bool] = []
    for k in range(count):
        accepted, error_px = _pair(k, random, spoilt=k % 10 < 3)
        (good if error_px <= _GOOD_PX else bad).append(accepted)
    return {
        "good": len(good),
        "good refused": _refused(good),
        "diverged": len(bad),
        "diverged refused": _refused(bad),
    }


def _refused(accepted: list[bool]) -> float | None:
    return 1 - float(np.mean(accepted)) if accepted else None


def _pair(k: int, random: np.random.Generator, spoilt: bool) -> tuple[bool, float]:
    seen = world(1 + k % 4, SCREEN)
    first = moved(np.eye(4), SCREEN, tuple(random.uniform(-30, 30, 2)), 0, random.uniform(-3, 3))
    px, turn = tuple(random.uniform(-42, 42, 2)), random.uniform(-1.5, 1.5)
    later = moved(first, SCREEN, px, turn, random.uniform(-0.4, 0.4))
    truth = true_motion(first, moved(first, SCREEN, px, turn), SCREEN)
    kind, side = (int(random.integers(3)) if spoilt else -1), random.choice([-1, 1], 2)
    start = np.zeros(2), 0.0
    if kind == 0:
        start = truth[0] + side * random.uniform(25, 120, 2), truth[1] + random.uniform(-0.1, 0.1)
    elif kind == 1:
        later = moved(later, SCREEN, elevation_mm=side[0] * random.uniform(4, 8))
    elif kind == 2:
        later = moved(later, SCREEN, (0, 0), side[0] * random.uniform(20, 40))
    keyframe = Keyframe(levels(seen, first, 2 * k), aspect(SCREEN), learnt_mask(seen).mask)
    found = keyframe.register(levels(seen, later, 2 * k + 1), start)
    error_px = rms_px((found.u_px, found.alpha_rad), truth, SCREEN) if kind < 1 else np.inf
    return acceptable(found), error_px
