"""Defines the faults that a simulated cart can show, when each is on, and what it does to a picture or a pose.

The helpers are pure, so a recording can be spoiled with the same faults as the live twins.
"""

import json
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.samples import GreyImage, Matrix4
from probewatch.drivers.suggestion import did_you_mean, suggested

CART_FAULTS = (
    "flip-lateral",
    "flip-vertical",
    "depth",
    "bend-marker",
    "slide-marker",
    "latency",
    "freeze-video",
    "lose-video",
    "lose-tracker",
    "stale-tracker",
)
"""Names of the faults that a cart must notice; tools/demo/script.py lists the class under which it does."""

PICTURE_FAULTS = (
    "flip-lateral",
    "flip-vertical",
    "depth",
    "freeze-video",
    "user-freeze",
    "lose-video",
    "flicker-blank",
    "future-stamp",
)
"""Names of the faults that the scanner shows; the tracker shows the others.

user-freeze: the freeze key was pressed, so the picture does not change and carries a mark. flicker-blank: every second
picture is black but for faint noise. future-stamp: the first picture, and no other, has a stamp FUTURE_S ahead."""

_LATEST_S = 1e9
"""Seconds, thirty years: a later time is a slip, and is refused. Its nanoseconds fit 64 bits."""

ZOOM = 1.10
LATENCY_S = 0.100
"""Factor and seconds, past the default limits (appliance/limits.py: 5 %, 60 ms), so that they must be found, and no
more than twice those limits."""
FUTURE_S = 60.0
"""Seconds, twice as long as a verification lasts (max_verification_age), so that a stamp taken for true would outlast
it."""
_MARK_PX, _MARK_INSET_PX, _MARK_GREY = 12, 4, 230
"""Pixels and grey of a freeze symbol: smaller than any scanner's, in the corner that no sector reaches."""
_FAINT_GREY = 4
"""Grey levels of a blank picture's noise, as a grabber without a signal shows; speckle spans ten times as many."""

BEND_DEG = 5.0
"""Degrees, past the default limit of 3° (appliance/limits.py) by less than twice that limit."""

BEND_AXIS = (0.95, 0.16, 0.27)
"""Axis in the sensor frame; oblique to all picture axes of the simulated probe, nearest to the elevational."""

SLIDE_MM = (0.5, -7.4, 6.7)
"""Shift of the marker body in its own frame; 10 mm long, past the default limit of 4 mm (appliance/limits.py)."""


@dataclass(frozen=True, slots=True)
class Episode:
    """Represents one fault that is on from from_s until to_s, world seconds; with to_s None it never ends."""

    fault: str
    from_s: float
    to_s: float | None = None

    def covers(self, t_s: float) -> bool:
        """Returns whether the fault is on at t_s."""
        return self.from_s <= t_s and (self.to_s is None or t_s < self.to_s)


def refuse_unknown_fault(name: object, names: Collection[str], where: str) -> None:
    """Raises ConfigurationError for a name that is not one of `names`, and suggests the most similar of them."""
    if name in list(names):
        return
    question = did_you_mean(suggested(str(name), names))
    what = f"{repr(name)[:80]} is not a known fault"
    if name in CART_FAULTS and not question:
        what += f" of this device; the {'scanner' if name in PICTURE_FAULTS else 'tracker'} shows it"
    raise ConfigurationError(what, where, f"{question} Use {', '.join(sorted(names))}".lstrip())


def _refuse(what: str, entry: object, where: str = "fault schedule") -> ConfigurationError:
    remedy = 'Give a list such as [{"fault": "depth", "from_s": 20, "to_s": 40}]'
    return ConfigurationError(f"{what}: {json.dumps(entry)}", where, remedy)


def _second(entry: dict[str, Any], key: str, where: str) -> float:
    value = entry[key]
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= _LATEST_S:
        raise _refuse(f"{key} must be a number of seconds from 0 to 1e9", entry, where)
    return float(value)


