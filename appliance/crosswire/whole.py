"""Solves for a whole calibration from one point seen from many sides: rotation, offset and both scales, from nothing.
Pure.

A picture point p = S Λ (u − centre) of a view with pose B shows the crossing c where X B⁻¹ c = (p, 0). This gives three
equations per view, linear in c and in the product of X and Λ, and so a start from nothing, whichever way the marker
body is mounted. From there robust nonlinear least squares in the picture's axes finds the eight parameters, the
crossing, and how late the tracker was: the derivative by the latter is the crossing's own motion in the picture.

A single point cannot distinguish a mirrored picture from a marker body turned by 180°: both put every point of the
picture's plane in the same place. The polarity is therefore taken from the caller.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from probewatch.appliance.crosswire.expected_error import expected_error_mm
from probewatch.appliance.crosswire.offset import ScanRefused
from probewatch.appliance.crosswire.scan import View
from probewatch.appliance.types import PARAMETERS, Calibration, Vector
from probewatch.drivers.rigid import nearest_rotation, rotation_from_vector, skew

_Loss = Literal["linear", "soft_l1"]

_EIGHT = len(PARAMETERS)
_CROSSING = slice(_EIGHT, _EIGHT + 3)
_LATENCY = _EIGHT + 3
_UNKNOWN = _EIGHT + 4
"""Places in θ: the parameters, the crossing in the tracker's frame, mm, the latency, s; and their number."""
_NATURAL = np.array([*(np.radians(1.0),) * 3, *(0.01,) * 2, *(1.0,) * 3, *(1.0,) * 3, 0.01])
"""A small change of each: 1°, 1 %, 1 mm, 10 ms. Steps of the solver and the weak prior are counted in it."""
LEAST_VIEWS = 6
"""The least number of views: eighteen equations for twelve unknowns. Fewer leave nothing that could contradict."""
_SUBSET, _DRAWS = 6, 300
"""Views of one trial, and trials: with one bad view in four, 1e-25 of all scans draw no clean one. Each costs 20 µs."""
_UNIT_PX = 100.0
"""Unit, px, in which the linear start counts pixels, so that its unknowns are of similar size."""
_FARTHEST = 1e3
"""Prior standard deviation of every parameter, natural units: so weak that it only keeps the sums invertible."""
UNOBSERVED = 30.0
"""Natural units (30°, 30 %, 30 mm) from which a standard deviation says nothing: the parameter is not observed."""
_CUT_SIGMA = 5.0
"""Robust standard deviations beyond which a view is rejected, as for ζ alone (appliance.crosswire.offset)."""
_MEDIAN_OF_CHI3 = 1.5382
"""Median length of a vector of three unit normal components."""
_LARGEST_OUTLIER_SHARE = 0.25
"""Share of rejected views beyond which this is not a scan with bad views but a bad scan. One in five is found
(tests/appliance/crosswire/test_whole.py), every second not always."""
_LEAST_SD_MM = 0.01
"""mm per axis: below the rounding of sub-pixel centres, so that noise-free views do not get infinite weight."""
_ROUNDS = 6
"""Rounds of rejecting and weighing again, each a few ms: the sets settle within three. Not varied."""


@dataclass(frozen=True, slots=True, eq=False)
class WholeSolution:
    """Holds the eight parameters in calibration, with covariance (8, 8) and what was observed.

    crossing_mm: (3,) tracker axes. covariance: (12, 12) of the eight, the crossing and the latency. latency_s: beyond
    what the poses were taken with, positive where the tracker is later still; latency_sigma_s: as large as the prior
    where the scan does not show it. noise_mm: (3,) scatter of one view along the picture's axes: lateral, axial,
    elevational. residual_mm: (N, 3) along them. points_mm: (N, 3) where each view puts the crossing, tracker axes.
    kept: (N,) bool. expected_mm: RMS error that the covariance promises for points all over the picture.
    """

    calibration: Calibration
    crossing_mm: Vector
    covariance: Vector
    latency_s: float
    latency_sigma_s: float
    noise_mm: Vector
    residual_mm: Vector
    points_mm: Vector
    kept: NDArray[np.bool_]
    expected_mm: float

    @property
    def sigma(self) -> Vector:
        """Returns the standard deviations, (8,), in the order and units of PARAMETERS."""
        assert self.calibration.covariance is not None
        return np.asarray(np.sqrt(np.diag(self.calibration.covariance)))

    @property
    def views(self) -> int:
        return int(self.kept.sum())

    @property
    def localisation_mm(self) -> float:
        """Returns the standard deviation of one view per axis."""
        return float(np.sqrt(np.mean(np.square(self.noise_mm))))


