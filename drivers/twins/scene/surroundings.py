"""Defines named worlds: what a probe may look at and through. Each part is one row; a name joins parts by "+":
half-30+drag-2.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.twins.scene.breathing import DIRECTIONS
from probewatch.drivers.twins.scene.processing import Processing
from probewatch.drivers.twins.scene.softness import Follow


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Describes a patient, a probe and a scanner.

    follow: how tissue follows a press. play_mm: how far the skin sticks to the face. breath_mm, breath_to: path of the
    tissue, peak to peak, and its direction, a unit vector. organ: whether only what lies under the wall makes all of
    that path. pulse: whether there is one. ribs: number of ribs. gas: whether they are gas instead. contact: share of
    the face that touches. peels: whether the contact comes and goes. layers, needle: whether there are any. convex:
    whether the probe is. deep: whether the picture shows twice as much tissue. processing: that of the scanner.
    tracker_mm: by how much the tracker errs from place to place.
    """

    follow: Follow = field(default_factory=Follow)
    play_mm: float = 0.0
    breath_mm: float = 0.0
    breath_to: tuple[float, float, float] = DIRECTIONS["axial"]
    organ: bool = False
    pulse: bool = False
    ribs: int = 0
    gas: bool = False
    contact: float = 1.0
    peels: bool = False
    layers: bool = False
    needle: bool = False
    convex: bool = False
    deep: bool = False
    processing: Processing = field(default_factory=Processing)
    tracker_mm: float = 0.0

    @property
    def yields(self) -> bool:
        """Returns whether parts of the tissue move against one another."""
        return self.follow.whole > 0 or self.play_mm > 0 or self.organ


@dataclass(frozen=True, slots=True)
class _Size:
    """Describes a number in a name, in its unit. whole: whether it is an integer."""

    unit: str
    least: float
    most: float
    whole: bool = False

    def read(self, text: str) -> float:
        """Parses the number. Raises ValueError."""
        value = int(text) if self.whole else float(text)
        if not self.least <= value <= self.most:
            raise ValueError
        return value

    def __str__(self) -> str:
        return f"{self.unit} {self.least:g} … {self.most:g}"


@dataclass(frozen=True, slots=True)
class Part:
    """Describes one row. sizes: numbers that follow the name. to: whether a direction follows them. change: returns the
    changed surroundings, given the numbers.
    """

    what: str
    change: Callable[..., Surroundings]
    sizes: tuple[_Size, ...] = ()
    to: bool = False

    def form(self, name: str) -> str:
        """Returns how the part is written: breath-MM-TO."""
        return "-".join([name, *(size.unit.upper() for size in self.sizes), *(["TO"] if self.to else [])])


def _pressed(now: Surroundings, **sizes: float) -> Surroundings:
    return replace(now, follow=replace(now.follow, **({"whole": 1.0} | sizes)))


def _processed(now: Surroundings, change: Callable[[Processing], Processing]) -> Surroundings:
    return replace(now, processing=change(now.processing))


def _breath(now: Surroundings, mm: float, to: str, organ: bool = False) -> Surroundings:
    return replace(now, breath_mm=mm, breath_to=DIRECTIONS[to], organ=organ)


