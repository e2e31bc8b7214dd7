"""Convex pictures as other scanners draw them, on grains of noise: no code of the simulated scanner."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import GreyImage

HEIGHT, WIDTH = 480, 640


@dataclass(frozen=True)
class FanStyle:
    """apex_px: column and row. face_px, bottom_px: radii in rows. left_deg, right_deg: of the sides, in an unstretched
    picture. aspect: rows ÷ columns of the same length. grey: of usual tissue. fades: share of it that is left at the
    bottom. floor_grey: of what shows no echo inside. outline_grey: of a line along the border, 0 for none. hidden:
    angles, deg, and depth, share of it, from which on a shadow lies between them.
    """

    apex_px: tuple[float, float] = (322.0, -150.0)
    face_px: float = 175.0
    bottom_px: float = 600.0
    left_deg: float = 30.0
    right_deg: float = 30.0
    aspect: float = 1.0
    grey: float = 70.0
    fades: float = 0.6
    floor_grey: float = 5.0
    outline_grey: int = 0
    words: bool = True
    hidden: tuple[tuple[float, float, float], ...] = ()

    @property
    def numbers(self) -> Array:
        """(7,) as `fan_borders` has them."""
        slopes = np.tan(np.radians([self.left_deg, self.right_deg])) / self.aspect
        return np.array([*self.apex_px, *slopes, self.aspect, self.face_px, self.bottom_px])

    def changed(self, stretch: tuple[float, float], shift_px: tuple[float, float] = (0.0, 0.0)) -> "FanStyle":
        """Stretched, lateral and axial, about the picture's middle, then shifted."""
        x, y = (
            (n - 1) / 2 + s * (a - (n - 1) / 2) + d
            for n, s, a, d in zip((WIDTH, HEIGHT), stretch, self.apex_px, shift_px, strict=True)
        )
        axial, aspect = stretch[1], self.aspect * stretch[1] / stretch[0]
        return replace(
            self, apex_px=(x, y), face_px=self.face_px * axial, bottom_px=self.bottom_px * axial, aspect=aspect
        )

    def deeper(self, zoom: float) -> "FanStyle":
        """At another depth: the face stays where its middle was, the lower arc where it was."""
        face_row, bottom_row = self.apex_px[1] + self.face_px, self.apex_px[1] + self.bottom_px
        apex_y = face_row - zoom * self.face_px
        return replace(
            self, apex_px=(self.apex_px[0], apex_y), face_px=zoom * self.face_px, bottom_px=bottom_row - apex_y
        )


STYLES = (
    FanStyle(),
    FanStyle((300.0, -330.0), 350.0, 790.0, 20.0, 20.0, aspect=1.143, outline_grey=180),
    FanStyle((330.0, -62.0), 80.0, 500.0, 33.0, 33.0, grey=40.0, floor_grey=8.0),
    FanStyle((318.0, -480.0), 500.0, 930.0, 17.0, 18.0, aspect=0.95, fades=0.9),
)


def fan_picture(style: FanStyle, seed: int, index: int, gain: float = 1.0) -> GreyImage:
    """(HEIGHT, WIDTH) uint8: grains that are new in each picture inside the fan, words beside."""
    columns, rows = np.meshgrid(np.arange(WIDTH) - style.apex_px[0], np.arange(HEIGHT) - style.apex_px[1])
    across = columns * style.aspect
    radius, angle_deg = np.hypot(across, rows), np.degrees(np.arctan2(across, rows))
    inside = (radius >= style.face_px) & (radius <= style.bottom_px)
    inside &= (angle_deg >= -style.left_deg) & (angle_deg <= style.right_deg)
    random = np.random.default_rng((seed, index))
    grains = cv2.resize(random.rayleigh(0.8, (HEIGHT // 3, WIDTH // 4)).astype(np.float32), (WIDTH, HEIGHT))
    depth = np.clip((radius - style.face_px) / (style.bottom_px - style.face_px), 0, 1)
    echo = grains * style.grey * gain * (1 - (1 - style.fades) * depth)
    for left_deg, right_deg, from_depth in style.hidden:
        echo[(angle_deg > left_deg) & (angle_deg < right_deg) & (depth > from_depth)] = 0
    image = np.where(inside, np.maximum(echo, style.floor_grey), 0).clip(0, 255).astype(np.uint8)
    if style.outline_grey:
        outline, _ = cv2.findContours(inside.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(image, outline, -1, style.outline_grey, 1)
    if style.words:
        for word, place in (
            ("C5-1", (6, 14)),
            ("Gn 50", (6, 40)),
            ("MI 0.8", (570, 20)),
            ("12:30:0" + str(index % 10), (540, 40)),
        ):
            cv2.putText(image, word, place, cv2.FONT_HERSHEY_PLAIN, 0.9, 210, 1)
    return image


def a_fan(random: np.random.Generator) -> FanStyle:
    """Any that fills most of the picture and shows both sides and both arcs."""
    half_deg = float(random.uniform(16, 36))
    depth_px, aspect = float(random.uniform(390, 450)), float(random.uniform(0.9, 1.15))
    widest_px = 0.97 * WIDTH / 2 * aspect / np.sin(np.radians(half_deg))
    face_px = min(float(random.uniform(0.15, 1.0)) * depth_px, 0.7 * widest_px)
    bottom_px = min(face_px + depth_px, float(widest_px))
    bulge_px = face_px * (1 - np.cos(np.radians(half_deg)))
    top_row = float(random.uniform(0.5, 1.2)) * bulge_px + float(random.uniform(3, 20))
    bottom_px = min(bottom_px, face_px + HEIGHT - 8 - top_row)
    return FanStyle(
        (WIDTH / 2 + float(random.uniform(-6, 6)), top_row - face_px),
        face_px,
        bottom_px,
        half_deg,
        half_deg,
        aspect,
        grey=float(random.uniform(35, 100)),
        fades=float(random.uniform(0.3, 1.0)),
        floor_grey=float(random.uniform(0, 10)),
        outline_grey=int(random.choice([0, 0, 90, 200])),
        words=bool(random.integers(2)),
    )
