"""A tracked ultrasound scanner that shares nothing with the simulated cart: scatterers in a solid, seen by an array.

Every picture is an echo: the scatterers within the beam's thickness add up with their phase along the lines of a curved
or straight array, blurred by its point spread, with the receiver's noise; the envelope is compressed. The lines are
kept (`Scanner.lines`), and drawn onto the screen last (`Screen`), as scanners do: a change of depth, a flip or a zoom
draws the same echoes elsewhere.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.types import Calibration
from probewatch.drivers.samples import GreyImage

Reals = NDArray[np.float64]

SIZE_PX = (320, 240)
MM_PER_PX = np.array([0.165, 0.18])
DEPTH_MM = float(SIZE_PX[1] * MM_PER_PX[1])
"""Of the picture as it was calibrated; the echoes reach deeper, for a screen that shows more."""
_REACH_MM, _SAMPLE_MM, _LINES = 62.0, 0.13, 176
_WAVE_MM, _PULSE_MM = 0.3, 0.22
_BEAM_LINES, _THICKNESS_MM = 1.4, 0.9
"""σ of the pulse, of the beam across the lines, and of its thickness out of the plane, all of the amplitude."""
_CELL_MM = 5.0
_PER_MM3 = 2.0
"""Scatterers: two or three in every cell of the point spread."""
_LOW_MM, _HIGH_MM = np.array([-40.0, -6.0, -24.0], np.float32), np.array([40.0, 66.0, 24.0], np.float32)
_DYNAMIC_DB, _NOISE_DB = 58.0, -42.0


@dataclass(frozen=True)
class Array1D:
    """radius_mm: of the face, None for a straight array. half: half the opening, rad, or half the face, mm."""

    radius_mm: float | None
    half: float

    def line_depth(self, points_mm: Reals) -> tuple[Reals, Reals]:
        """(n,) line as a fraction of 0 … lines - 1, and depth, mm, of places (n, 2) in the plane, from the face."""
        x, y = points_mm.T
        if self.radius_mm is None:
            across, depth = x, y
        else:
            across, depth = np.arctan2(x, y + self.radius_mm), np.hypot(x, y + self.radius_mm) - self.radius_mm
        return (across / self.half + 1) / 2 * (_LINES - 1), depth


CONVEX = Array1D(52.0, np.deg2rad(27.0))
LINEAR = Array1D(None, 23.0)


class Tissue:
    """Speckle with fascia in layers that are alike on both sides, nodules, cysts and vessels, 80 × 72 × 48 mm."""

    def __init__(self, seed: int) -> None:
        random = np.random.default_rng(seed)
        count = round(float(np.prod(_HIGH_MM - _LOW_MM)) * _PER_MM3)
        points = _LOW_MM + random.random((count, 3), dtype=np.float32) * (_HIGH_MM - _LOW_MM)
        strength = random.standard_normal(count, dtype=np.float32) * self._echogenicity(points, random)
        cells = ((points - _LOW_MM) / _CELL_MM).astype(int)
        self._counts = np.ceil((_HIGH_MM - _LOW_MM) / _CELL_MM).astype(int)
        cell = np.ravel_multi_index(tuple(cells.T), tuple(self._counts))
        order = np.argsort(cell, kind="stable")
        self._points, self._strength = points[order], strength[order]
        self._starts = np.searchsorted(cell[order], np.arange(int(np.prod(self._counts)) + 1))
        corners = np.stack(np.unravel_index(np.arange(int(np.prod(self._counts))), tuple(self._counts)), axis=1)
        self._middles = _LOW_MM + (corners + 0.5) * _CELL_MM

    def near(self, place_mm: Reals, normal: Reals, apart_mm: float) -> tuple[Reals, Reals]:
        """(n, 3) and (n,) points, and how they scatter, within at least so much of a plane."""
        close = np.abs((self._middles - place_mm) @ normal) < apart_mm + _CELL_MM * 0.87
        edges = np.flatnonzero(np.diff(np.concatenate([[0], close.astype(int), [0]])))
        runs = [slice(self._starts[a], self._starts[b]) for a, b in zip(edges[::2], edges[1::2], strict=True)]
        return np.concatenate([self._points[run] for run in runs]), np.concatenate(
            [self._strength[run] for run in runs]
        )

    @staticmethod
    def _echogenicity(points: Reals, random: np.random.Generator) -> Reals:
        x, y, z = points.T
        strength = np.full(len(points), 0.6, np.float32)
        for depth_mm in np.cumsum(random.uniform(3.0, 8.0, 12)).astype(np.float32):
            off_mm = y - depth_mm - np.float32(0.08) * z - np.float32(random.uniform(0.002, 0.006)) * x * x
            strength[np.abs(off_mm) < 0.3] += np.float32(1.5)
            strength[off_mm > 0] *= np.float32(random.uniform(0.75, 1.3))
        for _ in range(60):
            middle, radius_mm = random.uniform(_LOW_MM, _HIGH_MM), random.uniform(2.0, 6.0)
            off = (points - middle.astype(np.float32)) / (radius_mm * random.uniform(0.7, 1.5, 3)).astype(np.float32)
            strength[np.einsum("ij,ij->i", off, off) < 1] *= np.float32(random.choice([0.15, 0.4, 2.2]))
        for _ in range(8):
            middle, along = random.uniform(_LOW_MM, _HIGH_MM), random.normal(size=3)
            off = (points - middle.astype(np.float32)) @ _beside(along)
            strength[np.einsum("ij,ij->i", off, off) < random.uniform(1.0, 2.5) ** 2] *= np.float32(0.1)
        return strength


def _beside(along: Reals) -> NDArray[np.float32]:
    """(3, 2) unit vectors at right angles to a vector."""
    return np.linalg.svd(along[None])[2][1:].T.astype(np.float32)


class Scanner:
    """averaged: share of the picture before that stays in the next, 0 … 1."""

    def __init__(self, array: Array1D, tissue: Tissue, seed: int, averaged: float = 0.0) -> None:
        self._array, self._tissue, self._averaged = array, tissue, averaged
        self._random = np.random.default_rng(seed + 1000)
        samples = round(_REACH_MM / _SAMPLE_MM)
        self._shape = (_LINES, samples)
        knobs = self._random.uniform(-4.0, 4.0, 8)
        depth = np.linspace(0, 7, samples)
        across = np.linspace(-1, 1, _LINES)[:, None]
        self._gain_db = np.interp(depth, np.arange(8), knobs) - 3.0 * across**2 - 6.0 * depth / 7
        self._before: NDArray[np.float32] | None = None

    def lines(self, pose: Reals, moved_mm: Reals) -> GreyImage:
        """(lines, samples) of the tissue, which has moved by moved_mm. pose: (4, 4) picture → tissue as it lies."""
        R = pose[:3, :3]
        face = pose[:3, 3] - R[:, 1] * DEPTH_MM / 2 - moved_mm
        points, strength = self._tissue.near(face, R[:, 2], 2.2 * _THICKNESS_MM)
        local = (points - face.astype(np.float32)) @ R.astype(np.float32)
        kept = np.abs(local[:, 2]) < 2.2 * _THICKNESS_MM
        local, strength = local[kept], strength[kept] * np.exp(-((local[kept, 2] / _THICKNESS_MM) ** 2) / 2)
        echo = self._echo(local, strength)
        noise = 10 ** (_NOISE_DB / 20) * 4.0
        echo = [part + noise * self._random.standard_normal(self._shape, dtype=np.float32) for part in echo]
        loud = 20 * np.log10(np.hypot(*echo) / 4.0 + 1e-6) + self._gain_db
        grey = np.clip(255 * (1 + (loud - 4) / _DYNAMIC_DB), 0, 255).astype(np.float32)
        if self._before is not None:
            grey = self._averaged * self._before + (1 - self._averaged) * grey
        self._before = grey
        return np.round(grey).astype(np.uint8)

    def _echo(self, local: Reals, strength: Reals) -> list[NDArray[np.float32]]:
        line, depth = self._array.line_depth(local[:, :2])
        sample = depth / _SAMPLE_MM
        kept = (line >= 0) & (line < _LINES - 1) & (sample >= 0) & (sample < self._shape[1] - 1)
        line, sample, depth, strength = line[kept], sample[kept], depth[kept], strength[kept]
        first, share, row = line.astype(int), line % 1, np.round(sample).astype(int)
        phase = 4 * np.pi / _WAVE_MM * depth
        parts = []
        for wave in (np.cos(phase), np.sin(phase)):
            flat = np.zeros(self._shape[0] * self._shape[1])
            for beside, weight in ((0, 1 - share), (1, share)):
                index = (first + beside) * self._shape[1] + row
                flat += np.bincount(index, weight * wave * strength, flat.size)
            field_ = flat.reshape(self._shape).astype(np.float32)
            parts.append(cv2.GaussianBlur(field_, (0, 0), sigmaX=_PULSE_MM / _SAMPLE_MM, sigmaY=_BEAM_LINES))
        return parts


@dataclass(frozen=True)
class Change:
    """Of what the screen shows: place on it → new place, about a point given as shares of width and height.

    gain: grey levels are multiplied by it. shift: shares of width and height.
    """

    zoom: tuple[float, float] = (1.0, 1.0)
    about: tuple[float, float] = (0.5, 0.0)
    flip: tuple[int, int] = (1, 1)
    shift: tuple[float, float] = (0.0, 0.0)
    gain: float = 1.0

    def matrix(self) -> Reals:
        """(3, 3) px of the screen as it was calibrated → px as it is."""
        size = np.array(SIZE_PX) - 1.0
        about = np.array(self.about) * size
        middle = size / 2
        matrix = np.eye(3)
        matrix[:2, :2] = np.diag(self.zoom)
        matrix[:2, 2] = about - about * self.zoom + np.array(self.shift) * size
        flipped = np.eye(3)
        flipped[:2, :2] = np.diag(self.flip)
        flipped[:2, 2] = middle - middle * self.flip
        return flipped @ matrix

    def share(self, share: float) -> "Change":
        """On its way there, without the flip."""
        zoom = tuple(float(one**share) for one in self.zoom)
        shift = tuple(share * one for one in self.shift)
        return Change((zoom[0], zoom[1]), self.about, (1, 1), (shift[0], shift[1]), self.gain**share)


PLAIN = Change()


class Screen:
    """Draws lines as the array lies; text and a grey bar stand beside the tissue, where they never move."""

    def __init__(self, array: Array1D) -> None:
        self._array = array
        self._maps: dict[Change, tuple[NDArray[np.float32], NDArray[np.float32]]] = {}
        self._overlay = np.zeros(SIZE_PX[::-1], np.uint8)
        self._overlay[20:140, -6:-2] = np.linspace(255, 20, 120).astype(np.uint8)[:, None]
        cv2.putText(self._overlay, "MI 0.9", (3, 232), cv2.FONT_HERSHEY_PLAIN, 0.8, 200)

    def picture(self, lines: GreyImage, change: Change = PLAIN) -> GreyImage:
        """(240, 320) uint8."""
        line, sample = self._place(change)
        drawn = cv2.remap(lines, sample, line, cv2.INTER_LINEAR, borderValue=0)
        if change.gain != 1.0:
            drawn = np.clip(drawn * change.gain, 0, 255).astype(np.uint8)
        return np.maximum(drawn, self._overlay)

    def _place(self, change: Change) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        if change not in self._maps:
            if len(self._maps) > 40:
                self._maps.clear()
            column, row = np.meshgrid(np.arange(SIZE_PX[0]), np.arange(SIZE_PX[1]))
            places = np.stack([column.ravel(), row.ravel(), np.ones(column.size)])
            plain = (np.linalg.inv(change.matrix()) @ places)[:2].T
            middle = (np.array(SIZE_PX) - 1) / 2
            line, depth = self._array.line_depth((plain - middle) * MM_PER_PX + [0.0, DEPTH_MM / 2])
            sample = np.where(depth < 0, -10.0, depth / _SAMPLE_MM)
            shape = SIZE_PX[::-1]
            self._maps[change] = line.reshape(shape).astype(np.float32), sample.reshape(shape).astype(np.float32)
        return self._maps[change]


def rotation(vector_rad: Reals) -> Reals:
    """(3, 3)."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector_rad, dtype=float))[0])


