"""Computes the residual of the two paths: measured minus predicted, in the axes of each chain's first picture.

Tissue follows the face that presses it, along the normal of the skin, by a share that the motion shows as it shows the
calibration (docs/method.md, section 7). The axial scale comes from the turn: the picture's turn is seen as a shear,
which no press changes, and which measures the ratio of the scales.

The path is linear in columns that the samples alone give, with coefficients that the parameters alone set. So work that
grows with the number of pictures is done once for all iterations, and blocks of pictures are averaged before."""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from probewatch.appliance.core.path.blocks import LATERAL, TURN
from probewatch.appliance.core.path.samples import PathSamples
from probewatch.appliance.core.path.steps import picture_steps, products_and_slopes
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array, ComplexArray, rotation_from_vector

ROTATION, SCALE, OFFSET, TAU, FOLLOW, TILT = slice(0, 3), slice(3, 5), slice(5, 8), 8, 9, slice(10, 12)
"""Parts of θ (12,): change of the reference in the order of PARAMETERS; latency, s; and, as a change of the tissue that
is assumed, the share by which it follows the face and the tilt, rad, of the skin's normal against the axis of the
window's first picture, in its plane and out of it."""
NOTHING = np.zeros(12)
"""θ of the reference over the tissue that is assumed."""
VALUE = 12
"""Index in `PathResidual.linear` of the residual itself, after its derivatives by θ."""
_OF_X = np.array([0, 1, 2, 5, 6, 7, VALUE])
"""Indices of rotation, offset and value, to which the results of `products_and_slopes` belong."""
_OF_PLACE = np.array([0, 1, 2, 5, 6, 7, TAU])
"""Indices in θ of rotation, offset and latency, which move the whole probe."""
_OF_REST = np.zeros((VALUE + 1, 4))
"""Coefficients of the two measured axes, of the rate and of the measured turn, without those of the residual itself."""
_OF_REST[[3, 4, TAU], [0, 1, 2]] = 1.0, 1.0, -1.0
_MOST_FOLLOWED = 0.97
"""Largest share by which tissue is assumed to follow: 1 would leave nothing of a press by which a mirrored axis
shows."""
_FOLLOW_SD, _TILT_SD_RAD = 0.5, 0.12
"""Standard deviations of the share and of the tilt, rad, before any motion is seen: any share there is, and a hand's
rock of 7°. Less holds tissue to the first estimate, more of a tilt asks for more motion to show the rotation about
elevational. Without tilts, a first picture rocked by 3° made rotation-elevational wrong by 5° and offset-lateral by 14
mm over a layer of 80 mm. Not varied."""
_DOUBTED = 0.5
"""Share of that standard deviation, relative to what is left to show of a press, that is used where polarities are
weighed. More hides a mirrored axis; less holds tissue to a first estimate that breathing may have biased. Not varied.
"""
_MOST_TISSUE = np.array([1.2, 0.4, 0.4])
"""Largest share and tilts, rad, that are fitted: all of it, and as far as a probe is rocked, with room for noise."""
_FOLLOW_BLOCKS = 3
"""Number of blocks over whose steps the share that is first assumed is estimated: a third of a second or more, in which
a hand moves and a breath hardly does."""
LEAST_TRAVEL_MM = 1.0
"""Distance, mm, that the probe must cover along an axis before anything is concluded about its scale: skin drags along
with the probe, which no simulation here shows. A hand that holds still covers .8 mm axially, a fan 1.2 mm (seed 1 of
`probewatch study`)."""
LEAST_TURN_RAD = np.deg2rad(3.0)
"""Turn of the probe in the picture's plane, rad, below which nothing is concluded over tissue that may give way:
registration with free terms for the tissue errs by half a degree a step, which passes for shear. Tremor turns by 1.2°,
the gesture by 16°. More asks for a wider rock; less takes noise for a wrong scale or rotation (−24 % in a sweep over a
half space, seed 1)."""
LEAST_DEPTH_MM = 18.0
"""Depth of a picture, mm, below which nothing is concluded over tissue that may give way: the drag of the skin, which
falls to 1/e over 12 mm, is too much like a turn there. In pictures of 13 mm two of six healthy carts were accused of a
rotation of −9° within 60 s (the invariant's cart, its tissue taken for soft); in those of 21 mm none was (study).
Nothing between was tried. More names no fault in shallow pictures of patients."""
LEAST_CLEAR_MM2 = 380.0
"""Area in which tissue is seen, mm², below which nothing is concluded over tissue that may give way: in a small area
the drag of the skin cannot be distinguished from a turn. With 40 % of the face off the skin of rigid tissue (296 mm²)
three healthy carts in eleven were accused of a scale of +15 to +19 %; with 20 % off (390 mm²) none of six was (gesture,
pictures of 32 by 21 mm). More concludes nothing in narrow pictures. Rigid tissue is verified below it."""

