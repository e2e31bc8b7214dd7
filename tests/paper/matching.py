"""From a sweep to motions: pictures d apart registered to each other, or all along a chain of keyframes."""

import numpy as np

from probewatch.appliance.core.handeye.motions import Motions
from probewatch.appliance.core.path.samples import PathSamples
from probewatch.appliance.core.registration.keyframe import Keyframe, compose
from probewatch.appliance.core.registration.pyramid import pyramid
from tests.paper.sweeps import FPS, SCALE, Sweep

ASPECT = float(SCALE[1] / SCALE[0])
_RENEW_CORRELATION, _RENEW_PX = 0.8, 25.0
_APART_FRAMES = 2
_REST = (np.zeros(2), 0.0)


class Pairs:
    """Pictures d apart of one sweep, each picture's template made once."""

    def __init__(self, seen: Sweep) -> None:
        self._poses = seen.poses
        self._levels = [pyramid(picture) for picture in seen.pictures]
        self._templates = [Keyframe(levels, ASPECT) for levels in self._levels]

    def apart(self, d: int) -> Motions:
        """Motion i goes from picture i to i + d; each starts from the one before, as in the paper."""
        warm = (np.zeros(2), 0.0)
        u, alpha = [], []
        for template, levels in zip(self._templates, self._levels[d:], strict=False):
            found = template.register(levels, warm)
            warm = (found.u_px, found.alpha_rad)
            u.append(found.u_px)
            alpha.append(found.alpha_rad)
        return Motions.of_pictures(np.array(u), np.array(alpha), self._poses[:-d], self._poses[d:])


def first(motions: Motions, n: int) -> Motions:
    """The first n of them."""
    return Motions(motions.u[:n], motions.R_a[:n], motions.R_b[:n], motions.t_b[:n])


def keyframe_chain(seen: Sweep) -> PathSamples:
    """The path along keyframes that are renewed when likeness or displacement end them, as in the service.

    These pictures have no overlay, so none is learnt.
    """
    levels = [pyramid(picture) for picture in seen.pictures]
    keyframe, start, warm = Keyframe(levels[0], ASPECT), _REST, _REST
    path = [_REST]
    for picture in levels[1:]:
        found = keyframe.register(picture, warm)
        warm = (found.u_px, found.alpha_rad)
        path.append(compose(start, warm, ASPECT))
        if found.correlation < _RENEW_CORRELATION or np.hypot(*found.u_px) > _RENEW_PX:
            keyframe, start, warm = Keyframe(picture, ASPECT), path[-1], _REST
    where = np.arange(len(path))
    before, after = np.maximum(where - _APART_FRAMES, 0), np.minimum(where + _APART_FRAMES, len(where) - 1)
    return PathSamples(
        t_s=seen.t_s,
        chain=np.ones(len(path), dtype=np.int64),
        u_px=np.array([u_px for u_px, _ in path]),
        alpha_rad=np.array([alpha_rad for _, alpha_rad in path]),
        poses=seen.poses,
        earlier_poses=seen.poses[before],
        later_poses=seen.poses[after],
        apart_s=2 * _APART_FRAMES / FPS,
    )


def first_pictures(samples: PathSamples, n: int) -> PathSamples:
    """The first n of them."""
    around = samples.poses[:n], samples.earlier_poses[:n], samples.later_poses[:n]
    return PathSamples(
        samples.t_s[:n],
        samples.chain[:n],
        samples.u_px[:n],
        samples.alpha_rad[:n],
        *around,
        samples.apart_s,
    )