@dataclass(frozen=True, slots=True, eq=False)
class _Scene:
    """Holds the views as arrays. place_px: (N, 2) from the centre. spot: (N, 2, 2) covariance, px².

    turn, move: (N, 3, 3), (N, 3) tracker → sensor. turn_rate, move_rate: their change per second of latency.
    """

    place_px: Vector
    spot: Vector
    turn: Vector
    move: Vector
    turn_rate: Vector
    move_rate: Vector

    def only(self, kept: NDArray[np.bool_] | NDArray[np.intp]) -> "_Scene":
        parts = (self.place_px, self.spot, self.turn, self.move, self.turn_rate, self.move_rate)
        return _Scene(*(part[kept] for part in parts))

    def late(self, latency_s: float) -> tuple[Vector, Vector]:
        return self.turn + latency_s * self.turn_rate, self.move + latency_s * self.move_rate


@dataclass(frozen=True, slots=True, eq=False)
class _Noise:
    """Holds a view's noise along the picture's axes. all_mm: (3,) standard deviation beside what its picture states.

    trust: (2,) share of the variance that pictures state which the views' scatter supports, 0 … 1.
    """

    all_mm: Vector
    trust: Vector


@dataclass(frozen=True, slots=True, eq=False)
class _Guess:
    """Holds R_x, t_x, Λ with sign, the crossing and the latency."""

    rotation: Vector
    scale_mm_per_px: Vector
    offset_mm: Vector
    crossing_mm: Vector
    latency_s: float = 0.0

    def stepped(self, step: Vector) -> "_Guess":
        return _Guess(
            rotation_from_vector(step[:3]) @ self.rotation,
            self.scale_mm_per_px * (1 + step[3:5]),
            self.offset_mm + step[5:8],
            self.crossing_mm + step[_CROSSING],
            self.latency_s + float(step[_LATENCY]),
        )


def solve_whole(
    views: Sequence[View],
    image_size_px: tuple[int, int],
    polarity: tuple[int, int] = (1, 1),
    latency_sigma_s: float = 0.0,
) -> WholeSolution:
    """Solves for the eight parameters from the views alone.

    image_size_px: (width, height). latency_sigma_s: how far the tracker may be later or earlier than the views' poses
    were taken; 0 where it is known. Raises ScanRefused where too few views agree with one another.
    """
    if len(views) < LEAST_VIEWS:
        raise ScanRefused(
            f"{len(views)} views of the crossing, {LEAST_VIEWS} are needed for a first solution",
            "cross-wire scan",
            "Pass slowly through the crossing again and again, with another tilt each time",
        )
    scene = _scene(views, image_size_px)
    guess, inliers_mm = _linear_start(scene, np.array(polarity))
    noise = _Noise(np.full(3, max(inliers_mm, _LEAST_SD_MM)), np.ones(2))
    guess = _fitted(scene, guess, noise, latency_sigma_s, "soft_l1")
    kept = np.ones(len(views), np.bool_)
    # Rejects views, fits, and learns the noise by turns, until the set of views and the noise settle.
    for _ in range(_ROUNDS):
        before = kept
        kept = _consistent(scene, guess, noise)
        guess = _fitted(scene.only(kept), guess, noise, latency_sigma_s, "linear")
        last, noise = noise, _estimated(scene.only(kept), guess, noise, latency_sigma_s)
        if np.array_equal(kept, before) and np.allclose(last.all_mm, noise.all_mm, rtol=0.02):
            break
    covariance = np.asarray(np.linalg.inv(_information(scene.only(kept), guess, noise, latency_sigma_s)))
    return _stated(scene, guess, noise, kept, covariance, image_size_px, polarity)


