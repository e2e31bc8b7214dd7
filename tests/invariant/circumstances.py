"""What can happen to pictures, poses and stamps on their way to the line."""

from dataclasses import dataclass
from enum import Enum


class Pictures(Enum):
    GENUINE = "genuine pictures"
    BLACK = "black pictures with faint noise"
    NOISE = "pictures of pure noise"
    FLICKER = "every second picture blank"
    FROZEN = "the same picture again and again"
    GONE = "no pictures"


class Manner(Enum):
    """How a picture becomes another."""

    AT_ONCE = "at once"
    BLACK = "after black pictures"
    FROZEN = "after the same picture again and again"
    TORN = "after one picture of which half is the old one's"
    ANIMATED = "little by little"
    FADED = "fading into it"
    AVERAGED = "averaged with what was before"
    WIPED = "wiped from the top"
    WIPED_IN_STEPS = "wiped from the left, with pauses"


GRADUAL = (Manner.FADED, Manner.AVERAGED, Manner.WIPED, Manner.WIPED_IN_STEPS)
"""Each picture is like the one before."""
SUDDEN = tuple(manner for manner in Manner if manner not in GRADUAL)


@dataclass(frozen=True, slots=True)
class Blank:
    """Black pictures beside those by which a picture becomes another. first: before them; otherwise after."""

    lasting_s: float
    first: bool

    def __str__(self) -> str:
        return f"{'first' if self.first else 'then'} {self.lasting_s:g} s of black" if self.lasting_s else "no blank"


NO_BLANK = Blank(0.0, first=True)


class Poses(Enum):
    GENUINE = "genuine poses"
    ONE_IN_TWELVE = "one pose in twelve, the rest missing"
    ONE_IN_TWO = "every second pose missing"
    SLOW = "three poses a second"
    MISSING = "poses missing"
    PARTIAL = "probe partly out of the volume"
    OUT_OF_VOLUME = "probe out of the volume"
    STALE = "stale poses"
    FAULT = "tracker complains"
    NAN = "poses of NaN"
    REPEATED = "the same pose again and again"
    GONE = "no answer of the tracker"


class Stamps(Enum):
    RIGHT = "right stamps"
    FUTURE = "stamps in the future"
    PAST = "stamps in the past"
    ALIKE = "all stamps alike"
    CRAWLING = "each stamp a nanosecond after the one before"
    HALF_AS_FAST = "stamps of a clock that goes half as fast"


@dataclass(slots=True)
class Circumstances:
    """skew_ns: how far stamps in the future or the past are off."""

    pictures: Pictures = Pictures.GENUINE
    poses: Poses = Poses.GENUINE
    frame_stamps: Stamps = Stamps.RIGHT
    pose_stamps: Stamps = Stamps.RIGHT
    skew_ns: int = 20_000_000_000
    moving: bool = True

    @property
    def in_view(self) -> bool:
        """Nothing is between the truth and the line."""
        return self.pictures is Pictures.GENUINE and self._else_in_view

    @property
    def blank(self) -> bool:
        """Pictures without steady tissue come, and nothing else is wrong."""
        return self.pictures in (Pictures.BLACK, Pictures.NOISE, Pictures.FLICKER) and self._else_in_view

    @property
    def _else_in_view(self) -> bool:
        return self.poses is Poses.GENUINE and self.frame_stamps is self.pose_stamps is Stamps.RIGHT

    def __str__(self) -> str:
        parts = self.pictures, self.poses
        told = [part.value for part in parts if part.name != "GENUINE"]
        told += [
            f"{what}: {s.value}"
            for what, s in (("frames", self.frame_stamps), ("poses", self.pose_stamps))
            if s is not Stamps.RIGHT
        ]
        return ", ".join(told + ([] if self.moving else ["probe at rest"])) or "all well"
