"""Computes the one world that all twins share: a probe on tissue before a tracker. It is pure and seeded."""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.samples import GreyImage, Matrix4
from probewatch.drivers.twins.faults import ZOOM, spoil_image, zoom
from probewatch.drivers.twins.scene.fan import FanRenderer
from probewatch.drivers.twins.scene.geometry import Geometry
from probewatch.drivers.twins.scene.sight import Sight
from probewatch.drivers.twins.scene.surroundings import Surroundings
from probewatch.drivers.twins.scene.tissue import PERIOD_MM, Beam, Floats, Renderer, Tissue, grown
from probewatch.drivers.twins.scene.trajectory import Trajectory
from probewatch.drivers.twins.scene.wires import Clutter, wire_intensity

SCENES = ("tissue", "speckle", "cross-wire")

_SENSOR_ROTATION_VECTOR = (0.62, -0.41, 0.93)
_SENSOR_OFFSET_MM = (11.0, 62.0, 14.0)
"""Sensor → picture, the truth that a calibration is to find: oblique to all axes, so that no exchanged axis or sign can
give the same numbers; 64 mm, as between a clamped marker body and the middle of the picture."""

_TRACKER_ROTATION_VECTOR = (1.9, 0.7, -0.5)
_TRACKER_ORIGIN_MM = (64.0, -87.0, -1520.0)
"""Tissue → tracker: oblique likewise, and 1.5 m in front of it (negative z), where a Polaris measures."""

_HALF_ANGLE_DEG, _FAN_HALF_ANGLE_DEG = 17.0, 20.0
"""Half angle of the sector that is drawn, in pixel coordinates, and of a convex probe, in millimetres. Wider ones are
cut off by the sides of the picture, narrower ones show less tissue."""
_APEX = -1.2
"""Height of the sector's apex above the picture, in heights of the picture: a fan of 25 mm radius in 21 mm of depth."""


@dataclass(frozen=True, slots=True)
class WorldSettings:
    """Holds geometry and noise of the simulated cart.

    scale_mm_per_px: (lateral, axial), 0.04 … 0.1. tracker_sd_mm, tracker_sd_deg: per axis, white. noise_db: electronic
    noise relative to the echo of plain tissue near the probe. range_db: dynamic range that 255 grey levels span.
    attenuation_db: what the depth gain leaves uncorrected at the bottom. depth_zoom: factor by which the fault `depth`
    magnifies.
    """

    width_px: int = 640
    height_px: int = 480
    scale_mm_per_px: tuple[float, float] = (0.080, 0.070)
    fps: float = 30.0
    tracker_sd_mm: float = 0.1
    tracker_sd_deg: float = 0.02
    noise_db: float = -30.0
    range_db: float = 60.0
    gain_db: float = 0.0
    attenuation_db: float = 6.0
    overlay: bool = True
    depth_zoom: float = ZOOM

    def __post_init__(self) -> None:
        size_mm = self.width_px * self.scale_mm_per_px[0], self.height_px * self.scale_mm_per_px[1]
        if size_mm[0] > 0.9 * PERIOD_MM[0] or size_mm[1] > 0.9 * PERIOD_MM[1]:
            raise ConfigurationError(
                f"a picture of {size_mm[0]:.0f} x {size_mm[1]:.0f} mm would show the tissue twice",
                "simulated world",
                "Use fewer pixels or a smaller scale",
            )


def _rigid(rotation_vector: tuple[float, float, float], offset_mm: tuple[float, float, float]) -> Matrix4:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(rotation_vector).as_matrix()
    matrix[:3, 3] = offset_mm
    return matrix


