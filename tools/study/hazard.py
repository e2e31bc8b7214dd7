"""What can be wrong in a session, how large, how it came about, and what it does to body, picture and stamp. Pure."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from appliance.types import Calibration, Fault
from drivers.errors import ConfigurationError
from drivers.rigid import Array, inverse, rigid, rotation_from_vector
from drivers.samples import GreyImage
from tools.study.metal import distorted

ONSET_S = 20.0
"""When what was not there from the start begins: a healthy session is verified by then, where it can be."""
CREEP_S = 8.0
"""How long a creeping hazard takes to its full size; a slipping clamp, a tracker whose buffer fills."""
HIDDEN_S = 2.0
"""For which an unseen change is hidden: probe off the skin and out of the tracker's sight, as when it is wiped."""


class Manner(StrEnum):
    """How it came about."""

    START = "start"
    SUDDEN = "sudden"
    CREEPING = "creeping"
    UNSEEN = "unseen"


_BODY: Mapping[str, tuple[int, str]] = {
    "bend-lateral": (0, "deg"),
    "bend-axial": (1, "deg"),
    "bend-elevational": (2, "deg"),
    "slide-lateral": (5, "mm"),
    "slide-axial": (6, "mm"),
    "slide-elevational": (7, "mm"),
}
_SCALES: Mapping[str, tuple[int, ...]] = {"scale-lateral": (3,), "scale-axial": (4,), "depth": (3, 4)}
_FLIPS: Mapping[str, tuple[int, int]] = {"flip-lateral": (-1, 1), "flip-axial": (1, -1)}
_CONVENTIONS: Mapping[str, Callable[[Array], Array]] = {
    "poses-inverted": inverse,
    "axes-swapped": lambda poses: poses @ np.array([[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1.0]]),
}
_EXCHANGED = np.array([*np.deg2rad([12.0, -20.0, 15.0]), -0.20, -0.15, 15.0, -10.0, 20.0, 0.0])
"""Change of X, rad, relative and mm, by a probe of another kind with a body of its own. No real pair was measured; what
is farther off was not tried."""
_EXCHANGE, _METAL = "exchanged-probe", "metal"
KINDS = ("none", *_BODY, *_SCALES, *_FLIPS, "latency", _METAL, _EXCHANGE, *_CONVENTIONS)
_PLAIN = frozenset({"none", *_FLIPS, _EXCHANGE, *_CONVENTIONS})
"""Those that have no size."""
FAULTS: Mapping[str, Fault] = {
    **{kind: Fault.ROTATION if unit == "deg" else Fault.OFFSET for kind, (_, unit) in _BODY.items()},
    **dict.fromkeys(_SCALES, Fault.SCALE),
    **dict.fromkeys(_FLIPS, Fault.POLARITY),
    "latency": Fault.LATENCY,
    _METAL: Fault.FIELD_DISTORTION,
    _EXCHANGE: Fault.EXCHANGED_PROBE,
    **dict.fromkeys(_CONVENTIONS, Fault.POSE_CONVENTION),
}
"""Kind → class under which it ought to be named."""
_TEXT = re.compile(r"([a-z-]+?)(?:=([+-]?[0-9.]+))?(?:@([a-z]+))?")