def _scene(views: Sequence[View], image_size_px: tuple[int, int]) -> _Scene:
    centre_px = (np.array(image_size_px) - 1) / 2
    turn = np.array([view.matrix[:3, :3].T for view in views])
    place = np.array([view.matrix[:3, 3] for view in views])
    turn_rate, move_rate = np.zeros_like(turn), np.zeros_like(place)
    for index, view in enumerate(views):
        if view.earlier is not None and view.later is not None and view.apart_s > 0:
            first, last = view.earlier[:3], view.later[:3]
            turn_rate[index] = (last[:, :3] - first[:, :3]).T / view.apart_s
            moves = [-part[:, :3].T @ part[:, 3] for part in (first, last)]
            move_rate[index] = (moves[1] - moves[0]) / view.apart_s
    return _Scene(
        np.array([view.centre_px for view in views]) - centre_px,
        np.array([view.covariance_px for view in views]),
        turn,
        -np.einsum("nij,nj->ni", turn, place),
        turn_rate,
        move_rate,
    )


def _linear_start(scene: _Scene, polarity: Vector) -> tuple[_Guess, float]:
    """Solves for c, the picture's centre and two axes in sensor axes by least squares: twelve unknowns, unconstrained.

    Of many small sets of views, the one with the smallest median misfit decides; those near it then solve together.
    Returns the guess and the standard deviation per axis about it, mm.
    """
    turn = np.swapaxes(scene.turn, 1, 2)
    place = -np.einsum("nij,nj->ni", turn, scene.move)
    middle = np.median(place, axis=0)
    u, v = (scene.place_px / _UNIT_PX).T
    rows = np.concatenate(
        [turn * u[:, None, None], turn * v[:, None, None], turn, np.broadcast_to(-np.eye(3), turn.shape)], axis=2
    )
    right = middle - place
    squares, sides = np.einsum("nki,nkj->nij", rows, rows), np.einsum("nki,nk->ni", rows, right)
    ridge = np.eye(12) * 1e-9
    random = np.random.default_rng(len(u))
    size = min(_SUBSET, len(u))
    draws = np.argsort(random.random((_DRAWS, len(u))), axis=1)[:, :size]
    tried = np.linalg.solve(squares[draws].sum(axis=1) + ridge, sides[draws].sum(axis=1)[..., None])[..., 0]
    off_mm = np.linalg.norm(np.einsum("nki,ti->tnk", rows, tried) - right, axis=2)
    middle_off = np.median(off_mm, axis=1)
    distance = off_mm[np.argmin(middle_off)]
    solved = tried[np.argmin(middle_off)]
    for _ in range(3):
        near = distance <= max(3 * float(np.median(distance)), _LEAST_SD_MM)
        solved = np.linalg.solve(squares[near].sum(axis=0) + ridge, sides[near].sum(axis=0))
        distance = np.linalg.norm(rows @ solved - right, axis=1)
    return _guessed(solved, middle, polarity), float(np.median(distance)) / _MEDIAN_OF_CHI3


def _guessed(solved: Vector, middle: Vector, polarity: Vector) -> _Guess:
    axes = solved[:6].reshape(2, 3) / _UNIT_PX
    scale = np.maximum(np.linalg.norm(axes, axis=1), 1e-9)
    lateral, axial = axes / scale[:, None] * polarity[:, None]
    rotation = nearest_rotation(np.stack([lateral, axial, np.cross(lateral, axial)]))
    return _Guess(rotation, scale * polarity, -rotation @ solved[6:9], solved[9:] + middle)