class World:
    """Holds the truth and computes what the devices see of it.

    program: one of trajectory.PROGRAMS. scene: one of SCENES; "speckle" is tissue without any structure. clutter: what
    the tank of a cross-wire holds besides, if not clean water. surroundings: kind of tissue and probe. Tissue is grown
    at the first picture, so a world that is only asked for poses costs nothing. Time is an argument of the methods.
    Raises ConfigurationError for unknown names.
    """

    def __init__(
        self,
        seed: int = 1,
        program: str = "sweep",
        scene: str = "tissue",
        settings: WorldSettings | None = None,
        clutter: Clutter | None = None,
        surroundings: Surroundings | None = None,
    ) -> None:
        if scene not in SCENES:
            raise ConfigurationError(f"'{scene}' is not a known scene", "simulated world", f"Use {', '.join(SCENES)}")
        self.seed, self.scene, self.settings = seed, scene, settings or WorldSettings()
        self.clutter, self.surroundings = clutter or Clutter(), surroundings or Surroundings()
        self.trajectory = Trajectory(seed, program)
        self.sensor_to_picture = _rigid(_SENSOR_ROTATION_VECTOR, _SENSOR_OFFSET_MM)
        self.tissue_to_tracker = _rigid(_TRACKER_ROTATION_VECTOR, _TRACKER_ORIGIN_MM)

    @property
    def image_to_probe(self) -> Matrix4:
        """Returns (4, 4) pixel (column, row, 0, 1), origin at the corner, → sensor, mm; the ImageToProbe of PLUS."""
        settings = self.settings
        to_centre = np.eye(4)
        to_centre[:2, 3] = -(settings.width_px - 1) / 2, -(settings.height_px - 1) / 2
        to_picture = np.diag([*settings.scale_mm_per_px, 1.0, 1.0]) @ to_centre
        image_to_probe: Matrix4 = np.linalg.inv(self.sensor_to_picture) @ to_picture
        return image_to_probe

    @property
    def crossing_mm(self) -> NDArray[np.float64]:
        """Returns where the two wires cross, (3,), tracker frame."""
        return self.tissue_to_tracker[:3, 3].copy()

    def probe_pose(self, t_s: float) -> Matrix4:
        """Returns the true pose, (4, 4) sensor → tracker, mm."""
        pose: Matrix4 = self.tissue_to_tracker @ self.trajectory.pose(t_s) @ self.sensor_to_picture
        return pose

    def measured_pose(self, t_s: float, index: int) -> Matrix4:
        """Returns the pose, (4, 4) sensor → tracker, as the tracker reports it; index, >= 0, seeds its noise."""
        random = np.random.default_rng((self.seed, 31, index))
        noise = np.eye(4)
        spread_rad = np.radians(self.settings.tracker_sd_deg)
        noise[:3, :3] = Rotation.from_rotvec(random.normal(0, spread_rad, 3)).as_matrix()
        pose: Matrix4 = self.probe_pose(t_s) @ noise
        pose[:3, 3] += random.normal(0, self.settings.tracker_sd_mm, 3)
        return pose

    def frame(self, t_s: float, index: int, active: Collection[str] = ()) -> GreyImage:
        """Returns the picture, (height, width) uint8, seen at t_s. index, >= 0: seeds the electronic noise. active:
        faults in force.
        """
        return self.frame_at(self.trajectory.pose(t_s), index, active)

    def frame_at(
        self, picture_pose: Matrix4, index: int = 0, active: Collection[str] = (), sight: Sight | None = None
    ) -> GreyImage:
        """Returns the picture at a given pose P → C, (4, 4), mm. sight: how it differs from that of rigid tissue."""
        return self.on_screen(self.plain_at(picture_pose, index, sight), active)

    def on_screen(self, grey: GreyImage, active: Collection[str] = ()) -> GreyImage:
        """Returns plain echoes as the scanner's screen shows them, with all that it draws."""
        if not self.settings.overlay:
            return spoil_image(grey, active)
        screen, magnified = self._screen, 1.0
        if "depth" in active:
            magnified = self.settings.depth_zoom
            grey = zoom(grey, magnified, screen.top_row_px)
        grey = spoil_image(grey & screen.sector, {"flip-lateral", "flip-vertical"} & set(active))
        return np.asarray(cv2.max(grey, screen.drawn(magnified)), np.uint8)

    def plain_at(self, picture_pose: Matrix4, index: int, sight: Sight | None = None) -> GreyImage:
        """Returns the echoes alone in 255 grey levels, (height, width) uint8, without faults and what the scanner
        draws.
        """
        return self._compressed(*self.echoes_at(picture_pose, sight), index)

    def echoes_at(self, picture_pose: Matrix4, sight: Sight | None = None) -> tuple[Floats, Floats]:
        """Returns the real and imaginary echo field, (height, width) float32, before noise, gain and compression. A
        cross-wire gives way to nothing, so no sight differs there.
        """
        if self.scene != "cross-wire":
            return self._tissue_echoes(picture_pose, sight or Sight())
        amplitude = self._wire_echoes(picture_pose)
        if not np.isfinite(self.clutter.haze_db):
            return amplitude, np.zeros_like(amplitude)
        haze = np.float32(10 ** (self.clutter.haze_db / 20))
        real, imaginary = self._renderer.field(self._tissue, picture_pose)
        return amplitude + haze * real, haze * imaginary

    def _tissue_echoes(self, pose: Matrix4, sight: Sight) -> tuple[Floats, Floats]:
        real, imaginary = self._renderer.field(self._tissue, pose, sight.moved)
        if sight.gain is not None:
            real, imaginary = real * sight.gain, imaginary * sight.gain
        return (real, imaginary) if sight.added is None else (real + sight.added, imaginary)

    @cached_property
    def _tissue(self) -> Tissue:
        return grown(self.seed, self.scene == "tissue", self.surroundings.layers)

    @cached_property
    def geometry(self) -> Geometry:
        """Returns where the pixels lie."""
        settings = self.settings
        size_px, scale = (settings.width_px, settings.height_px), settings.scale_mm_per_px
        middle = (settings.height_px - 1) / 2
        apex_mm = (_APEX * settings.height_px - middle) * scale[1] if self.surroundings.convex else None
        return Geometry(size_px, scale, apex_mm)

    @cached_property
    def _renderer(self) -> Renderer:
        if self.surroundings.convex:
            return FanRenderer(self.geometry, _FAN_HALF_ANGLE_DEG)
        return Renderer(self.geometry.size_px, self.geometry.scale_mm_per_px, Beam())

    @cached_property
    def _screen(self) -> "_Screen":
        scale = self.settings.scale_mm_per_px
        convex = self.surroundings.convex
        aspect, half_angle_deg = (scale[0] / scale[1], _FAN_HALF_ANGLE_DEG) if convex else (1.0, _HALF_ANGLE_DEG)
        return _Screen(self.settings.width_px, self.settings.height_px, scale[1], aspect, half_angle_deg)

    @cached_property
    def _noise(self) -> Floats:
        """Returns two fields of electronic noise, larger than the picture; each frame takes a window at a place of its
        own.
        """
        settings = self.settings
        shape = (2, settings.height_px + 256, settings.width_px + 256)
        noise = np.random.default_rng((self.seed, 41)).standard_normal(shape, np.float32)
        noise *= np.float32(10 ** (settings.noise_db / 20) / np.sqrt(2))
        return noise

    def _compressed(self, real: Floats, imaginary: Floats, index: int) -> GreyImage:
        """Applies attenuation, electronic noise, depth gain, envelope, logarithm and quantisation to 8 bits."""
        settings = self.settings
        down, right = np.random.default_rng((self.seed, 43, index)).integers(0, 257, 2)
        window = np.s_[down : down + settings.height_px, right : right + settings.width_px]
        depth_db = np.linspace(0, settings.attenuation_db, settings.height_px, dtype=np.float32)[:, None]
        real, imaginary = (
            part * 10 ** (-depth_db / 20) + noise[window]
            for part, noise in zip((real, imaginary), self._noise, strict=True)
        )
        nepers = cv2.log(real * real + imaginary * imaginary + np.float32(1e-9))
        grey_per_db = 255 / settings.range_db
        level = np.float32(120 + grey_per_db * settings.gain_db)
        grey = cv2.addWeighted(nepers, grey_per_db * 10 / np.log(10), nepers, 0, float(level), dtype=cv2.CV_8U)
        return np.asarray(grey, np.uint8)

    def _wire_echoes(self, pose: Matrix4) -> Floats:
        """Returns the amplitude, (h, w) float32, of the two wires and what is in the tank besides."""
        settings = self.settings
        x_mm = ((np.arange(settings.width_px) - (settings.width_px - 1) / 2) * settings.scale_mm_per_px[0])[None, :]
        y_mm = ((np.arange(settings.height_px) - (settings.height_px - 1) / 2) * settings.scale_mm_per_px[1])[:, None]
        return np.sqrt(wire_intensity(pose, x_mm, y_mm, self.clutter, Beam()))