@dataclass(frozen=True)
class Hazard:
    """size: deg, mm, % or ms; 0 for those that have none. beside: what else is wrong, with a manner of its own."""

    kind: str = "none"
    size: float = 0.0
    manner: Manner = Manner.START
    beside: "Hazard | None" = None

    @classmethod
    def parse(cls, text: str) -> "Hazard":
        """KIND, KIND=SIZE or KIND=SIZE@MANNER, and others behind a slash. Raises ConfigurationError."""
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
        if kind not in KINDS:
            raise ConfigurationError(f"'{text}' is not a known hazard", "study", f"Use one of {', '.join(KINDS)}")
        if (size is None) != (kind in _PLAIN):
            remedy = f"Give {kind} alone" if kind in _PLAIN else f"Give {kind}=5, for example"
            raise ConfigurationError(f"'{text}' has {'a' if size else 'no'} size", "study", remedy)
        if manner is not None and manner not in list(Manner):
            raise ConfigurationError(f"'{manner}' is not a manner", "study", f"Use @{', @'.join(Manner)}")
        try:
            return cls(kind, float(size or 0), Manner(manner or Manner.START))
        except ValueError:
            raise ConfigurationError(f"'{size}' is not a number", "study", f"Give {kind}=5, for example") from None

    def __str__(self) -> str:
        size = "" if self.kind in _PLAIN else f"={self.size:g}"
        own = self.kind if self.kind == "none" else f"{self.kind}{size}@{self.manner}"
        return own if self.beside is None else f"{own}/{self.beside}"

    @property
    def fault(self) -> Fault | None:
        """Class under which it ought to be named; None for none."""
        return FAULTS.get(self.kind)

    @property
    def each(self) -> "tuple[Hazard, ...]":
        """This one, and what is beside it."""
        return (self, *(() if self.beside is None else self.beside.each))

    @property
    def faults(self) -> frozenset[Fault]:
        """All classes that ought to be named."""
        return frozenset(one.fault for one in self.each if one.fault is not None)

    @property
    def limited(self) -> bool:
        """Whether anything of it can be given in multiples of a limit: what metal does at each place cannot."""
        return any(one.kind != _METAL for one in self.each)

    @property
    def onset_s(self) -> float:
        """The time from which on everything is wrong, s; infinite for none."""
        if self.kind == "none":
            return np.inf
        own_s = 0.0 if self.manner is Manner.START else ONSET_S
        return own_s if self.beside is None else max(own_s, self.beside.onset_s)

    def share(self, t_s: Array) -> Array:
        """(n,) how much of its size is there at each time, 0 … 1."""
        if self.kind == "none" or self.manner is Manner.START:
            return np.full(t_s.shape, float(self.kind != "none"))
        if self.manner is Manner.CREEPING:
            return np.clip((t_s - ONSET_S) / CREEP_S, 0.0, 1.0)
        middle_s = ONSET_S + (HIDDEN_S / 2 if self.manner is Manner.UNSEEN else 0.0)
        return (t_s >= middle_s).astype(float)

    def hides(self, t_s: Array) -> NDArray[np.bool_]:
        """(n,) whether neither picture nor pose shows anything."""
        unseen = any(one.manner is Manner.UNSEEN for one in self.each)
        return unseen & (t_s >= ONSET_S) & (t_s < ONSET_S + HIDDEN_S)

    def change(self, t_s: Array) -> Array:
        """(n, 9): how the truth differs from the reference, rad, relative, mm, and the latency, s."""
        return np.asarray(sum(one.share(t_s)[:, None] * one._whole for one in self.each))

    @property
    def _whole(self) -> Array:
        """(9,) the same once all of it is there."""
        if self.kind == _EXCHANGE:
            return _EXCHANGED
        whole = np.zeros(9)
        if self.kind in _BODY:
            row, unit = _BODY[self.kind]
            whole[row] = np.deg2rad(self.size) if unit == "deg" else self.size
        elif self.kind in _SCALES:
            whole[list(_SCALES[self.kind])] = self.size / 100
        elif self.kind == "latency":
            whole[8] = self.size / 1000
        return whole

    def body(self, reference: Calibration, t_s: Array) -> Array:
        """(n, 4, 4) sensor → picture as it truly is."""
        change = self.change(t_s)
        return rigid(rotation_from_vector(change[:, :3]) @ reference.rotation, reference.offset_mm + change[:, 5:8])

    def measured(self, poses: Array, t_s: Array) -> Array:
        """(n, 4, 4) as the tracker measures them at these times, but for its noise."""
        for one in self.each:
            poses = distorted(poses, one.size, one.share(t_s)) if one.kind == _METAL else poses
        return poses

    def reported(self, poses: Array) -> Array:
        """(n, 4, 4) as a tracker of that convention reports them."""
        for one in self.each:
            poses = _CONVENTIONS[one.kind](poses) if one.kind in _CONVENTIONS else poses
        return poses

    def shown(self, image: GreyImage, t_s: float) -> GreyImage:
        """(h, w) uint8 as the scanner shows it at that time."""
        for one in self.each:
            image = one._shown_alone(image, float(one.share(np.array([t_s]))[0]))
        return image

    def _shown_alone(self, image: GreyImage, share: float) -> GreyImage:
        if share == 0.0:
            return image
        if self.kind in _FLIPS:
            lateral, axial = _FLIPS[self.kind]
            return np.ascontiguousarray(image[::axial, ::lateral])
        scales = share * self._whole[3:5]
        if not np.any(scales):
            return image
        factors = 1 / (1 + scales)
        middle = (np.array(image.shape[::-1]) - 1) / 2
        warp = np.column_stack([np.diag(factors), middle * (1 - factors)])
        return np.asarray(cv2.warpAffine(image, warp, image.shape[::-1], flags=cv2.INTER_LINEAR), np.uint8)


STANDARD = tuple(
    Hazard.parse(text)
    for text in (
        "none",
        *(f"bend-{axis}={size}@{manner}" for axis in ("lateral", "axial", "elevational") for size in (4, -6)
          for manner in Manner),
        *(f"slide-{axis}={size}@{manner}" for axis in ("lateral", "axial", "elevational") for size in (5, -8)
          for manner in Manner),
        *(f"{kind}={size}@{manner}" for kind in ("scale-lateral", "scale-axial", "depth") for size in (7, -10)
          for manner in Manner),
        *(f"{kind}@{manner}" for kind in _FLIPS for manner in (Manner.START, Manner.SUDDEN, Manner.UNSEEN)),
        *(f"latency={size}@{manner}" for size in (80, -120, 450) for manner in Manner),
        *(f"{_METAL}={size}@{manner}" for size in (3, 6) for manner in (Manner.START, Manner.CREEPING)),
        *(f"{_EXCHANGE}@{manner}" for manner in (Manner.START, Manner.UNSEEN)),
        *(f"{kind}@start" for kind in _CONVENTIONS),
    )
)  # fmt: skip
"""`--hazards all`: each by 1.3 and 2 times its limit, one sign each, in every manner; metal that displaces by 3 or 6
mm."""
_HALF = {
    **{kind: 1.5 if unit == "deg" else 2.0 for kind, (_, unit) in _BODY.items()},
    "scale-lateral": 2.5,
    "scale-axial": 2.5,
    "latency": 30.0,
}
"""deg, mm, % and ms: of what is not wrong yet, at most: half of each limit as shipped."""
_WITHIN_RUNS = 8
"""Of `--hazards within`. More tell of more sizes on the same pictures."""


def _within() -> Iterator[Hazard]:
    random = np.random.default_rng(41)
    for _ in range(_WITHIN_RUNS):
        sizes = {kind: most * random.uniform(-1, 1) for kind, most in _HALF.items()}
        yield Hazard.parse("/".join(f"{kind}={size:.2f}@{Manner.START}" for kind, size in sizes.items()))


WITHIN = tuple(_within())
"""`--hazards within`: all nine at once from the start, none beyond half of its limit, drawn evenly: nothing is to be
named, and the error of a point is to be covered (`tools.study.point`)."""