_TURN_MM = 15.6
"""Out-of-plane displacement, mm, that changes the speckle as much as a turn by 1 rad in the plane: 4π σ_x σ_z ÷
wavelength of the simulated beam (σ .5 and .76 mm, 5 MHz), as the phase turns with the probe. More lets a rock count for
more."""

_SHEARED = np.array([np.deg2rad(0.1), np.deg2rad(0.1), 0.02])
"""Standard deviation of the shear that is no turn: rad for 1 mm of press, for 1 mm along the skin, and for 1 mm of
press at 1 rad of turn. More asks for more motion, less takes it for rotation: without it, the error of the rotation
about lateral was 3.4 of its sigmas, with it 1.5, with half as much 1.6, with twice as much 1.5 (gesture of 8 s over
four kinds of deep soft tissue, twelve runs). In a half space with a = 30 mm .05°, .08° and .009 were seen at most."""
_ASIDE = 0.05
"""Standard deviation of the displacement sideways in the same tissue: mm for 1 mm of press at 1 rad of turn. With none,
noise learned to be larger left nothing verified after 8 s in 9 of 10 of those runs; with .1 the rotation about
elevational erred by 2.0 of its sigmas instead of 1.6."""
_TINY = 1e-6
"""Used instead of zero: standard deviation of what is known, and least divisor."""

Columns = list[Array | ComplexArray]


class Lack(NamedTuple):
    """Represents a property of the pictures that is too small: its name with the unit, its value, and the least that
    would do."""

    name: str
    value: float
    least: float