def _misfit(scene: _Scene, guess: _Guess) -> Vector:
    """Returns where the crossing should be minus where it was seen, (N, 3) mm along the picture's axes."""
    turn, move = scene.late(guess.latency_s)
    seen = (turn @ guess.crossing_mm + move) @ guess.rotation.T + guess.offset_mm
    seen[:, :2] -= scene.place_px * guess.scale_mm_per_px
    return np.asarray(seen)


def _slopes(scene: _Scene, guess: _Guess) -> Vector:
    """Returns the derivatives of `_misfit` by a small step, (N, 3, 12)."""
    turn, move = scene.late(guess.latency_s)
    arm = (turn @ guess.crossing_mm + move) @ guess.rotation.T
    slopes = np.zeros((len(arm), 3, _UNKNOWN))
    slopes[:, :, :3] = -skew(arm)
    place = scene.place_px * guess.scale_mm_per_px
    slopes[:, 0, 3], slopes[:, 1, 4] = -place[:, 0], -place[:, 1]
    slopes[:, :, 5:8] = np.eye(3)
    slopes[:, :, _CROSSING] = guess.rotation @ turn
    rate = (scene.turn_rate @ guess.crossing_mm + scene.move_rate) @ guess.rotation.T
    slopes[:, :, _LATENCY] = rate
    return slopes


def _whitening(scene: _Scene, guess: _Guess, noise: _Noise) -> Vector:
    """Returns inverse roots of the views' covariances, (N, 3, 3), 1/mm: noise of all views, and of each own picture."""
    covariance = np.tile(np.diag(np.square(noise.all_mm)), (len(scene.place_px), 1, 1))
    borne = guess.scale_mm_per_px * np.sqrt(noise.trust)
    covariance[:, :2, :2] += scene.spot * np.outer(borne, borne)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def _prior(latency_sigma_s: float) -> Vector:
    """Returns the inverse standard deviations, (12,). A known latency is held to a microsecond."""
    prior = 1 / (_FARTHEST * _NATURAL)
    prior[_LATENCY] = 1 / max(latency_sigma_s, 1e-6)
    return prior


def _fitted(scene: _Scene, guess: _Guess, noise: _Noise, latency_sigma_s: float, loss: _Loss) -> _Guess:
    """Fits by least squares from the guess. Steps are counted from it, in natural units."""
    white, prior = _whitening(scene, guess, noise), _prior(latency_sigma_s)
    prior_step = np.zeros(_UNKNOWN)
    prior_step[_LATENCY] = guess.latency_s

    def residual(x: Vector) -> Vector:
        step = x * _NATURAL
        data = np.einsum("nij,nj->ni", white, _misfit(scene, guess.stepped(step)))
        return np.concatenate([data.ravel(), prior * (prior_step + step)])

    def slopes(x: Vector) -> Vector:
        step = x * _NATURAL
        here = _slopes(scene, guess.stepped(step))
        # A step of the rotation from the guess is not quite one from where the steps led: the left Jacobian of SO(3).
        here[:, :, :3] = here[:, :, :3] @ _left_jacobian(step[:3])
        here[:, :, 3:5] /= 1 + step[3:5]
        data = (white @ here).reshape(-1, _UNKNOWN)
        return np.asarray(np.concatenate([data, np.diag(prior)]) * _NATURAL)

    found = least_squares(residual, np.zeros(_UNKNOWN), jac=slopes, loss=loss, f_scale=2.0, max_nfev=60)
    return guess.stepped(found.x * _NATURAL)


def _left_jacobian(rotvec: Vector) -> Vector:
    angle = float(np.linalg.norm(rotvec))
    if angle < 1e-6:
        return np.asarray(np.eye(3) + skew(rotvec) / 2)
    K = skew(rotvec / angle)
    return np.asarray(np.eye(3) + (1 - np.cos(angle)) / angle * K + (1 - np.sin(angle) / angle) * (K @ K))