def probe_calibration(seed: int) -> Calibration:
    """Of a marker body that stands somewhere on the probe's handle."""
    random = np.random.default_rng(seed + 77)
    R = rotation(random.uniform(-1.2, 1.2, 3))
    offset_mm = np.array([random.uniform(-20, 20), random.uniform(-130, -90), random.uniform(-25, 25)])
    return Calibration(R, (1, 1), MM_PER_PX.copy(), offset_mm, SIZE_PX)


@dataclass(frozen=True)
class Hand:
    """Gesture until gesture_s, then as then says: hold, gesture, or sweep out of the plane at so many mm/s."""

    seed: int
    then: str = "hold"
    gesture_s: float = 6.5
    sweep_mm_s: float = 6.0
    stroke_mm: float = 32.0
    _waves: tuple[tuple[int, float, float], ...] = (
        (0, 5.5, 1.9), (1, 3.0, 0.68), (5, 7.5, 1.5), (4, 8.0, 2.3), (3, 8.0, 2.8)
    )  # fmt: skip

    def rows(self, t_s: Reals) -> Reals:
        """(6, n) mm across, down, out of the plane, and deg about these, of the middle of the face."""
        random = np.random.default_rng(self.seed + 500)
        rows = self._tremor(t_s, random)
        stays = np.ones_like(t_s) if self.then == "gesture" else _smooth((self.gesture_s + 0.8 - t_s) / 0.8)
        begins = _smooth(t_s / 0.5)
        for row, amplitude, period_s in self._waves:
            phase, pace = random.uniform(0, 2 * np.pi), random.uniform(0.93, 1.07)
            rows[row] += begins * stays * amplitude * np.sin(2 * np.pi * t_s / period_s * pace + phase)
        if self.then == "sweep":
            way = self.sweep_mm_s * np.maximum(t_s - self.gesture_s - 0.4, 0)
            quarter = self.stroke_mm / 2
            rows[2] += _smooth((t_s - self.gesture_s) / 0.8) * (
                quarter - np.abs((way + quarter) % (4 * quarter) - 2 * quarter)
            )
        return rows

    @staticmethod
    def _tremor(t_s: Reals, random: np.random.Generator) -> Reals:
        """Noise without a line, through a filter: .25 mm and .2°."""
        grid = np.arange(-2.0, float(t_s[-1]) + 2.0, 0.01)
        raw = random.normal(size=(6, grid.size))
        slow = cv2.GaussianBlur(raw, (0, 0), sigmaX=25, sigmaY=1e-6, borderType=cv2.BORDER_REFLECT)
        fast = cv2.GaussianBlur(raw, (0, 0), sigmaX=5, sigmaY=1e-6, borderType=cv2.BORDER_REFLECT)
        mixed = slow / slow.std() + 0.25 * fast / fast.std()
        sizes = (0.25, 0.2, 0.15, 0.2, 0.2, 0.2)
        return np.stack([size * np.interp(t_s, grid, row) for size, row in zip(sizes, mixed, strict=True)])


