"""The compiled part of registration, `points.c`, for NumPy's arrays."""

import ctypes
from ctypes import POINTER, c_float, c_int32, c_void_p
from typing import Any

import numpy as np
from numpy.typing import NDArray

from appliance.core.geometry import Array
from appliance.core.pyramid import Array32, Bits, Level

_LOOKED_UP, _RESPONDED, _LOOKS, _PARTS, _PARAMETERS = 9, 6, 5, 6, 5


class _Picture(ctypes.Structure):
    _fields_ = (("grey", c_void_p), ("rows", c_int32), ("columns", c_int32), ("bytes", c_int32))


class _Points(ctypes.Structure):
    _fields_ = (*((name, c_void_p) for name in ("x", "y", "across", "down", "turn", "grey")), ("count", c_int32))


class Warp(ctypes.Structure):
    """Takes points to column xx·x + xy·y + x0 and row yx·x + yy·y + y0 of a picture, their grey to gain·grey + bias."""

    _fields_ = tuple((name, c_float) for name in ("xx", "xy", "x0", "yx", "yy", "y0", "gain", "bias"))


class Picture:
    """(h, w) grey values to be looked at. Raises ValueError where h or w is less than 2."""

    def __init__(self, grey: Level) -> None:
        if min(grey.shape) < 2:
            raise ValueError(
                f"a picture of {grey.shape[0]} × {grey.shape[1]} px cannot be looked at between its pixels"
            )
        self.shape = grey.shape
        self._grey = np.ascontiguousarray(grey)
        self.native = _Picture(self._grey.ctypes.data, *grey.shape, grey.dtype == np.uint8)

    def structured(
        self, mask: Bits | None, pitch: int, edge: int, flat_share: float, least_steep: int
    ) -> NDArray[np.int32]:
        """(n,) flat indices of every pitch-th pixel, edge px from the sides, mask permitting, that has structure.

        That is all but flat_share of the energy of the gradient; the flat rest says nothing.
        """
        if mask is not None:
            mask = np.ascontiguousarray(mask)
            assert mask.shape == self.shape
        rows, columns = (max(-(-(side - 2 * edge) // pitch), 0) for side in self.shape)
        found = np.empty(rows * columns, np.int32)
        sees = None if mask is None else mask.ctypes.data
        count = _structured(self.native, sees, pitch, edge, flat_share, least_steep, found.ctypes.data)
        return found[:count]

    def describe(
        self, chosen: NDArray[np.int32], most: int, factor: float, left: float, top: float, aspect: float
    ) -> "Points":
        """At most so many points, evenly taken from flat indices of pixels that are not at the sides.

        left, top: where the first pixel is, px of the full picture from its centre. factor: px of that per px. aspect:
        λ_axial ÷ λ_lateral.
        """
        count = min(chosen.size, most)
        parts = np.empty((_PARTS, count), np.float32)
        _describe(self.native, chosen.ctypes.data, chosen.size, count, factor, left, top, aspect, parts.ctypes.data)
        return Points(parts)


class Points:
    """n points of a keyframe.

    parts: (6, n) x and y in px of the full picture from its centre, ∂grey/∂(u_x, u_y, α), grey; n > 0.
    """

    def __init__(self, parts: Array32) -> None:
        self.parts = np.ascontiguousarray(parts, np.float32)
        self.count = self.parts.shape[1]
        assert self.parts.shape[0] == _PARTS
        assert self.count > 0
        start, apart = self.parts.ctypes.data, self.parts.strides[0]
        self.native = _Points(*(start + k * apart for k in range(_PARTS)), self.count)

    def thinned(self, each: int) -> "Points":
        """Every each-th of them."""
        return Points(self.parts[:, ::each])

    def energy(self) -> tuple[float, ...]:
        """Σ of (∂u_x², ∂u_y², ∂α², 1), none of them 0."""
        return *np.maximum(np.square(self.parts[2:5]).sum(axis=1), 1e-9).tolist(), float(self.count)

    def curvature(self, sampled: int, weights: Array32 | None = None) -> Array:
        """(5, 5) Σ ψ′ J Jᵀ over all points, told from about `sampled`; J = ∂grey/∂(u_x, u_y, α), grey, 1.

        ψ′ is the slope of Tukey's ψ at a residual of that weight, (n,); 1 without weights.
        """
        found = np.empty((_PARAMETERS, _PARAMETERS), np.float32)
        _curvature(self.native, sampled, None if weights is None else weights.ctypes.data, found.ctypes.data)
        return found.astype(np.float64)

    def judge(self, picture: Picture, warp: Warp, sampled: int, reach_px: float) -> tuple[list[float], float]:
        """Correlation of about `sampled` points with the picture where the warp puts them, and so far to the right,
        left, below and above; 0 where there is nothing to correlate. And the share of them in view."""
        found = (c_float * _LOOKS)()
        share = _judge(self.native, picture.native, warp, sampled, reach_px, found)
        return found[:], share


class Look:
    """The points as they were last seen in a picture.

    weights: (n,) Tukey's of what gain and bias leave unexplained, 0 out of view. weighted: (n,) weight times that.
    """

    def __init__(self, points: Points) -> None:
        self._points = points
        self.weights, self.weighted = np.zeros((2, points.count), np.float32)
        self._at = self.weights.ctypes.data, self.weighted.ctypes.data
        self._warp = Warp()

    def take(
        self, picture: Picture, warp: Warp, sampled: int, tukey: float, least_scale: float
    ) -> tuple[int, list[float]]:
        """How many points are in view, and nine sums: of weighted · (∂u_x, ∂u_y, ∂α, grey, 1) and of weight · (∂u_x²,
        ∂u_y², ∂α², 1). The scale of the residuals comes from the median of about `sampled` of them."""
        self._warp = warp
        sums = (c_float * _LOOKED_UP)()
        seen = _look(self._points.native, picture.native, warp, sampled, tukey, least_scale, *self._at, sums)
        return seen, sums[:]

    def respond(self, picture: Picture, sampled: int) -> list[float]:
        """Sums over about `sampled` points, where they were last seen: of weight · slope of the picture, to the right
        and down, · (∂u_x, ∂u_y), four of them; then of weight · (∂u_x², ∂u_y²)."""
        sums = (c_float * _RESPONDED)()
        _respond(self._points.native, picture.native, self._warp, sampled, self._at[0], sums)
        return sums[:]

    def strips(self, count: int) -> Array:
        """(5, count) sums of weighted · (∂u_x, ∂u_y, ∂α, grey, 1) over strips of the picture, from top to bottom."""
        scores = np.empty((_PARAMETERS, count), np.float32)
        _strips(self._points.native, self._at[1], count, scores.ctypes.data)
        return scores.astype(np.float64)


def _declared(name: str, *arguments: Any, result: Any = None) -> Any:
    function = getattr(_library, name)
    function.argtypes, function.restype = arguments, result
    return function


try:
    _library = np.ctypeslib.load_library("_points", __file__)
except OSError as missing:
    raise ImportError(f"{missing}: points.c is not compiled for this machine; `make .venv/dev` does that") from missing
_seen = POINTER(_Points), POINTER(_Picture), POINTER(Warp), c_int32
_look = _declared("look", *_seen, c_float, c_float, c_void_p, c_void_p, c_void_p, result=c_int32)
_respond = _declared("respond", *_seen, c_void_p, c_void_p)
_judge = _declared("judge", *_seen, c_float, c_void_p, result=c_float)
_curvature = _declared("curvature", POINTER(_Points), c_int32, c_void_p, c_void_p)
_strips = _declared("strips", POINTER(_Points), c_void_p, c_int32, c_void_p)
_structured = _declared(
    "structured", POINTER(_Picture), c_void_p, c_int32, c_int32, c_float, c_int32, c_void_p, result=c_int32
)
_describe = _declared("describe", POINTER(_Picture), c_void_p, c_int32, c_int32, *(c_float,) * 4, c_void_p)