def _information(scene: _Scene, guess: _Guess, noise: _Noise, latency_sigma_s: float) -> Vector:
    slopes = _whitening(scene, guess, noise) @ _slopes(scene, guess)
    return np.asarray(np.einsum("nki,nkj->ij", slopes, slopes) + np.diag(_prior(latency_sigma_s) ** 2))


def _estimated(scene: _Scene, guess: _Guess, noise: _Noise, latency_sigma_s: float) -> _Noise:
    """Returns the views' scatter along each axis, and how much of it their own pictures may explain: half at most.

    Each axis has as many degrees of freedom as views, less what the unknowns took of it.
    """
    white, slopes = _whitening(scene, guess, noise), _slopes(scene, guess)
    covariance = np.linalg.inv(_information(scene, guess, noise, latency_sigma_s))
    reach = white @ slopes
    spent = np.einsum("nki,ij,nkj->k", reach, covariance, reach)
    free = np.maximum(len(slopes) - spent, 1.0)
    variance = np.maximum(np.square(_misfit(scene, guess)).sum(axis=0) / free, _LEAST_SD_MM**2)
    own = np.einsum("nii->i", scene.spot) / len(slopes) * guess.scale_mm_per_px**2
    trust = np.minimum(1.0, variance[:2] / (2 * np.maximum(own, _LEAST_SD_MM**2)))
    variance[:2] -= trust * own
    return _Noise(np.sqrt(variance), trust)


def _consistent(scene: _Scene, guess: _Guess, noise: _Noise) -> NDArray[np.bool_]:
    """Returns (N,) False for views that are too far off. Raises ScanRefused where too many are."""
    white = _whitening(scene, guess, noise)
    distance = np.linalg.norm(np.einsum("nij,nj->ni", white, _misfit(scene, guess)), axis=1)
    scale = float(np.median(distance)) / _MEDIAN_OF_CHI3
    kept = distance <= _CUT_SIGMA * max(scale, 1e-9)
    if np.mean(~kept) > _LARGEST_OUTLIER_SHARE or kept.sum() < LEAST_VIEWS:
        raise ScanRefused(
            f"{np.sum(~kept)} of {len(kept)} views contradict the others",
            "cross-wire scan",
            "See that nothing but the wires echoes and that the tank stands still, then scan again",
        )
    return np.asarray(kept)


def _stated(
    scene: _Scene,
    guess: _Guess,
    noise: _Noise,
    kept: NDArray[np.bool_],
    covariance: Vector,
    image_size_px: tuple[int, int],
    polarity: tuple[int, int],
) -> WholeSolution:
    eight = covariance[:_EIGHT, :_EIGHT]
    observed = tuple(bool(seen) for seen in np.sqrt(np.diag(eight)) < UNOBSERVED * _NATURAL[:_EIGHT])
    calibration = Calibration(
        guess.rotation,
        polarity,
        np.abs(guess.scale_mm_per_px),
        guess.offset_mm,
        image_size_px,
        covariance=eight,
        observed=observed,
    )
    own = np.einsum("nii->i", scene.spot[kept]) / kept.sum() * guess.scale_mm_per_px**2
    scatter_mm = np.sqrt(np.square(noise.all_mm) + np.array([*(noise.trust * own), 0.0]))
    turn, move = scene.late(guess.latency_s)
    in_picture = np.column_stack([scene.place_px * guess.scale_mm_per_px, np.zeros(len(turn))])
    in_sensor = (in_picture - guess.offset_mm) @ guess.rotation
    return WholeSolution(
        calibration=calibration,
        crossing_mm=guess.crossing_mm,
        covariance=covariance,
        latency_s=guess.latency_s,
        latency_sigma_s=float(np.sqrt(covariance[_LATENCY, _LATENCY])),
        noise_mm=scatter_mm,
        residual_mm=_misfit(scene, guess),
        points_mm=np.einsum("nji,nj->ni", turn, in_sensor - move),
        kept=kept,
        expected_mm=expected_error_mm(calibration),
    )
