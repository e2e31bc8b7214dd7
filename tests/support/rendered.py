"""Pictures of the simulated world at poses of our choosing, with the motion between them known from A = X B X⁻¹."""

from dataclasses import replace
from functools import cache

import numpy as np

from probewatch.appliance.core.registration.keyframe import warp_matrix
from probewatch.appliance.core.registration.overlay import OverlayMask
from probewatch.appliance.core.registration.pyramid import Pyramid, pyramid
from probewatch.drivers.rigid import Array, inverse, rigid, rotation_from_vector
from probewatch.drivers.samples import GreyImage, Matrix4
from probewatch.drivers.twins.scene.world import World, WorldSettings

FULL = WorldSettings()
SMALL = WorldSettings(width_px=320, height_px=240, scale_mm_per_px=(0.08, 0.07))

Warp = tuple[Array, float]


@cache
def world(seed: int = 1, settings: WorldSettings = SMALL, overlay: bool = True) -> World:
    """One world for all tests of a process: growing the tissue takes longer than a picture."""
    return World(seed, settings=replace(settings, overlay=overlay))


def moved(
    pose: Matrix4,
    settings: WorldSettings,
    px: tuple[float, float] = (0, 0),
    turn_deg: float = 0.0,
    elevation_mm: float = 0.0,
) -> Matrix4:
    """Picture → tissue, after the probe has moved by px (lateral, axial) and turned in the picture plane."""
    place_mm = np.array([px[0] * settings.scale_mm_per_px[0], px[1] * settings.scale_mm_per_px[1], elevation_mm])
    return pose @ rigid(rotation_from_vector(np.array([0, 0, np.deg2rad(turn_deg)])), place_mm)


def true_motion(first: Matrix4, second: Matrix4, settings: WorldSettings) -> Warp:
    """(u px, α rad) of the tissue in the picture, from A = P_2⁻¹ P_1 of in-plane picture poses P → tissue."""
    A = inverse(second) @ first
    return A[:2, 3] / np.array(settings.scale_mm_per_px), float(np.arctan2(A[1, 0], A[0, 0]))


def rms_px(found: Warp, truth: Warp, settings: WorldSettings, found_aspect: float | None = None) -> float:
    """How far apart two warps put the points of the middle of the picture (80 %), root mean square."""
    reach = 0.4 * np.array([settings.width_px, settings.height_px])
    x, y = np.meshgrid(np.linspace(-reach[0], reach[0], 21), np.linspace(-reach[1], reach[1], 21))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    turn = warp_matrix(found[1], found_aspect or aspect(settings)) - warp_matrix(truth[1], aspect(settings))
    return float(np.sqrt(np.square(points @ turn.T + found[0] - truth[0]).sum(axis=1).mean()))


def aspect(settings: WorldSettings) -> float:
    """λ_axial ÷ λ_lateral."""
    return settings.scale_mm_per_px[1] / settings.scale_mm_per_px[0]


def sweep(seen: World, frames: int, fps: float = 30.0) -> list[GreyImage]:
    """The first pictures of the world's own trajectory."""
    return [seen.frame(k / fps, k) for k in range(frames)]


@cache
def learnt_mask(seen: World, frames: int = 14) -> OverlayMask:
    """Overlay mask after `frames` pictures of the sweep, of which the first four only fill its memory."""
    overlay = OverlayMask()
    for image in sweep(seen, frames):
        overlay.step(pyramid(image))
    return overlay


def levels(seen: World, pose: Matrix4, index: int) -> Pyramid:
    """Pyramid of the picture at a pose, with the electronic noise of `index`."""
    return pyramid(seen.frame_at(pose, index))