def _smooth(share: Reals) -> Reals:
    share = np.clip(share, 0, 1)
    return np.asarray(share * share * (3 - 2 * share))


@dataclass(frozen=True)
class Breath:
    """mm along each axis of the tissue, and s."""

    mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    period_s: float = 4.2

    def moved_mm(self, t_s: float) -> Reals:
        """(3,), with a pause when breathed out."""
        return np.asarray(np.array(self.mm) * abs(np.sin(np.pi * t_s / self.period_s)) ** 3)


@dataclass
class Session:
    """What an untouched scanner and tracker deliver. lines: of each picture. poses: (4, 4) sensor → tracker."""

    array: Array1D
    calibration: Calibration
    t_s: Reals
    lines: list[GreyImage] = field(default_factory=list)
    poses: list[Reals] = field(default_factory=list)


def scanned(
    seed: int,
    hand: Hand,
    seconds: float,
    array: Array1D = CONVEX,
    breath: Breath | None = None,
    averaged: float = 0.0,
    rate_hz: float = 30.0,
    extra_rows: Reals | None = None,
) -> Session:
    """A session. extra_rows: (6, n) added to the hand's."""
    breath = breath or Breath()
    random = np.random.default_rng(seed + 9000)
    t_s = np.arange(round(seconds * rate_hz)) / rate_hz
    calibration = probe_calibration(seed)
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = calibration.rotation, calibration.offset_mm
    tracker = np.eye(4)
    tracker[:3, :3], tracker[:3, 3] = rotation(random.uniform(-1, 1, 3)), random.uniform(-200, 200, 3) - [0, 0, 900]
    rows = hand.rows(t_s) + (0 if extra_rows is None else extra_rows)
    scanner = Scanner(array, Tissue(seed), seed, averaged)
    session = Session(array, calibration, t_s)
    for index, t in enumerate(t_s):
        pose = np.eye(4)
        pose[:3, :3] = rotation(np.deg2rad(rows[3:, index]))
        pose[:3, 3] = rows[:3, index] + pose[:3, 1] * DEPTH_MM / 2
        session.lines.append(scanner.lines(pose, breath.moved_mm(float(t))))
        noise = np.eye(4)
        noise[:3, :3], noise[:3, 3] = rotation(random.normal(0, np.deg2rad(0.02), 3)), random.normal(0, 0.06, 3)
        session.poses.append(tracker @ pose @ X @ noise)
    return session


