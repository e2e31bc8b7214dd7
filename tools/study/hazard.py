"""Describes what can be wrong in a session, how large, how it came about, and how it alters body, picture and stamp.

Everything here is pure.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.types import Calibration, Fault
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.rigid import Array, inverse, rigid, rotation_from_vector
from probewatch.drivers.samples import GreyImage
from probewatch.drivers.suggestion import did_you_mean, suggested
from probewatch.tools.study.metal import distorted

ONSET_S = 20.0
"""Second at which a hazard that was not there from the start begins: a healthy session is verified by then, where it
can be."""
CREEP_S = 8.0
"""Seconds that a creeping hazard takes to its full size; a slipping clamp, a tracker whose buffer fills."""
HIDDEN_S = 2.0
"""Seconds for which an unseen change is hidden: probe off the skin and out of the tracker's sight, as when it is
wiped."""


class Manner(StrEnum):
    """Names how a hazard came about."""

    START = "start"
    SUDDEN = "sudden"
    CREEPING = "creeping"
    UNSEEN = "unseen"


_EXCHANGED = np.array([*np.deg2rad([12.0, -20.0, 15.0]), -0.20, -0.15, 15.0, -10.0, 20.0, 0.0])
"""Change of X, rad, relative and mm, by a probe of another kind with a body of its own. No real pair was measured;
larger changes were not tried."""
_UNITS: Mapping[str, Callable[[float], float]] = {
    "deg": lambda size: float(np.deg2rad(size)),
    "mm": lambda size: size,
    "%": lambda size: size / 100,
    "ms": lambda size: size / 1000,
}
"""Unit of a size → the size in rad, mm, relative or s."""
_EACH, _AT_ONCE, _START = tuple(Manner), (Manner.START, Manner.SUDDEN, Manner.UNSEEN), (Manner.START,)


@dataclass(frozen=True, slots=True, eq=False)
class HazardKind:
    """Describes what the study can simulate. fault: class under which it ought to be named. unit: that of its size; ""
    where it has none. rows: those of the nine numbers of `Hazard.change` that are its size. change: (9,) where it has
    no size.

    mirror: that of the picture, (lateral, axial). read: (n, 4, 4) poses → as they are reported. metal: whether it bends
    the tracker's field by its size. sizes, manners: those of `--hazards all`. within: largest size that is not wrong
    yet.
    """

    fault: Fault
    unit: str = ""
    rows: tuple[int, ...] = ()
    change: Array | None = None
    mirror: tuple[int, int] | None = None
    read: Callable[[Array], Array] | None = None
    metal: bool = False
    sizes: tuple[float, ...] = (0.0,)
    manners: tuple[Manner, ...] = _EACH
    within: float | None = None


def _bend(row: int) -> HazardKind:
    return HazardKind(Fault.ROTATION, "deg", (row,), sizes=(4.0, -6.0), within=1.5)


def _slide(row: int) -> HazardKind:
    return HazardKind(Fault.OFFSET, "mm", (row,), sizes=(5.0, -8.0), within=2.0)


def _scale(*rows: int, within: float | None = None) -> HazardKind:
    return HazardKind(Fault.SCALE, "%", rows, sizes=(7.0, -10.0), within=within)


def _swapped(poses: Array) -> Array:
    return np.asarray(poses @ np.array([[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1.0]]))


_ROWS: Mapping[str, HazardKind] = {
    "bend-lateral": _bend(0),
    "bend-axial": _bend(1),
    "bend-elevational": _bend(2),
    "slide-lateral": _slide(5),
    "slide-axial": _slide(6),
    "slide-elevational": _slide(7),
    "scale-lateral": _scale(3, within=2.5),
    "scale-axial": _scale(4, within=2.5),
    "depth": _scale(3, 4),
    "flip-lateral": HazardKind(Fault.POLARITY, mirror=(-1, 1), manners=_AT_ONCE),
    "flip-axial": HazardKind(Fault.POLARITY, mirror=(1, -1), manners=_AT_ONCE),
    "latency": HazardKind(Fault.LATENCY, "ms", (8,), sizes=(80.0, -120.0, 450.0), within=30.0),
    "metal": HazardKind(
        Fault.FIELD_DISTORTION, "mm", metal=True, sizes=(3.0, 6.0), manners=(Manner.START, Manner.CREEPING)
    ),
    "exchanged-probe": HazardKind(Fault.EXCHANGED_PROBE, change=_EXCHANGED, manners=(Manner.START, Manner.UNSEEN)),
    "poses-inverted": HazardKind(Fault.POSE_CONVENTION, read=inverse, manners=_START),
    "axes-swapped": HazardKind(Fault.POSE_CONVENTION, read=_swapped, manners=_START),
}
"""Kind → what it is. Sizes are 1.3 and 2 times the limit as shipped, one sign each, in every manner; metal displaces by
3 or 6 mm. What is within is half of the limit at most."""
KINDS = ("none", *_ROWS)
FAULTS: Mapping[str, Fault] = {kind: row.fault for kind, row in _ROWS.items()}
"""Kind → class under which it ought to be named."""
_TEXT = re.compile(r"([a-z-]+?)(?:=([+-]?[0-9.]+))?(?:@([a-z]+))?")


_MOST: Mapping[str, float] = {"deg": 90.0, "mm": 100.0, "%": 50.0, "ms": 5000.0}
"""Unit → largest size. Beyond it no simulated session shows anything, since every picture and pose is wrong. It is far
above all that was tried (`all`)."""


def _size(kind: str, text: str | None) -> float:
    """Parses a size. Raises ConfigurationError where the text is not a number, and for one beyond _MOST."""
    if text is None:
        return 0.0
    unit = _ROWS[kind].unit
    try:
        size = float(text)
    except ValueError:
        raise ConfigurationError(f"'{text}' is not a number", "study", f"Give {kind}=5, for example") from None
    if not abs(size) <= _MOST[unit]:
        raise ConfigurationError(
            f"{kind}={text} is out of bounds", "study", f"Give up to {_MOST[unit]:g} {unit} either way"
        )
    return size


@dataclass(frozen=True)
class Hazard:
    """Represents one hazard. size: deg, mm, % or ms; 0 for those that have none. beside: what else is wrong, with a
    manner of its own.
    """

    kind: str = "none"
    size: float = 0.0
    manner: Manner = Manner.START
    beside: "Hazard | None" = None

    @classmethod
    def parse(cls, text: str) -> "Hazard":
        """Parses KIND, KIND=SIZE or KIND=SIZE@MANNER, and others after a slash. Raises ConfigurationError."""
        first, slash, rest = text.partition("/")
        one = cls._parse_one(first)
        if not slash:
            return one
        beside = cls.parse(rest)
        if "none" in (one.kind, beside.kind):
            raise ConfigurationError(f"'{text}' has 'none' beside a hazard", "study", "Leave it and the slash out")
        return replace(one, beside=beside)

    @classmethod
    def _parse_one(cls, text: str) -> "Hazard":
        found = _TEXT.fullmatch(text)
        kind, size, manner = found.groups() if found else ("", None, None)
        named = text.partition("=")[0].partition("@")[0]
        if kind not in KINDS and named in KINDS:
            raise ConfigurationError(f"'{text}' is not KIND=SIZE@MANNER", "study", f"Give {named}=5@start, for example")
        if kind not in KINDS:
            remedy = f"{did_you_mean(suggested(named, KINDS))} Use one of {', '.join(KINDS)}".lstrip()
            raise ConfigurationError(f"'{text}' is not a known hazard", "study", remedy)
        sized = kind in _ROWS and _ROWS[kind].unit != ""
        if (size is not None) != sized:
            remedy = f"Give {kind}=5, for example" if sized else f"Give {kind} alone"
            raise ConfigurationError(f"'{text}' has {'a' if size else 'no'} size", "study", remedy)
        if manner is not None and manner not in list(Manner):
            raise ConfigurationError(f"'{manner}' is not a manner", "study", f"Use @{', @'.join(Manner)}")
        return cls(kind, _size(kind, size), Manner(manner or Manner.START))

    def __str__(self) -> str:
        size = f"={self.size:g}" if self._row and self._row.unit else ""
        own = f"{self.kind}{size}@{self.manner}" if self._row else self.kind
        return own if self.beside is None else f"{own}/{self.beside}"

    @property
    def _row(self) -> HazardKind | None:
        """Returns the row of the kind of hazard; None for `none`."""
        return _ROWS.get(self.kind)

    @property
    def fault(self) -> Fault | None:
        """Returns the class under which it ought to be named; None for `none`."""
        return FAULTS.get(self.kind)

    @property
    def each(self) -> "tuple[Hazard, ...]":
        """Returns this hazard, and what is beside it."""
        return (self, *(() if self.beside is None else self.beside.each))

    @property
    def faults(self) -> frozenset[Fault]:
        """Returns all classes that ought to be named."""
        return frozenset(one.fault for one in self.each if one.fault is not None)

    @property
    def limited(self) -> bool:
        """Returns whether anything of it can be given in multiples of a limit: what metal does at each place cannot."""
        return not all(one._row and one._row.metal for one in self.each)

    @property
    def onset_s(self) -> float:
        """Returns the time from which on everything is wrong, s; infinite for `none`."""
        if self.kind == "none":
            return np.inf
        own_s = 0.0 if self.manner is Manner.START else ONSET_S
        return own_s if self.beside is None else max(own_s, self.beside.onset_s)

    def share(self, t_s: Array) -> Array:
        """Returns the share of its size that is present at each time, (n,) 0 … 1."""
        if self.kind == "none" or self.manner is Manner.START:
            return np.full(t_s.shape, float(self.kind != "none"))
        if self.manner is Manner.CREEPING:
            return np.clip((t_s - ONSET_S) / CREEP_S, 0.0, 1.0)
        middle_s = ONSET_S + (HIDDEN_S / 2 if self.manner is Manner.UNSEEN else 0.0)
        return (t_s >= middle_s).astype(float)

    def hides(self, t_s: Array) -> NDArray[np.bool_]:
        """Returns whether neither picture nor pose shows anything, (n,)."""
        unseen = any(one.manner is Manner.UNSEEN for one in self.each)
        return unseen & (t_s >= ONSET_S) & (t_s < ONSET_S + HIDDEN_S)

    def change(self, t_s: Array) -> Array:
        """Returns how the truth differs from the reference, (n, 9): rad, relative, mm, and the latency, s."""
        return np.asarray(sum(one.share(t_s)[:, None] * one._whole for one in self.each))

    @property
    def _whole(self) -> Array:
        """Returns the change, (9,), once all of it is present."""
        row, whole = self._row, np.zeros(9)
        if row is None:
            return whole
        if row.change is not None:
            return row.change
        if row.rows:
            whole[list(row.rows)] = _UNITS[row.unit](self.size)
        return whole

    def body(self, reference: Calibration, t_s: Array) -> Array:
        """Returns the true sensor → picture, (n, 4, 4)."""
        change = self.change(t_s)
        return rigid(rotation_from_vector(change[:, :3]) @ reference.rotation, reference.offset_mm + change[:, 5:8])

    def measured(self, poses: Array, t_s: Array) -> Array:
        """Returns the poses, (n, 4, 4), as the tracker measures them at these times, but for its noise."""
        for one in self.each:
            poses = distorted(poses, one.size, one.share(t_s)) if one._row and one._row.metal else poses
        return poses

    def reported(self, poses: Array) -> Array:
        """Returns the poses, (n, 4, 4), as a tracker of that convention reports them."""
        for one in self.each:
            poses = one._row.read(poses) if one._row and one._row.read else poses
        return poses

    def shown(self, image: GreyImage, t_s: float) -> GreyImage:
        """Returns the picture, (h, w) uint8, as the scanner shows it at that time."""
        for one in self.each:
            image = one._shown_alone(image, float(one.share(np.array([t_s]))[0]))
        return image

    def _shown_alone(self, image: GreyImage, share: float) -> GreyImage:
        if share == 0.0:
            return image
        if self._row and self._row.mirror:
            lateral, axial = self._row.mirror
            return np.ascontiguousarray(image[::axial, ::lateral])
        scales = share * self._whole[3:5]
        if not np.any(scales):
            return image
        factors = 1 / (1 + scales)
        middle = (np.array(image.shape[::-1]) - 1) / 2
        warp = np.column_stack([np.diag(factors), middle * (1 - factors)])
        return np.asarray(cv2.warpAffine(image, warp, image.shape[::-1], flags=cv2.INTER_LINEAR), np.uint8)


STANDARD = (
    Hazard(),
    *(Hazard(kind, size, manner) for kind, row in _ROWS.items() for size in row.sizes for manner in row.manners),
)
"""Hazards of `--hazards all`."""
_WITHIN_RUNS = 8
"""Runs of `--hazards within`. More cover more sizes on the same pictures."""


def _within() -> Iterator[Hazard]:
    random = np.random.default_rng(41)
    for _ in range(_WITHIN_RUNS):
        most = {kind: row.within for kind, row in _ROWS.items() if row.within is not None}
        sizes = {kind: size * random.uniform(-1, 1) for kind, size in most.items()}
        yield Hazard.parse("/".join(f"{kind}={size:.2f}@{Manner.START}" for kind, size in sizes.items()))


WITHIN = tuple(_within())
"""Hazards of `--hazards within`: all nine at once from the start, none beyond half of its limit, drawn evenly: nothing
is to be named, and the error of a point is to be covered (`tools.study.point`)."""