def episode_of(entry: object, names: Collection[str], where: str = "fault schedule") -> Episode:
    """Returns an entry of a schedule as an Episode. Raises ConfigurationError naming what is wrong. where: the place of
    the entry, for the message.
    """
    if not isinstance(entry, dict) or not {"fault", "from_s"} <= set(entry) <= {"fault", "from_s", "to_s"}:
        raise _refuse("each entry needs fault, from_s and may have to_s, nothing else", entry, where)
    refuse_unknown_fault(entry["fault"], names, where)
    from_s = _second(entry, "from_s", where)
    to_s = None if entry.get("to_s") is None else _second(entry, "to_s", where)
    if to_s is not None and to_s <= from_s:
        raise _refuse("to_s must be later than from_s", entry, where)
    return Episode(entry["fault"], from_s, to_s)


@dataclass(frozen=True, slots=True)
class Schedule:
    """Holds which faults are on at which world time."""

    episodes: tuple[Episode, ...] = ()

    @classmethod
    def parse(cls, text: str, names: Collection[str] = CART_FAULTS) -> "Schedule":
        """Parses a JSON list of {"fault", "from_s", "to_s"}. Raises ConfigurationError naming the entry.

        names: the faults that the device knows.
        """
        try:
            entries = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise _refuse(f"not JSON ({error})", text[:80]) from None
        if not isinstance(entries, list):
            raise _refuse("not a list", entries)
        return cls(tuple(episode_of(entry, names) for entry in entries))

    def to_json(self) -> str:
        """Returns the text that parse() reads back as an equal Schedule."""
        return json.dumps([{"fault": e.fault, "from_s": e.from_s, "to_s": e.to_s} for e in self.episodes])

    def active(self, t_s: float) -> frozenset[str]:
        """Returns the names of the faults that are on at t_s."""
        return frozenset(episode.fault for episode in self.episodes if episode.covers(t_s))


def zoom(image: GreyImage, factor: float, top_row_px: float = 0.0) -> GreyImage:
    """Returns the picture magnified about the top centre of its sector, as a smaller depth setting shows it."""
    centre_px = (image.shape[1] - 1) / 2
    warp = np.array([[factor, 0, centre_px * (1 - factor)], [0, factor, top_row_px * (1 - factor)]])
    zoomed = cv2.warpAffine(image, warp, (image.shape[1], image.shape[0]), flags=cv2.INTER_LINEAR)
    return np.asarray(zoomed, np.uint8)


def spoil_image(image: GreyImage, active: Collection[str], top_row_px: float = 0.0) -> GreyImage:
    """Applies the image faults among `active` to a picture, (h, w) uint8 → the same shape, and ignores other names."""
    if "depth" in active:
        image = zoom(image, ZOOM, top_row_px)
    if "flip-lateral" in active:
        image = image[:, ::-1]
    if "flip-vertical" in active:
        image = image[::-1]
    return np.ascontiguousarray(image)


def frozen_image(image: GreyImage) -> GreyImage:
    """Returns the picture with the mark of the freeze key: a ring in its upper right corner."""
    marked = image.copy()
    radius = _MARK_PX // 2
    centre = (image.shape[1] - _MARK_INSET_PX - radius, _MARK_INSET_PX + radius)
    cv2.circle(marked, centre, radius, _MARK_GREY, 3)
    return marked


def blank_image(shape: tuple[int, ...], index: int) -> GreyImage:
    """Returns a picture, (h, w) uint8, that is black but for noise of a few grey levels, which index, >= 0, seeds."""
    return np.random.default_rng((47, index)).integers(0, _FAINT_GREY, shape, np.uint8)


def spoil_pose(matrix: Matrix4, active: Collection[str]) -> Matrix4:
    """Returns the pose that is reported once the marker body sits differently on the probe. matrix: (4, 4) sensor →
    tracker, mm.
    """
    change = np.eye(4)
    if "bend-marker" in active:
        axis = np.array(BEND_AXIS) / np.linalg.norm(BEND_AXIS)
        change[:3, :3] = Rotation.from_rotvec(np.radians(BEND_DEG) * axis).as_matrix()
    if "slide-marker" in active:
        change[:3, 3] = SLIDE_MM
    return matrix @ change


def spoil_witness(matrix: Matrix4, active: Collection[str]) -> Matrix4:
    """Returns the pose that is reported of a second body on the probe, whose own clamp gave way."""
    return spoil_pose(matrix, {"bend-marker"} if "bend-witness" in active else ())


def pose_time_s(t_s: float, active: Collection[str]) -> float:
    """Returns the world time of the pose that a tracker reports as that of t_s."""
    return t_s - LATENCY_S if "latency" in active else t_s