class PathResidual:
    """Computes the residual of the kept pictures of the samples, n, in m blocks.

    rigid: whether the tissue does not give way, as the samples show, or because the motion is known to be planar, which
    is a phantom's; then a press shows the axial scale. follow, tilt: those of the tissue, as assumed, in units of θ."""

    def __init__(self, samples: PathSamples, reference: Calibration, planar: bool) -> None:
        self._samples, self._reference, self._planar = samples, reference, planar
        self.rigid = planar or samples.rigid
        self.hides = 0.0 if planar else samples.hides
        self._latest: tuple[bytes, Array] | None = None
        self.blocks = samples.blocks
        lateral, axial = reference.polarity
        alpha = samples.alpha_rad[samples.kept] * (lateral * axial)
        x_mm, y_mm = (samples.u_px[samples.kept] * reference.scale_mm_per_px * reference.polarity).T
        self._unturn = np.exp(-1j * alpha)
        seen = self._unturn * np.stack([x_mm, 1j * y_mm])
        moved, turn = samples.steps.moved, samples.steps.turn
        rate = np.zeros((1, len(self.blocks)))
        self.follow, self.tilt = 0.0, np.zeros(2)
        along = self._path(moved)
        self._positions: Columns = [
            np.concatenate([self._path(self._unturn * moved), self.blocks.means(seen), rate]),
            np.concatenate([along, rate]),
        ]
        """Columns in the picture plane, complex mm, and out of it."""
        turned = self._path(turn)
        self._angles: Columns = [np.concatenate([turned, rate, self.blocks.means(alpha[None])])]
        if planar:
            self._angles += [np.concatenate([turned, rate]) for _ in range(2)]
        lever, _ = products_and_slopes(*self._moved_to(NOTHING))
        self.elevation_mm = np.asarray(self.blocks.means(np.cumsum(lever[-1, 2] @ moved)))
        """Displacement of the picture's middle out of its plane, (m,) mm, by the tracker and the reference."""
        reach_mm = reference.scale_mm_per_px * reference.image_size_px / np.sqrt(12)
        tilts = np.array([reach_mm[1], reach_mm[0], _TURN_MM])[:, None] * np.cumsum(reference.rotation @ turn, axis=1)
        self.away_mm = np.vstack([self.elevation_mm, self.blocks.means(tilts)])
        """Displacements, (4, m) mm: elevation_mm, those by tilt about lateral and about axial as root mean square over
        the picture, and that by turns in the plane, as far as they change the speckle."""
        if not self.rigid:
            followed = self.seen(NOTHING)[1] - self.way_mm[1]
            steps = (self.blocks.steps(path, _FOLLOW_BLOCKS) for path in (self.pressed_mm, followed))
            self.reckon(_slope(*steps), np.zeros(2))

    @classmethod
    def of(cls, samples: PathSamples, reference: Calibration, planar: bool = False) -> "PathResidual":
        """Returns the residual of these samples, linear in the latency about the reference. It is kept with the
        samples, as solution, polarity and sequential test ask for the same."""
        key = cls, id(reference), planar  # The residual holds the reference, so no other object gets its id.
        residual: PathResidual | None = samples.made.get(key)
        if residual is None:
            residual = samples.made[key] = cls(samples, reference, planar)
            residual.linearise_latency(NOTHING)
        return residual

    @property
    def tissue_sd(self) -> Array:
        """Returns the standard deviations of FOLLOW and TILT before any motion is seen, (3,)."""
        if self.rigid:
            return np.full(3, _TINY)
        return np.array([_FOLLOW_SD, _TILT_SD_RAD, _TILT_SD_RAD])

    @property
    def given(self) -> Array:
        """Returns the covariance of the rows, (3, m, m) mm² or rad², from what tissue leaves open where it is not
        solved for. What a press shows keeps its sign, or a mirrored axis would pass for tissue."""
        if self.rigid:
            return self.sheared
        sd = self.tissue_sd * (_DOUBTED * (1 - self.follow), 1.0, 1.0)
        _, slopes = self._following(np.append(self.follow, self.tilt))
        slopes *= sd[:, None, None]
        given = self.sheared.copy()
        given[: len(slopes[0])] += np.einsum("pki,pkj->kij", slopes, slopes)
        return given

    @cached_property
    def sheared(self) -> Array:
        """Returns the covariance of the rows, (3, m, m) mm² or rad², from a turn and a displacement sideways that
        pressed and dragged tissue shows and that are not the probe's."""
        sheared = np.zeros((TURN + 1, len(self.blocks), len(self.blocks)))
        if not self.rigid:
            turn_rad = np.angle(self._axes[:, 0, 0] + 1j * self._axes[:, 1, 0])
            aside = self._path(turn_rad * self._face_steps[1])
            columns = _SHEARED[:, None] * np.stack([self.pressed_mm, self._path(self._face_steps[0]), aside])
            sheared[TURN], sheared[LATERAL] = columns.T @ columns, _ASIDE**2 * np.outer(aside, aside)
        return sheared

    def reckon(self, follow: float, tilt: Array) -> None:
        """Assumes tissue with this share and tilt from here on."""
        self.follow, self.tilt = float(np.clip(follow, 0.0, _MOST_FOLLOWED)), tilt
        self._latest = None

    def possible(self, theta: Array) -> Array:
        """Returns the θ (12,) nearest to `theta` whose tissue is possible."""
        tissue = np.append(self.follow, self.tilt)
        within = theta.copy()
        within[FOLLOW : TILT.stop] = np.clip(tissue + theta[FOLLOW : TILT.stop], -_MOST_TISSUE, _MOST_TISSUE) - tissue
        return within

    @cached_property
    def _face_steps(self) -> Array:
        """Returns the steps of the face, (3, n) mm, along the axes of the window's first picture, by tracker and
        reference."""
        R, poses = self._reference.rotation, self._samples.poses[self._samples.kept]
        places = poses[:, :3, 3] + poses[:, :3, :3] @ (R.T @ (self._reference.face_mm - self._reference.offset_mm))
        return np.diff(R @ poses[0, :3, :3].T @ places.T, axis=1, prepend=0.0)

    @cached_property
    def _axes(self) -> Array:
        """Returns the axes of each picture in those of the window's first, (n, 3, 3), by the tracker and the
        reference."""
        R, poses = self._reference.rotation, self._samples.poses[self._samples.kept]
        return np.asarray(R @ poses[0, :3, :3].T @ poses[:, :3, :3] @ R.T)

    @cached_property
    def pressed_mm(self) -> Array:
        """Returns the displacement of the face, (m,) mm, along the axial direction of the window's first picture."""
        return np.asarray(self._path(self._face_steps[1]))

    @cached_property
    def _face_ways(self) -> Array:
        """Returns the displacement, (2, 3, 3, m) mm, lateral and axial, of tissue that goes along the first axis as far
        as the face goes along the second; both are axes of the window's first picture."""
        axes = self._axes.swapaxes(1, 2)
        turned = (self._unturn[:, None] * (axes[:, 0] + 1j * axes[:, 1])).T
        ways = self._path(turned[:, None] * self._face_steps[None])
        return np.stack([ways.real, ways.imag])

    def _following(self, tissue: Array) -> tuple[Array, Array]:
        """Returns by how much tissue follows the face (20a), (2, m) mm, lateral and axial, in the axes of each chain's
        first picture, and its derivatives, (3, 2, m). tissue: (3,) share and tilts."""
        follow, across, beyond = tissue
        normal = np.array([across, 1.0, beyond]) / np.sqrt(1 + across**2 + beyond**2)
        pressed, along = normal @ self._face_ways.swapaxes(1, 2), normal @ self._face_ways
        ways = np.einsum("k,ckm->cm", normal, pressed)
        tilted = follow * (pressed + along)
        return follow * ways, np.stack([ways, tilted[:, 0], tilted[:, 2]])

    @cached_property
    def way_mm(self) -> Array:
        """Returns the path that the tracker and the reference predict laterally and axially, (2, m) mm, up to an
        offset."""
        return self.blocks.without_offsets(self.seen(NOTHING) - self._rigid(NOTHING)[:2, VALUE])

    @cached_property
    def parts(self) -> Array:
        """Returns `Blocks.parts`, (PARTS, m, m), read-only."""
        parts = self.blocks.parts(self.away_mm)
        parts.flags.writeable = False
        return parts

    def __len__(self) -> int:
        """Returns the number of pictures."""
        return int(self._unturn.size)

    def linearise_latency(self, theta: Array) -> None:
        """Takes the derivative by latency at theta; it changes little with X."""
        self._latest = None
        moved, turned = picture_steps(*self._moved_to(theta), self._samples.rates)
        for row, rate in zip(self._positions, [self._unturn * (moved[0] + 1j * moved[1]), moved[2]], strict=True):
            row[-1] = self._path(rate)
        for row, rate in zip(self._angles, turned[[2, 0, 1]], strict=False):
            row[3] = self._path(rate)

    def linear(self, theta: Array) -> Array:
        """Returns the derivatives by θ of every row, and the rows themselves, (rows, 13, m). Measured counts positive.

        The result is read-only: the latest is kept, as each round of a solution begins where the one before ended."""
        asked = theta.tobytes()
        if self._latest is None or self._latest[0] != asked:
            rows = self._linear(theta)
            rows.flags.writeable = False
            self._latest = asked, rows
        return self._latest[1]

    def _linear(self, theta: Array) -> Array:
        rows = self._rigid(theta)
        if not self.rigid:
            self._give_way(rows, theta)
        return rows

    def _give_way(self, rows: Array, theta: Array) -> None:
        """Turns the rows of tissue that does not follow the face into those of tissue that does."""
        way_mm, slopes = self._following(np.append(self.follow, self.tilt) + theta[FOLLOW : TILT.stop])
        follow = self.follow + theta[FOLLOW]
        # What moves the middle of the picture along the axis moves the face as much, and tissue by its share of that.
        moved_mm = rows[1, _OF_PLACE]
        rows[1, VALUE] -= follow * theta[_OF_PLACE] @ moved_mm
        rows[1, _OF_PLACE] = (1 - follow) * moved_mm
        rows[:2, FOLLOW : TILT.stop] = -slopes.swapaxes(0, 1)
        rows[1, FOLLOW] -= theta[_OF_PLACE] @ moved_mm
        rows[:2, VALUE] -= way_mm
        # Where tissue may drag, the measured path is noisy and would bias the scale towards −100 %; so the slope is the
        # predicted path.
        rows[0, SCALE.start] = self.seen(theta)[0] - rows[0, VALUE]

    def _rigid(self, theta: Array) -> Array:
        """Returns the rows of tissue that does not give way."""
        lever, turned = products_and_slopes(*self._moved_to(theta))
        rest = _OF_REST.copy()
        lateral, axial = 1 + theta[SCALE]
        rest[VALUE] = lateral, axial, -theta[TAU], 1.0
        if not self.rigid:
            rest[SCALE, 1], rest[VALUE, 1] = 0.0, 1.0
        in_plane = _coefficients(lever[:, 0] + 1j * lever[:, 1], rest[:, :3]) @ self._positions[0]
        turns = (_coefficients(turned[:, 2], rest[:, 2:]) @ self._angles[0]).real
        if not self.rigid:
            self._shear(turns, theta)
        rows: Columns = [in_plane.real, in_plane.imag, turns]
        if self._planar:
            rows.append(_coefficients(lever[:, 2], rest[:, 2:3]) @ self._positions[1])
            rows += [_coefficients(turned[:, axis], rest[:, 2:3]) @ self._angles[1 + axis] for axis in (0, 1)]
        return np.stack(rows)

    def _shear(self, turns: Array, theta: Array) -> None:
        """Changes the turn's row, as the turn is seen by a shear, λ_axial ÷ λ_lateral times as large. The ratio of
        their changes is modelled as the exponential of the difference, which no common change makes vanish: otherwise
        both came to −98 % where a sweep hardly showed a turn."""
        seen = self._angles[0][-1].real
        lateral, axial = theta[SCALE]
        predicted, ratio = seen - turns[VALUE], np.exp(axial - lateral)
        turns[[*range(ROTATION.stop), TAU]] *= ratio
        turns[SCALE] = ratio * predicted, -ratio * predicted
        turns[VALUE] = seen - ratio * predicted

    def seen(self, theta: Array) -> Array:
        """Returns the measured path, lateral and axial, (2, m) mm."""
        scales = 1 + theta[SCALE] * (1.0, float(self.rigid))
        path = scales @ self._positions[0][12:14]
        return np.stack([path.real, path.imag])

    @cached_property
    def lack(self) -> Lack | None:
        """Returns the property of the pictures that is too small for a conclusion over tissue that may give way; None
        where none is, and over rigid tissue."""
        area_mm2 = float(np.prod(self._reference.scale_mm_per_px * self._reference.image_size_px))
        of_picture = {
            "depth_mm": (2 * abs(float(self._reference.face_mm[1])), LEAST_DEPTH_MM),
            "tissue_mm2": (area_mm2 * self._samples.clear_share, LEAST_CLEAR_MM2),
        }
        lacks = (Lack(what, *measure) for what, measure in of_picture.items() if measure[0] < measure[1])
        return None if self.rigid else next(lacks, None)

    @cached_property
    def is_informative(self) -> bool:
        """Returns whether anything may be concluded: tissue is rigid, or the picture is deep and clear enough and the
        probe has turned enough."""
        if self.rigid:
            return True
        if self.lack is not None:
            return False
        turn_rad = self.blocks.without_offsets((self._angles[0][-1].real - self._rigid(NOTHING)[2, VALUE])[None])
        return bool(np.diff(np.quantile(turn_rad, [0.025, 0.975]))[0] >= LEAST_TURN_RAD)

    def travel_mm(self, n: int) -> Array:
        """Returns the distance that the probe covered over the last n blocks, (2,) mm, without its widest 5 %, along
        the axes that show the lateral and the axial scale: in tissue that gives way the lateral one shows both."""
        way_mm = self.way_mm if self.rigid else self.way_mm[[LATERAL, LATERAL]]
        places = self.blocks.last(n).without_offsets(way_mm[:, -n:])
        return np.asarray(np.diff(np.quantile(places, [0.025, 0.975], axis=1), axis=0)[0])

    def _path(self, steps: Array | ComplexArray) -> Array | ComplexArray:
        """Returns the path, (…, m), of steps (…, n) within each chain, up to an offset of its own."""
        return self.blocks.means(np.cumsum(steps * self._samples.continues, axis=-1))

    def _moved_to(self, theta: Array) -> tuple[Array, Array]:
        turn = rotation_from_vector(theta[ROTATION])
        return turn @ self._reference.rotation, self._reference.offset_mm + theta[OFFSET]


def _coefficients(of_X: Array | ComplexArray, rest: Array) -> Array | ComplexArray:
    """Joins the coefficients of X, which count negative, and the rest: (7, k), (13, l) → (13, k + l)."""
    k = of_X.shape[1]
    coefficients = np.zeros((VALUE + 1, k + rest.shape[1]), of_X.dtype)
    coefficients[_OF_X, :k] = -of_X
    coefficients[:, k:] = rest
    return coefficients


def _slope(along: Array, values: Array) -> float:
    return float(along @ values) / max(float(along @ along), _TINY)
