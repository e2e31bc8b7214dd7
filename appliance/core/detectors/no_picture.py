"""Watches whether live pictures show tissue: speckle, or echoes in water. Black, noise, test cards, menus and desktops
do not.
"""

from itertools import cycle
from math import exp

from probewatch.appliance.core.detectors.detector import Detector
from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.core.registration.texture import Texture, TextureReader
from probewatch.appliance.types import Check, Fault, VerdictKind
from probewatch.drivers.samples import GreyImage

REPORTS_FAULTS = (Fault.NO_PICTURE,)

_SMALL_ROWS, _ASKED, _ASKED_OF_SMALL = 200, 1.0, 0.4
"""Rows below which a picture is small, and `Texture.tissue` from which a picture, and a small one, shows tissue. Less
is asked of a small one, because speckle is 1 or 2 px wide in it, and at 160 × 120 the tissue of 256 lines falls below
0.65 in one picture in ten (the share that must have it is `_STEADY`). Black, noise, snow and flat greys came
to 0 there, bars to 0.25. What this trades: below 200 rows menus (up to 2.2) and letters (up to 1.3) may be taken for
tissue, and so may noise from a JPEG, once in eighty (tests/appliance/core/detectors/test_no_picture.py)."""
_LIMIT_NS = 500_000_000
"""Time, ns, without steady tissue after which the hazard is named. With a longer one it is named later than within a
second; with a shorter one a cough is an alarm."""
_MEMORY_NS, _STEADY = 250_000_000, 0.75
"""Memory, ns, and share above which tissue is steady: that of recent pictures with tissue, weighted by exp(−age ÷
memory). Steady tissue is back 0.35 s after nothing, and gone after 0.07 s. If every second picture is blank, tissue is
not steady; if every seventh or fewer are, it is; what lies between depends on the rate. A longer memory decides better,
and is slower to take tissue back."""
_SHORTEST_NS, _LONGEST_NS = 20_000_000, 250_000_000
"""Shortest and longest time, ns, that one picture may stand for. The longest keeps a pause, which another detector
reports, out of the account; the shortest goes to pictures without tissue whose stamps do not advance, so that such a
stream fails as well."""
_FAST_NS, _IN_TURN = 45_000_000, (2, 3)
"""Period of the video, ns, below which only every second and every third picture in turn is judged, to spare the
processor; equal steps could see only one phase of a flicker. The judgement stands until the next one."""


class NoPicture(Detector):
    """Measures for how long tissue has not been seen steadily.

    texture: that of the latest picture that was judged, None before the first.
    """

    def __init__(self) -> None:
        self._before_ns: int | None = None
        self._reader = TextureReader()
        self._turns = cycle(_IN_TURN)
        self._passed_over = 0
        self._recent = 0.0
        self._without_ns = 0
        self.texture: Texture | None = None

    def see(self, seen: Observation) -> bool:
        """See Detector."""
        self.step(seen.t_ns, seen.image)
        return False

    def checks(self) -> tuple[Check, ...]:
        """Returns the time without steady tissue, ms, as one check; none where no picture was judged."""
        if self.texture is None:
            return ()
        verdict = VerdictKind.NOT_VERIFIED if self._without_ns > _LIMIT_NS else VerdictKind.OK
        return (Check("no-picture", Fault.NO_PICTURE, self._without_ns / 1e6, 0.0, "ms", _LIMIT_NS / 1e6, verdict),)

    def step(self, t_ns: int, image: GreyImage) -> Check:
        """Takes the next picture, (h, w) uint8, of t_ns; returns the one check."""
        since_ns = 0 if self._before_ns is None else t_ns - self._before_ns
        self._before_ns = t_ns
        asked = _ASKED if image.shape[0] >= _SMALL_ROWS else _ASKED_OF_SMALL
        seen = self._judged(since_ns, image).tissue >= asked
        # Tissue in a picture whose stamp has not advanced is no evidence, so that it adds no time.
        for_ns = min(max(since_ns, 0 if seen else _SHORTEST_NS), _LONGEST_NS)
        self._recent = seen + (self._recent - seen) * exp(-for_ns / _MEMORY_NS)
        self._without_ns = 0 if self._recent > _STEADY else self._without_ns + for_ns
        return self.checks()[0]

    def _judged(self, since_ns: int, image: GreyImage) -> Texture:
        self._passed_over -= 1
        if self.texture is None or self._passed_over <= 0 or since_ns >= _FAST_NS:
            self.texture = self._reader.read(image)
            self._passed_over = next(self._turns)
        return self.texture