class _Screen:
    """Draws what the scanner draws: the border of the sector, a ruler of its depth, and text and probe arc that never
    move.

    sector: (h, w) uint8 mask, 255 inside. top_row_px: sector top. aspect: ratio of the units in which the sector is
    round, 1 for pixels.
    """

    def __init__(
        self, width_px: int, height_px: int, axial_mm_per_px: float, aspect: float, half_angle_deg: float
    ) -> None:
        self._aspect, self._half_angle_deg = aspect, half_angle_deg
        self.top_row_px = 0.06 * height_px
        self._size_px = (width_px, height_px)
        self._apex_px = ((width_px - 1) / 2, _APEX * height_px)
        self._axial_mm_per_px = axial_mm_per_px
        self.sector = self._sector()
        self._drawn: dict[float, GreyImage] = {}

    @property
    def text(self) -> GreyImage:
        """Returns the overlay, (h, w) uint8, at the depth of the calibration."""
        return self.drawn(1.0)

    def drawn(self, magnified: float) -> GreyImage:
        """Returns the overlay at a depth that magnifies the picture: the ruler's ticks lie that much further apart."""
        if magnified not in self._drawn:
            text = np.zeros((self._size_px[1], self._size_px[0]), np.uint8)
            self._draw_arcs(text)
            self._draw_scale(text, self._axial_mm_per_px / magnified)
            self._draw_words(text)
            self._drawn[magnified] = text
        return self._drawn[magnified]

    def _sector(self) -> GreyImage:
        width, height = self._size_px
        x, y = np.meshgrid((np.arange(width) - self._apex_px[0]) * self._aspect, np.arange(height) - self._apex_px[1])
        radius, angle_deg = np.hypot(x, y), np.degrees(np.arctan2(x, y))
        inside = (np.abs(angle_deg) < self._half_angle_deg) & (radius > self.top_row_px - self._apex_px[1])
        inside &= radius < 0.985 * height - self._apex_px[1]
        return np.where(inside, 255, 0).astype(np.uint8)

    def _draw_arcs(self, text: GreyImage) -> None:
        centre = (round(self._apex_px[0]), round(self._apex_px[1]))
        for row_px, grey in ((self.top_row_px - 3, 200), (0.985 * self._size_px[1], 90)):
            radius = round(row_px - self._apex_px[1])
            start, stop = 90 - self._half_angle_deg, 90 + self._half_angle_deg
            cv2.ellipse(text, centre, (round(radius / self._aspect), radius), 0, start, stop, grey, 1, cv2.LINE_AA)

    def _draw_scale(self, text: GreyImage, axial_mm_per_px: float) -> None:
        """Draws ticks every 5 mm of depth along the right edge, and a focus mark."""
        width, height = self._size_px
        rows = np.arange(self.top_row_px, 0.98 * height, 5 / axial_mm_per_px)
        for tick, row in enumerate(rows):
            length = 10 if tick % 2 == 0 else 5
            cv2.line(text, (width - 4 - length, round(row)), (width - 4, round(row)), 220, 1)
        focus = (width - 22, round(0.55 * height))
        cv2.drawMarker(text, focus, 220, cv2.MARKER_TRIANGLE_UP, 9, 1)

    def _draw_words(self, text: GreyImage) -> None:
        width, height = self._size_px
        size = height / 480
        words = (
            ("SIMULATED", 6, 20),
            ("L 5.0 MHz", 6, 40),
            ("Gn 50", 6, 60),
            ("DR 60", 6, 76),
            ("MI 0.8", width - 80, 20),
        )
        for word, column, row in (
            *words,
            ("P", round(0.36 * width), 36),
            ("12 cm/s", round(0.45 * width), height - 40),
        ):
            place = (column, round(row * size) if row < 100 else row)
            cv2.putText(text, word, place, cv2.FONT_HERSHEY_SIMPLEX, 0.45 * size, 230, 1, cv2.LINE_AA)
