"""A probe on tissue that costs a fraction of a millisecond per picture: the truth that the oracle knows.

Conventions as in appliance.types. Tissue is a plane of speckle that looks the same at every elevation, so tilting the
probe moves the picture as geometry says and never changes the speckle. Everything is seeded.
"""

from dataclasses import dataclass, field, replace
from functools import cache, cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import rigid, rotation_from_vector, vector_from_rotation
from probewatch.drivers.samples import GreyImage, Matrix4
from probewatch.drivers.twins.faults import BEND_AXIS, BEND_DEG, SLIDE_MM
from tests.invariant.circumstances import Manner

WIDTH_PX, ROWS = 160, 120
"""The smallest in which the features of a sweep are followed: the time goes into the pictures."""
SCALE_MM_PER_PX = (0.12, 0.11)
_LIMITS = Limits()
_GRID_MM = 0.06
_GRID = 1024
_NOISE_GREY = 5.0
_STEPS, _TIMES = 6, 3.0
"""Of a wipe with pauses, and how many times its time constant an average takes."""
_SPREAD_MM, _SPREAD_RAD = 0.1, np.deg2rad(0.02)
"""Of one reading of the tracker, per axis: those of the simulated cart."""
_FROM_TISSUE = rigid(rotation_from_vector(np.array([1.9, 0.7, -0.5])), np.array([64.0, -87.0, -1520.0]))
X_REFERENCE = rigid(rotation_from_vector(np.array([0.62, -0.41, 0.93])), np.array([11.0, 62.0, 14.0]))


def reference() -> Calibration:
    """For the pictures of the scanner."""
    return Calibration(
        rotation=X_REFERENCE[:3, :3],
        polarity=(1, 1),
        scale_mm_per_px=np.array(SCALE_MM_PER_PX),
        offset_mm=X_REFERENCE[:3, 3],
        image_size_px=(WIDTH_PX, ROWS),
    )


@dataclass(frozen=True, eq=False, repr=False)
class Change:
    """How the true calibration differs from the reference.

    body: (4, 4) the marker body sits at pose · body. polarity: of the picture. magnified: of the picture across and
    down, about its middle, so that its mm/px shrink. moved_px: of the picture on the screen, (lateral, axial).
    lines_deg: by which lines across and lines down are turned on it: alike of a picture that is turned, one of them of
    one that is sheared.
    """

    name: str
    body: Matrix4 = field(default_factory=lambda: np.eye(4))
    polarity: tuple[int, int] = (1, 1)
    magnified: tuple[float, float] = (1.0, 1.0)
    moved_px: tuple[float, float] = (0.0, 0.0)
    lines_deg: tuple[float, float] = (0.0, 0.0)

    def __repr__(self) -> str:
        return self.name

    @cached_property
    def moves_body(self) -> bool:
        return not np.array_equal(self.body, np.eye(4))

    @cached_property
    def faults(self) -> frozenset[str]:
        """Classes of the parameters that are beyond their limits."""
        return frozenset(name for name, misfit in self._misfits().items() if misfit > 1)

    @cached_property
    def right(self) -> frozenset[str]:
        """Classes of the parameters that are within their limits."""
        return frozenset(self._misfits()) - self.faults

    @cached_property
    def spoils_picture(self) -> bool:
        """Whether the picture alone makes a parameter wrong."""
        picture = replace(self, body=np.eye(4))
        return bool(picture.faults)

    def on_its_way(self, share: float) -> "Change":
        """What an animation has done of it so far to the picture."""
        across, down = (m**share for m in self.magnified)
        moved_px, lines_deg = ((share * one, share * other) for one, other in (self.moved_px, self.lines_deg))
        return replace(self, magnified=(across, down), moved_px=moved_px, lines_deg=lines_deg)

    @cached_property
    def shown_px(self) -> NDArray[np.float64]:
        """(2, 2) from px of the scanner's own picture to px on the screen, without magnification and flip."""
        across, down = np.tan(np.deg2rad(self.lines_deg))
        return np.array([[1.0, -down], [across, 1.0]])

    @cached_property
    def visible(self) -> bool:
        """A parameter that any sweep shows is off by twice its limit or more, or it is the bend with a slide."""
        shown = max(misfit for name, misfit in self._misfits().items() if name != "offset")
        return shown >= 2 or (shown > 1 and self._misfits()["offset"] >= 2)

    @cached_property
    def gross(self) -> bool:
        """Some parameter is off by twice its limit or more."""
        return max(self._misfits().values()) >= 2

    def _misfits(self) -> dict[str, float]:
        """Class → how far out, 1 at the limit. Of the rotation the angle about the elevational axis is taken."""
        X = X_REFERENCE @ self.body
        turn_rad = vector_from_rotation(X[:3, :3] @ X_REFERENCE[:3, :3].T)
        moved_mm = np.array([*np.multiply(self.moved_px, SCALE_MM_PER_PX), 0.0])
        return {
            "polarity": self.polarity.count(-1) / 0.5,
            "scale": 100 * max(abs(1 / m - 1) for m in self.magnified) / _LIMITS.scale_percent,
            "rotation": (abs(float(np.rad2deg(turn_rad[2]))) + max(map(abs, self.lines_deg))) / _LIMITS.rotation_deg,
            "offset": float(np.linalg.norm(X[:3, 3] - X_REFERENCE[:3, 3] + moved_mm)) / _LIMITS.offset_mm,
        }