@dataclass(frozen=True)
class Break:
    """The picture becomes another at at_s. by: how, over over_s: cut, black, torn, torn-across, frozen, animated,
    faded, snow, covered. to: what it is then.
    """

    at_s: float
    to: Change
    by: str = "cut"
    over_s: float = 0.0


def pictures(session: Session, broken: Break | Sequence[Break] = ()) -> list[GreyImage]:
    """What the grabber delivers: of several breaks each goes on from the one before."""
    breaks = [broken] if isinstance(broken, Break) else list(broken)
    screen, random = Screen(session.array), np.random.default_rng(5)
    shown: list[GreyImage] = []
    for t, lines in zip(session.t_s, session.lines, strict=True):
        past = [one for one in breaks if t >= one.at_s]
        before = past[-2].to if len(past) > 1 else PLAIN
        if not past:
            shown.append(screen.picture(lines))
        elif t < past[-1].at_s + past[-1].over_s:
            share = (t - past[-1].at_s) / past[-1].over_s
            shown.append(_between(screen, lines, before, past[-1], share, shown, random))
        else:
            shown.append(screen.picture(lines, past[-1].to))
    return shown


def _between(
    screen: Screen, lines: GreyImage, before: Change, one: Break, share: float, shown: list[GreyImage],
    random: np.random.Generator,
) -> GreyImage:  # fmt: skip
    old, new = screen.picture(lines, before), screen.picture(lines, one.to)
    half = np.array(SIZE_PX) // 2
    made: dict[str, Callable[[], GreyImage]] = {
        "black": lambda: np.zeros_like(old),
        "torn": lambda: np.vstack([old[: half[1]], new[half[1] :]]),
        "torn-across": lambda: np.hstack([old[:, : half[0]], new[:, half[0] :]]),
        "frozen": lambda: shown[-1],
        "animated": lambda: screen.picture(lines, one.to.share(share)),
        "faded": lambda: np.asarray(cv2.addWeighted(old, 1 - share, new, share, 0)),
        "snow": lambda: random.integers(0, 255, old.shape, dtype=np.uint8),
        "covered": lambda: np.hstack([np.full_like(new[:, : half[0]], 40), new[:, half[0] :]]),
    }
    return made[one.by]()