RIGID = "rigid"
"""Name of the usual world of simulated devices."""
_BREATH = _Size("mm", 1, 20)
"""Path of a breath, peak to peak, up to a deep one. Not measured."""
_SHADOWS = _Size("number", 1, 2, whole=True)
"""Number of ribs, or of pockets of gas."""
_TOUCHING = _Size("share", 0.4, 0.95)
"""Share of the width of the face that touches the skin. Not measured."""
PARTS: Mapping[str, Part] = {
    RIGID: Part("nothing gives way", lambda now: now),
    "still": Part("the same", lambda now: now),
    "breathing": Part("breath-4-axial+pulse", lambda now: replace(_breath(now, 4.0, "axial"), pulse=True)),
    "layer": Part("a rigid back so deep", lambda now, mm: _pressed(now, back_mm=mm), (_Size("mm", 25, 300),)),
    "half": Part(
        "a half space under a face of this half width",
        lambda now, mm: _pressed(now, half_width_mm=mm),
        (_Size("mm", 5, 100),),
    ),
    "foam": Part(
        "all of it goes along with a press by this share",
        lambda now, share: _pressed(now, whole=share),
        (_Size("share", 0.05, 0.95),),
    ),
    "drag": Part(
        "skin that sticks to the face so far, then slips",
        lambda now, mm: replace(now, play_mm=mm),
        (_Size("mm", 0.1, 5),),
    ),
    "breath": Part("breathing, peak to peak", _breath, (_BREATH,), to=True),
    "organ": Part(
        "an organ that breathes under a wall that does less, and elsewhere",
        lambda now, mm, to: _breath(now, mm, to, organ=True),
        (_BREATH,),
        to=True,
    ),
    "pulse": Part("a pulse of .3 mm along the axis", lambda now: replace(now, pulse=True)),
    "ribs": Part(
        "ribs 8 mm deep with their shadows",
        lambda now, number: replace(now, ribs=number),
        (_SHADOWS,),
    ),
    "gas": Part(
        "as many pockets of gas 8 mm deep, whose shadows ring",
        lambda now, number: replace(now, ribs=number, gas=True),
        (_SHADOWS,),
    ),
    "contact": Part(
        "the face touches with this share of its width",
        lambda now, share: replace(now, contact=share),
        (_TOUCHING,),
    ),
    "peel": Part(
        "one side of the face comes off the skin to this share and back in 6 s",
        lambda now, share: replace(now, contact=share, peels=True),
        (_TOUCHING,),
    ),
    "layers": Part("strong layers every 3 mm, as in a muscle", lambda now: replace(now, layers=True)),
    "needle": Part("a needle that goes in and out", lambda now: replace(now, needle=True)),
    "convex": Part("a convex probe of 25 mm radius, ±20°, 3.5 MHz", lambda now: replace(now, convex=True)),
    "deep": Part("a picture 40 mm wide and 45 mm deep instead of 32 and 21", lambda now: replace(now, deep=True)),
    "persistence": Part(
        "a scanner that averages: this share of the last picture stays",
        lambda now, share: _processed(now, lambda one: replace(one, persistence=share)),
        (_Size("share", 0.05, 0.9),),
    ),
    "smoothing": Part(
        "a scanner that smooths speckle", lambda now: _processed(now, lambda one: replace(one, smoothed=True))
    ),
    "slow": Part(
        "a scanner of 15 Hz behind a grabber of 30 Hz", lambda now: _processed(now, lambda one: replace(one, repeats=2))
    ),
    "jpeg": Part(
        "a grabber that codes pictures with this quality",
        lambda now, quality: _processed(now, lambda one: replace(one, jpeg=quality)),
        (_Size("quality", 5, 100, whole=True),),
    ),
    "tracker": Part(
        "a tracker that errs by place (standard deviation of each axis, and .4° per mm)",
        lambda now, mm: replace(now, tracker_mm=mm),
        (_Size("mm", 0.05, 2),),
    ),
}
"""Every part that exists. Ranges leave out what no patient has and what the renderer cannot show."""


def listed() -> str:
    """Returns the parts that exist, for a message."""
    forms = ", ".join(part.form(name) for name, part in PARTS.items())
    return f"{forms}; TO is one of {', '.join(DIRECTIONS)}; join them by +"


def described() -> list[tuple[str, str]]:
    """Returns (form, what) of each part, for a page or a help text."""
    return [(part.form(name), "; ".join([part.what, *map(str, part.sizes)])) for name, part in PARTS.items()]


def surroundings(name: str) -> Surroundings:
    """Returns the surroundings of a name. Raises ConfigurationError for an unknown name."""
    now, given = Surroundings(), set()
    for one in name.split("+"):
        head, *rest = one.split("-")
        if head in given:
            raise _refusal(name, f"has '{head}' twice")
        given.add(head)
        now = _changed(now, name, one, head, rest)
    return now


def _changed(now: Surroundings, name: str, one: str, head: str, rest: list[str]) -> Surroundings:
    part = PARTS.get(head)
    if part is None:
        raise _refusal(name, f"has no part '{one}'")
    if len(rest) != len(part.sizes) + part.to or (part.to and rest[-1] not in DIRECTIONS):
        raise _refusal(name, f"should have {part.form(head)} for '{one}'")
    try:
        sizes = [size.read(text) for size, text in zip(part.sizes, rest, strict=False)]
    except ValueError:
        ranges = ", ".join(map(str, part.sizes))
        raise _refusal(name, f"has a number out of range in '{one}' ({ranges})") from None
    return part.change(now, *sizes, *rest[len(part.sizes) :])


def _refusal(name: str, what: str) -> ConfigurationError:
    return ConfigurationError(f"the world '{name}' {what}", "simulated world", f"Use {listed()}")
