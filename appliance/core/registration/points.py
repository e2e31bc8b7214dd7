"""Wraps what registration does to every point of a keyframe, `points.c` and `descent.c`, for NumPy's arrays."""

import ctypes
from collections.abc import Sequence
from ctypes import POINTER, c_double, c_float, c_int32, c_void_p, sizeof

import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.registration.compiled import LAYOUT, declared, unusable
from probewatch.appliance.core.registration.pyramid import Bits, Level
from probewatch.drivers.rigid import Array

_PARTS = 5
"""Rows of `Picture.described`."""
_PARAMETERS, _CELLS, _SUMS, _LOOKS, *_SIZES = LAYOUT
_GIVES, _MOVES, _ENERGIES = 6, 9, 3
"""As in compiled.h: terms by which tissue gives way, motions including them, and sums of squares of the gradient."""
_MOST_SIDE = np.iinfo(np.int16).max


class Picture(ctypes.Structure):
    """Holds the level, (h, w), that is looked at. Raises ValueError where h or w is less than 2 or more than 32767."""

    _fields_ = (("_grey", c_void_p), ("_rows", c_int32), ("_columns", c_int32))

    def __init__(self, level: Level) -> None:
        if not 2 <= min(level.shape) <= max(level.shape) <= _MOST_SIDE:
            raise ValueError(f"a picture of {level.shape[0]} × {level.shape[1]} px cannot be looked at")
        self.shape = level.shape
        self._level = np.ascontiguousarray(level, np.int16)
        super().__init__(self._level.ctypes.data, *level.shape)

    def structured(
        self, mask: Bits | None, pitch: int, edge: int, flat_share: float, least_steep: int
    ) -> NDArray[np.int32]:
        """Returns the flat indices, (n,), of the pixels with structure among every pitch-th one within the mask.

        These hold all but flat_share of the energy of the gradient; the flat rest shows nothing. edge: px from the
        sides within which there are none. Raises ValueError for a pitch or edge of less than 1: the gradient of a pixel
        at the sides is outside the level.
        """
        if min(pitch, edge) < 1:
            raise ValueError(f"a pitch of {pitch} and an edge of {edge} px choose no points")
        pitch, edge = min(pitch, _MOST_SIDE), min(edge, _MOST_SIDE)
        if mask is not None:
            mask = np.ascontiguousarray(mask, np.bool_)
            if mask.shape != self.shape:
                raise ValueError(f"a mask of {mask.shape} px for a picture of {self.shape} px")
        rows, columns = (max(-(-(side - 2 * edge) // pitch), 0) for side in self.shape)
        found = np.empty(rows * columns, np.int32)
        sees = None if mask is None else mask.ctypes.data
        count = _structured(self, sees, pitch, edge, flat_share, least_steep, found.ctypes.data)
        return found[:count]

    def described(self, chosen: NDArray[np.int32], most: int) -> NDArray[np.int16]:
        """Returns column, row, right − left, below − above and grey, (5, n), of the pixels at these flat indices.

        Of more than `most` pixels it takes that many, evenly. None of them may be at the sides.
        """
        chosen = np.ascontiguousarray(chosen, np.int32)
        parts = np.empty((_PARTS, min(chosen.size, most)), np.int16)
        _describe(self, chosen.ctypes.data, chosen.size, parts.shape[1], parts.ctypes.data)
        return parts


class Fit(ctypes.Structure):
    """Holds the state of a descent.

    u_x, u_y: px, alpha: rad, gain and bias of the greys. give: (6,) px by which tissue gives way beside that, as in
    `keyframe.Registration`. stiff: (6,) px⁻², 1 ÷ the expected variance of each. response: share of the keyframe's
    gradient across, down and around that is still there, of what the gain leaves of it. lost: whether too little was in
    view.
    """

    _fields_ = (
        *((name, c_double) for name in ("u_x", "u_y", "alpha")),
        ("give", c_double * _GIVES),
        *((name, c_double) for name in ("gain", "bias")),
        ("stiff", c_double * _GIVES),
        ("response", c_double * 3),
        ("step", c_double * _MOVES),
        ("converged", c_int32),
        ("lost", c_int32),
        ("inverse_cutoff", c_float),
        ("sums", c_float * _SUMS * _CELLS),
        ("normal", c_double * _PARAMETERS * _PARAMETERS),
        ("curvature", c_double * _PARAMETERS * _PARAMETERS),
    )

    def __init__(
        self,
        u_x: float,
        u_y: float,
        alpha: float,
        gain: float = 1.0,
        bias: float = 0.0,
        give: Sequence[float] = (0.0,) * _GIVES,
        stiff: Sequence[float] = (0.0,) * _GIVES,
    ) -> None:
        super().__init__(u_x, u_y, alpha, tuple(give), gain, bias, tuple(stiff), (1.0, 1.0, 1.0))

    def together(self) -> float:
        """Returns how much less information neighbouring points give than the same number of independent ones.

        It is in units of what the residual answers, and valid after a descent that was responding. Returns −1 where
        that was lost, or where nothing can be concluded.
        """
        return float(_together(self))

    def copied(self) -> "Fit":
        """Returns a copy, from which another descent can go on."""
        return Fit.from_buffer_copy(self)

    def drawn(self, aspect: float, together: float, expected: Array) -> Array | None:
        """Takes the last step again with the variance that is expected of the terms, (6,) px².

        Returns the covariance, (3, 3), of u_x, u_y px and α rad: H⁻¹ S H⁻ᵀ, the sandwich of an M-estimate (Huber 1967),
        where H is the curvature with what is expected, and S comes from how much cells of the picture disagree. So
        neighbouring pixels of speckle, and what decorrelates with them, count once, whatever their number; and a
        picture in which only a part of the keyframe's contrast is left shows that much less. What the expected variance
        allows the terms is added. Returns None where the covariance is not a number. together: as from `together`.
        """
        found = (c_double * 9)()
        drawn = _draw(self, aspect, together, np.ascontiguousarray(expected, float).ctypes.data, found)
        return np.array(found).reshape(3, 3) if drawn else None


class Template(ctypes.Structure):
    """Holds points of one pyramid level with what a descent needs of them.

    parts: (5, n) as `Picture.described`, n > 0. factor: px of the full picture per px of the level. centre: column and
    row, px, of the middle of the picture. aspect: λ_axial ÷ λ_lateral. fading: px of depth, > 0, over which the drag of
    the skin falls to 1/e.
    """

    _fields_ = (
        *((name, c_void_p) for name in ("_column", "_row", "_across", "_down", "_grey")),
        ("count", c_int32),
        *((name, c_double) for name in ("factor", "centre_x", "centre_y", "aspect", "fading")),
        ("energy", c_double * _ENERGIES),
        ("normal", c_double * _PARAMETERS * _PARAMETERS),
    )

    def __init__(
        self, parts: NDArray[np.int16], factor: float, centre: tuple[float, float], aspect: float, fading: float
    ) -> None:
        self._parts = np.ascontiguousarray(parts, np.int16)
        assert self._parts.shape[0] == _PARTS
        assert self._parts.shape[1] > 0
        start, apart = self._parts.ctypes.data, self._parts.strides[0]
        places = (start + k * apart for k in range(_PARTS))
        super().__init__(*places, self._parts.shape[1], factor, *centre, aspect, fading)
        _prepare(self)

    def thinned(self, most: int) -> "Template":
        """Returns the same template with about `most` of the points."""
        parts = self._parts[:, :: max(self.count // most, 1)]
        return Template(parts, self.factor, (self.centre_x, self.centre_y), self.aspect, self.fading)

    def descend(
        self, picture: Picture, fit: Fit, most_steps: int, enough_px: float = 0.0, responding: bool = False
    ) -> None:
        """Takes up to most_steps steps, until one is shorter than enough_px (`converged`) or the fit is lost.

        responding: whether to measure after each step how much of the gradient is left, which the next steps and the
        conclusion need.
        """
        _descend(self, picture, fit, most_steps, enough_px, responding)

    def correlate(self, picture: Picture, fit: Fit, reach_px: float) -> tuple[list[float], float]:
        """Returns correlations of about a thousand points with the picture, and the share of these points in view.

        The correlations are those where the fit puts the points, and reach_px to the right, left, below and above; 0
        where there is nothing to correlate.
        """
        found = (c_double * _LOOKS)()
        share = _correlate(self, picture, fit, reach_px, found)
        return found[:], share


if [sizeof(structure) for structure in (Picture, Template, Fit)] != _SIZES:
    raise unusable("it was compiled from another source")

_seen = POINTER(Template), POINTER(Picture), POINTER(Fit)
_descend = declared("descend", *_seen, c_int32, c_double, c_int32)
_correlate = declared("correlate", *_seen, c_double, c_void_p, result=c_double)
_prepare = declared("prepare", POINTER(Template))
_together = declared("together", POINTER(Fit), result=c_double)
_draw = declared("draw", POINTER(Fit), c_double, c_double, c_void_p, c_void_p, result=c_int32)
_structured = declared(
    "structured", POINTER(Picture), c_void_p, c_int32, c_int32, c_double, c_int32, c_void_p, result=c_int32
)
_describe = declared("describe", POINTER(Picture), c_void_p, c_int32, c_int32, c_void_p)