def _bent_and_slid(bend_deg: float, slide_mm: tuple[float, float, float]) -> Matrix4:
    axis = np.array(BEND_AXIS) / np.linalg.norm(BEND_AXIS)
    return rigid(rotation_from_vector(np.deg2rad(bend_deg) * axis), np.array(slide_mm))


def _moved_in_picture(offset_mm: tuple[float, float, float]) -> Matrix4:
    """The body sits so that t_x differs by this much, in picture axes."""
    return rigid(np.eye(3), X_REFERENCE[:3, :3].T @ np.array(offset_mm))


NONE = Change("as calibrated")
BENT_AND_SLID = Change("bent by 5° and slid by 10 mm", _bent_and_slid(BEND_DEG, SLIDE_MM))
BENT = Change("bent by 10°", _bent_and_slid(10.0, (0.0, 0.0, 0.0)))
SLID = Change("slid by 10 mm", _bent_and_slid(0.0, SLIDE_MM))
ELSEWHERE = Change("30 mm off in ζ", _moved_in_picture((0.0, 0.0, 30.0)))
FLIPPED = Change("flipped laterally", polarity=(-1, 1))
UPSIDE_DOWN = Change("flipped vertically", polarity=(1, -1))
MAGNIFIED = Change("magnified by 12.5 %", magnified=(1.125, 1.125))
SHRUNK = Change("shrunk by 12.5 %", magnified=(0.875, 0.875))
SLIGHTLY_MAGNIFIED = Change("magnified by 8.7 %", magnified=(1.087, 1.087))
ZOOMED = Change("zoomed by 30 %", magnified=(1.3, 1.3), moved_px=(0.0, 18.0))
ZOOMED_TWICE = Change("zoomed by 2", magnified=(2.0, 2.0))
ZOOMED_ON_A_REGION = Change("zoomed by 30 % about a region of interest", magnified=(1.3, 1.3), moved_px=(24.0, -15.0))
DEEPER = Change("a deeper setting", magnified=(0.75, 0.75), moved_px=(0.0, -15.0))
PRESET = Change("a preset: deeper and mirrored", polarity=(-1, 1), magnified=(0.75, 0.75))
STRETCHED = Change("stretched by 20 % across", magnified=(1.2, 1.0))
SHIFTED = Change("moved by 50 px on the screen", moved_px=(50.0, 0.0))
ANOTHER_ASPECT = Change("stretched by 8 % down", magnified=(1.0, 1.08), moved_px=(0.0, 4.8))
CORNERED = Change("zoomed by 7.5 % about a corner", magnified=(1.075, 1.075), moved_px=(6.0, 4.5))
TURNED = Change("turned by 8° on the screen", lines_deg=(8.0, 8.0))
SHEARED = Change("sheared by 14°", lines_deg=(0.0, 14.0))
CROPPED = Change("cropped to the right, and as large as before", magnified=(1.25, 1.25), moved_px=(-20.0, 0.0))
BREAKS = (
    *(FLIPPED, UPSIDE_DOWN, ZOOMED, ZOOMED_TWICE, ZOOMED_ON_A_REGION, DEEPER, PRESET, STRETCHED, SHIFTED),
    *(TURNED, SHEARED, CROPPED),
)
"""What people do to a picture, or a grabber."""
MOVED = (SHIFTED, TURNED, SHEARED)
"""Pictures as large as before, whose tissue lies elsewhere."""
CHANGES = (BENT_AND_SLID, BENT, SLID, ELSEWHERE, FLIPPED, UPSIDE_DOWN, MAGNIFIED, SHRUNK, SLIGHTLY_MAGNIFIED)


@cache
def tissue() -> GreyImage:
    """(1024, 1024) periodic speckle, 0.06 mm apart, wider than high as a probe's is."""
    random = np.random.default_rng(20)
    waves = random.standard_normal((2, _GRID, _GRID)).astype(np.float32)
    real, imaginary = (
        cv2.GaussianBlur(np.tile(w, (3, 3)), (0, 0), 5.5, sigmaY=3.2)[_GRID : 2 * _GRID, _GRID : 2 * _GRID]
        for w in waves
    )
    echo = real**2 + imaginary**2
    level = 10 * np.log10(echo / echo.mean() + 1e-3)
    return np.clip(130 + 4.25 * level, 0, 255).astype(np.uint8)


@cache
def _noise() -> GreyImage:
    return np.random.default_rng(21).normal(12, _NOISE_GREY, (ROWS + 512, WIDTH_PX + 512)).clip(0, 255).astype(np.uint8)


