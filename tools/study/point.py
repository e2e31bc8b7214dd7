"""Computes how far points of the picture truly are from where the reference puts them, beside the bounds of the
line.
"""

from dataclasses import dataclass
from math import nan

import numpy as np

from probewatch.appliance.core.quality.point_error import Bounds, longest
from probewatch.drivers.rigid import Array, inverse, rigid
from probewatch.tools.study.samples import Conditions

PLACES = 200
"""Places of each picture. More show no more: the errors at places of one picture are nearly equal."""


@dataclass
class Coverage:
    """Holds how well the bounds of the line cover true errors. looks: number of looks at which there was a bound.

    narrow, wide: share of places of all looks at which the bounds of 95 and of 99.7 % covered the true error.
    narrow_off, wide_off: share at which the true error lay as near to the most likely one as 95 and 99.7 % of what is
    left open, which does not depend on how large the true error is. worst_mm, true_mm: mean over the looks of the bound
    of 99.7 % at the worst place, and of the true error at its worst one.
    """

    looks: int = 0
    narrow: float = nan
    wide: float = nan
    narrow_off: float = nan
    wide_off: float = nan
    worst_mm: float = nan
    true_mm: float = nan

    def look(self, bounds: Bounds, errors_mm: Array) -> None:
        """Takes the bounds and the true errors of one picture, (n, 3)."""
        size_mm, off_mm = (np.linalg.norm(one, axis=1) for one in (errors_mm, errors_mm - bounds.mean))
        narrow, wide = np.mean(size_mm <= bounds.bounds_mm, axis=1)
        around_mm = longest(np.zeros_like(bounds.mean), bounds.covariance)
        narrow_off, wide_off = np.mean(off_mm <= around_mm, axis=1)
        seen = (narrow, wide, narrow_off, wide_off, bounds.bounds_mm[1].max(), size_mm.max())
        for name, value in zip(_MEANS, seen, strict=True):
            before = getattr(self, name) if self.looks else 0.0
            setattr(self, name, float(before + (value - before) / (self.looks + 1)))
        self.looks += 1


_MEANS = ("narrow", "wide", "narrow_off", "wide_off", "worst_mm", "true_mm")


def places_mm(conditions: Conditions) -> Array:
    """Returns places, (PLACES, 3), spread over the picture at random, in its axes, mm from its middle."""
    session = conditions.session
    size_mm = np.array(session.size_px) * session.reference.scale_mm_per_px
    shares = np.random.default_rng((session.seed, 71)).uniform(-0.5, 0.5, (PLACES, 2))
    return np.pad(shares * size_mm, ((0, 0), (0, 1)))


def errors_mm(conditions: Conditions, t_s: float, at_mm: Array) -> Array:
    """Returns the displacement, (n, 3) → (n, 3) in the axes of the picture, from where reference and poses of the
    picture's stamp put each place to where it truly is; without the noise of a pose, and without its error by place or
    by metal, which are not errors of the calibration.
    """
    session, hazard, t = conditions.session, conditions.hazard, np.array([t_s])
    change, reference = hazard.change(t)[0], session.reference
    body = hazard.body(reference, t)[0]
    told = session.probe(t - change[8])[0] @ body @ inverse(rigid(reference.rotation, reference.offset_mm))
    true, scales = session.probe(t)[0], 1 + np.append(change[3:5], 0.0)
    return np.asarray((_moved(true, at_mm * scales) - _moved(told, at_mm)) @ true[:3, :3])


def _moved(pose: Array, at_mm: Array) -> Array:
    return np.asarray(at_mm @ pose[:3, :3].T + pose[:3, 3])