_WAVES = (
    (7.0, 7.4, 0),
    (0.7, 2.7, 0),
    (4.2, 5.3, 1),
    (0.5, 2.1, 1),
    (1.0, 8.7, 3),
    (0.85, 6.3, 4),
    (6.2, 9.3, 5),
)
"""Amplitude (mm; of the tilts relative; of the turn deg), period s, and axis: place x, y, z, turn about x, y, z."""


class Hand:
    """Presses, slides, turns and tilts the probe a little; it can rest. tilt_deg: 0 keeps it in the plane; where it is
    set to another the hand comes to it within a second or so.
    """

    def __init__(self, seed: int, tilt_deg: float) -> None:
        random = np.random.default_rng((seed, 1))
        size, period_s, axis = np.array(_WAVES).T
        self._size = size * random.uniform(0.9, 1.1, size.size)
        self._rate = 2 * np.pi / (period_s * random.uniform(0.93, 1.08, size.size))
        self._phase = random.uniform(-0.8, 0.8, size.size)
        self._axes = axis == np.arange(6)[:, None]
        self._tilt_deg = self.tilt_deg = tilt_deg
        self._moved_s = 0.0
        self._liveliness = 1.0

    def go_on(self, dt_s: float, moving: bool) -> None:
        """Come to rest, or get going, within a fifth of a second."""
        self._liveliness = min(max(self._liveliness + (5 if moving else -5) * dt_s, 0.0), 1.0)
        self._moved_s += self._liveliness * dt_s
        self._tilt_deg += min(dt_s, 1.0) * (self.tilt_deg - self._tilt_deg)

    def pose(self) -> Matrix4:
        """(4, 4) picture → tissue, mm."""
        place = self._axes @ (self._size * np.sin(self._rate * self._moved_s + self._phase))
        place[3:5] *= self._tilt_deg
        return _rigid(np.deg2rad(place[3:]), place[:3])


def _rigid(turn_rad: NDArray[np.float64], place_mm: NDArray[np.float64]) -> Matrix4:
    """As drivers.rigid makes it, in a tenth of the time."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = cv2.Rodrigues(turn_rad)[0], place_mm
    return matrix


class Scanner:
    """Cuts its pictures out of the tissue."""

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng((seed, 2))
        self._shape = ROWS, WIDTH_PX

    def picture(self, pose: Matrix4, change: Change = NONE) -> GreyImage:
        """(h, w) uint8 at pose picture → tissue."""
        height, width = self._shape
        scale = np.array(SCALE_MM_PER_PX) / change.magnified * change.polarity
        turn = pose[:2, :2] * scale @ np.linalg.inv(change.shown_px) / _GRID_MM
        middle = pose[:2, 3] / _GRID_MM + _GRID / 2
        origin_px = np.array([(width - 1) / 2, (height - 1) / 2]) + change.moved_px
        warp = np.column_stack([turn, middle - turn @ origin_px])
        grey = cv2.warpAffine(
            tissue(), warp, (width, height), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_WRAP
        )
        return np.asarray(cv2.add(grey, self._grain()), np.uint8)

    def black(self) -> GreyImage:
        """No gel: faint electronic noise only."""
        return self._random.integers(0, 5, self._shape).astype(np.uint8)

    def noise(self) -> GreyImage:
        """A lost cable: every pixel by itself."""
        return self._random.integers(0, 256, self._shape).astype(np.uint8)

    def _grain(self) -> GreyImage:
        row, column = self._random.integers(0, 512, 2)
        return _noise()[row : row + self._shape[0], column : column + self._shape[1]]


def blended(before: GreyImage, after: GreyImage, manner: Manner, share: float) -> GreyImage:
    """So much of the way, 0 … 1, from one picture to the other."""
    height, width = before.shape
    if manner is Manner.WIPED:
        row = int(share * height)
        return np.vstack([after[:row], before[row:]])
    if manner is Manner.WIPED_IN_STEPS:
        column = int(share * _STEPS + 1) * width // (_STEPS + 1)
        return np.hstack([after[:, :column], before[:, column:]])
    weight = 1 - np.exp(-_TIMES * share) if manner is Manner.AVERAGED else share
    return np.asarray(cv2.addWeighted(before, 1 - weight, after, weight, 0), np.uint8)


class Tracker:
    """Reads the pose of the marker body. moved: (4, 4) its own axes of before → now; a bump changes them."""

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng((seed, 3))
        self.moved: Matrix4 = np.eye(4)

    def reading(self, pose: Matrix4, change: Change = NONE) -> Matrix4:
        """(4, 4) sensor → tracker, mm, as reported for the picture's pose."""
        spread = _rigid(self._random.normal(0, _SPREAD_RAD, 3), np.zeros(3))
        reading = self.moved @ _FROM_TISSUE @ pose @ X_REFERENCE @ change.body @ spread
        reading[:3, 3] += self._random.normal(0, _SPREAD_MM, 3)
        return reading
