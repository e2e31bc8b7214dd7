"""A stretched or shifted convex picture is named within a second; what is healthy, or hidden, is not."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest

from probewatch.appliance.core.detectors.fan_watch import FanWatch
from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration, Check, Fault, VerdictKind
from probewatch.drivers.recordings.replay import open_recording
from probewatch.drivers.samples import Frame, GreyImage
from probewatch.tools.study.samples import rendered
from probewatch.tools.study.session import Session
from tests.support.fans import HEIGHT, STYLES, WIDTH, FanStyle, fan_picture
from tests.support.kept_pictures import sessions
from tests.support.picture_breaks import Other
from tests.support.recordings import in_vivo_file

REFERENCE = Calibration(np.eye(3), (1, 1), np.array([0.3, 0.3]), np.zeros(3), (WIDTH, HEIGHT))
NAMED_S = 1.0


class Watched:
    """The detector, fed by hand: what motion says is stated here."""

    def __init__(
        self, reference: Calibration = REFERENCE, fps: float = 30.0, motion: Callable[[], Sequence[Check]] = tuple
    ) -> None:
        self.detector = FanWatch(reference, Limits(), motion)
        self.count, self._fps = 0, fps
        self.changed: list[float] = []

    @property
    def t_s(self) -> float:
        return self.count / self._fps

    @property
    def t_ns(self) -> int:
        return 1_000_000_000 + round(1e9 * self.t_s)

    def see(self, image: GreyImage, repeated: bool = False) -> dict[str, Check]:
        self.count += 1
        if self.detector.see(Observation(self.t_ns, image, repeated, followed=True)):
            self.changed.append(self.t_s)
        return {check.name: check for check in self.detector.checks()}

    def shown(self, shows: Callable[[Fault], bool] = lambda _: True) -> None:
        self.detector.on_verified(shows, self.t_ns)

    def learn(self, show: Callable[[int], GreyImage], seconds: float = 1.5) -> None:
        for k in range(round(seconds * self._fps)):
            self.see(show(k))
        self.shown()

    def named(self, show: Callable[[int], GreyImage], seconds: float = NAMED_S) -> Check | None:
        """The first FAULT within this time."""
        for k in range(round(seconds * self._fps)):
            for check in self.see(show(k)).values():
                if check.verdict is VerdictKind.FAULT:
                    return check
        return None


def pictures(style: FanStyle, many: int = 4) -> Callable[[int], GreyImage]:
    """So many pictures in turn."""
    shown = [fan_picture(style, 1, k) for k in range(many)]
    return lambda k: shown[k % many]


def learned(style: FanStyle, reference: Calibration = REFERENCE) -> Watched:
    watched = Watched(reference)
    watched.learn(pictures(style))
    told = watched.see(fan_picture(style, 1, 5))
    assert {check.verdict for check in told.values()} == {VerdictKind.OK}
    assert {"fan-stretch", "fan-shift"} <= set(told)
    assert not watched.changed
    return watched


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize(
    ("stretch", "shift_px", "name", "value"),
    [
        ((1.01, 1.0), (0.0, 0.0), "fan-stretch", 1.0),
        ((1.0, 0.99), (0.0, 0.0), "fan-stretch", -1.0),
        ((1.01, 1.01), (0.0, 0.0), "fan-stretch", 1.0),
        ((0.9, 0.9), (0.0, 8.0), "fan-stretch", -10.0),
        ((1.0, 1.0), (5.0, 0.0), "fan-shift", 5.0),
        ((1.0, 1.0), (0.0, -5.0), "fan-shift", -5.0),
    ],
)
def test_what_a_grabber_does_is_named_within_a_second_and_ends_what_was_shown(
    style: FanStyle, stretch: tuple[float, float], shift_px: tuple[float, float], name: str, value: float
) -> None:
    watched = learned(style)
    found = watched.named(pictures(style.changed(stretch, shift_px)))
    assert found is not None
    assert len(watched.changed) == 1
    assert found.fault is Fault.SCALE
    told = {check.name: check for check in watched.detector.checks()}[name]
    assert told.value == pytest.approx(value, abs=max(4 * told.sigma, 0.15))


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("zoom", [1.1, 0.9])
def test_another_depth_is_named_within_a_second(style: FanStyle, zoom: float) -> None:
    watched = learned(style)
    found = watched.named(pictures(style.deeper(zoom)))
    assert found is not None
    assert found.fault is Fault.SCALE


@pytest.mark.parametrize(
    ("stretch", "moved"),
    [((1.01, 1.0), 0.0), ((1.0, 0.99), 0.0), ((0.9, 0.9), 0.0), ((1.1, 1.1), 0.0), ((1.0, 1.0), 5 / 739)],
)
def test_a_patients_liver_is_no_change_and_a_changed_grabber_is(stretch: tuple[float, float], moved: float) -> None:
    path = in_vivo_file("liver-first-half.igs.mha")
    images = [sample.image for sample in open_recording(path).samples() if isinstance(sample, Frame)]
    size_px = images[0].shape[::-1]
    watched = Watched(replace(REFERENCE, image_size_px=(size_px[0], size_px[1])), fps=23.0)
    watched.learn(lambda k: images[k], 2.0)
    told = [watched.see(image) for image in images[46:]]
    assert all(check.verdict is VerdictKind.OK for checks in told for check in checks.values())
    assert all(set(checks) == {"fan-stretch", "fan-shift"} for checks in told)
    changed = Other(zoom=stretch, moved=moved)
    assert watched.named(lambda k: changed.of(images[69 - k])) is not None


def test_nothing_is_said_before_motion_has_shown_the_scales_and_motion_answers_a_fault() -> None:
    style = STYLES[0]
    watched = Watched()
    for k in range(60):
        assert watched.see(fan_picture(style, 1, k % 4)) == {}
    watched.shown(lambda _: False)
    assert watched.see(fan_picture(style, 1, 0)) == {}
    watched.shown(lambda fault: fault is Fault.SCALE)
    assert {check.verdict for check in watched.see(fan_picture(style, 1, 0)).values()} == {VerdictKind.OK}
    shifted = pictures(style.changed((1.0, 1.0), (6.0, 0.0)))
    assert watched.named(shifted) is not None
    watched.shown(lambda fault: fault is Fault.SCALE)
    assert watched.see(shifted(0))["fan-shift"].verdict is VerdictKind.FAULT, "motion has not shown the offset"
    watched.shown()
    assert {check.verdict for check in watched.see(shifted(1)).values()} == {VerdictKind.OK}


def test_motion_from_before_the_change_does_not_answer_for_it() -> None:
    watched = learned(STYLES[0])
    before_ns = watched.t_ns
    assert watched.named(pictures(STYLES[0].changed((1.02, 1.02)))) is not None
    watched.detector.on_verified(lambda _: True, before_ns)
    assert any(check.verdict is VerdictKind.FAULT for check in watched.detector.checks())


def test_a_change_that_is_undone_is_no_fault_any_more_and_both_end_what_was_shown() -> None:
    watched = learned(STYLES[0])
    assert watched.named(pictures(STYLES[0].changed((1.02, 1.02)))) is not None
    for k in range(30):
        told = watched.see(fan_picture(STYLES[0], 1, k % 4))
    assert {check.verdict for check in told.values()} == {VerdictKind.OK}
    assert len(watched.changed) == 2


def test_a_hidden_fan_is_said_and_not_guessed() -> None:
    style = replace(STYLES[0], floor_grey=0.0)
    watched = learned(style)
    half = pictures(replace(style, hidden=((0.0, 40.0, 0.0),)))
    assert watched.named(half, 3.0) is None
    told = watched.see(half(0))
    assert np.isnan(told["fan-stretch"].value)
    assert {check.verdict for check in told.values()} == {VerdictKind.NOT_VERIFIED}
    for _ in range(15):
        told = watched.see(fan_picture(style, 1, 0))
    assert {check.verdict for check in told.values()} == {VerdictKind.OK}
    assert not watched.changed


def test_a_fan_that_is_gone_for_long_is_forgotten_and_another_is_learned() -> None:
    watched = learned(STYLES[0])
    other = pictures(STYLES[2])
    assert watched.named(other, 14.0) is None
    assert watched.detector.checks() == ()
    watched.shown()
    assert {check.verdict for check in watched.see(other(0)).values()} == {VerdictKind.OK}


def test_a_narrower_sector_and_a_dark_depth_are_no_change() -> None:
    style = replace(STYLES[0], floor_grey=0.0)
    for healthy in (
        replace(style, left_deg=24.0, right_deg=24.0),
        replace(style, hidden=((-90.0, 90.0, 0.7),)),
        replace(style, hidden=((20.0, 40.0, 0.2),)),
        replace(style, fades=-0.5),
    ):
        watched = learned(style)
        assert watched.named(pictures(healthy), 2.0) is None
        assert not watched.changed


def test_gain_menus_and_words_beside_are_no_change() -> None:
    style = STYLES[0]
    watched = learned(style)
    for k in range(90):
        image = fan_picture(style, 1, k % 4, gain=(1.0, 0.5, 1.6)[k // 20 % 3])
        if k // 20 % 2:
            cv2.rectangle(image, (500, 60), (639, 300), 50, -1)
            for row in range(80, 300, 18):
                cv2.putText(image, "Persist 3", (506, row), cv2.FONT_HERSHEY_PLAIN, 0.9, 220, 1)
        assert not any(check.verdict is VerdictKind.FAULT for check in watched.see(image).values())
    assert not watched.changed


def test_a_fan_that_is_stored_upside_down_is_watched_too() -> None:
    watched = Watched(replace(REFERENCE, polarity=(1, -1)))
    show, other = pictures(STYLES[0]), pictures(STYLES[0].changed((1.0, 1.0), (0.0, 5.0)))
    watched.learn(lambda k: np.asarray(show(k)[::-1]))
    assert set(watched.see(np.asarray(show(0)[::-1]))) == {"fan-stretch", "fan-shift"}
    assert watched.named(lambda k: np.asarray(other(k)[::-1])) is not None


def test_repeated_pictures_and_black_ones_say_nothing() -> None:
    watched = learned(STYLES[0])
    other = pictures(STYLES[0].changed((1.1, 1.1)))
    for k in range(30):
        watched.see(other(k), repeated=True)
    assert watched.named(lambda _: np.zeros((HEIGHT, WIDTH), np.uint8), 3.0) is None
    assert not watched.changed


def motion(lateral_percent: float, axial_percent: float) -> tuple[Check, ...]:
    """What a solution says of the scales."""
    values = (("scale-lateral", lateral_percent), ("scale-axial", axial_percent))
    return tuple(Check(name, Fault.SCALE, value, 0.5, "%", 5.0, VerdictKind.OK) for name, value in values)


@pytest.mark.parametrize("style", STYLES)
def test_the_radius_of_the_face_gives_the_scales_without_motion(style: FanStyle) -> None:
    scales = np.array([style.aspect * 0.3, 0.3])
    right = replace(REFERENCE, scale_mm_per_px=scales, face_radius_mm=0.3 * style.face_px)
    for factors, verdict in (
        ((1.0, 1.0), VerdictKind.OK),
        ((1.15, 1.15), VerdictKind.FAULT),
        ((1.0, 0.85), VerdictKind.FAULT),
    ):
        watched = Watched(replace(right, scale_mm_per_px=scales * factors))
        for k in range(30):
            told = watched.see(fan_picture(style, 1, k % 4))
        assert set(told) == {"fan-scale"}
        assert told["fan-scale"].verdict is verdict
        wanted = 100 * (1 / min(factors, key=lambda one: -abs(1 / one - 1)) - 1)
        assert told["fan-scale"].value == pytest.approx(wanted, abs=3 * told["fan-scale"].sigma)


@pytest.mark.parametrize(("axial_percent", "verdict"), [(0.5, VerdictKind.OK), (14.0, VerdictKind.NOT_VERIFIED)])
def test_it_says_whether_motion_agrees_and_that_never_fails(axial_percent: float, verdict: VerdictKind) -> None:
    style = STYLES[0]
    watched = Watched(replace(REFERENCE, face_radius_mm=0.3 * style.face_px), motion=lambda: motion(0.0, axial_percent))
    for k in range(30):
        watched.see(fan_picture(style, 1, k % 4))
    watched.shown(lambda _: False)
    told = watched.see(fan_picture(style, 1, 0))
    assert told["fan-scale"].verdict is VerdictKind.OK
    assert told["fan-motion"].verdict is verdict
    assert told["fan-motion"].fault is Fault.AGREEMENT
    assert told["fan-motion"].value == pytest.approx(-axial_percent, abs=3)


HIDDEN = {
    "in-plane:convex+contact-0.6": 0.0,
    "in-plane:convex+peel-0.6": 0.1,
    "in-plane:convex+ribs-2": 0.3,
    "hold:convex+organ-8-axial+peel-0.6": 0.1,
    "in-plane:still+peel-0.6": 0.1,
}
"""Session and tissue whose fan is hidden, with the share of the pictures in which it is seen at most."""

HEALTHY = (
    *("gesture:convex", "in-plane:convex", "mixed:convex", "elevational-20:convex", "hold:convex", "fan:convex"),
    *(f"in-plane:convex+{part}" for part in ("ribs-1", "gas-1", "gas-2")),
    *(f"in-plane:convex+{part}" for part in ("smoothing", "jpeg-40", "persistence-0.6", "slow", "needle", "layers")),
    *("mixed:convex+ribs-1+jpeg-40+slow", "in-plane:still", *HIDDEN),
)
"""Session and tissue. The sector of `still` is round in pixels, and its apex as far."""


@pytest.mark.parametrize(
    "duration_s", [pytest.param(10.0, marks=pytest.mark.thorough), pytest.param(30.0, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("one", HEALTHY)
def test_no_healthy_session_is_named(one: str, duration_s: float) -> None:
    """The session as it is and with a gain that wanders."""
    name, _, tissue = one.partition(":")
    session = Session(name, tissue, 2, duration_s)
    images = rendered(session, sessions())
    for gained in (False, True):
        watched, visible = Watched(session.reference), 0
        for k, image in enumerate(images):
            gain = (1.0, 1.4, 0.6, 0.4)[k // 45 % 4] if gained else 1.0
            told = watched.see(np.asarray(cv2.convertScaleAbs(image, alpha=gain), np.uint8))
            assert not any(check.verdict is VerdictKind.FAULT for check in told.values())
            visible += any(not np.isnan(check.value) for check in told.values())
            if k % 10 == 9:
                watched.shown()
        assert not watched.changed
        share = visible / len(images)
        assert share <= HIDDEN[one] if one in HIDDEN else share > 0.8, share


@pytest.mark.thorough
@pytest.mark.parametrize("tissue", ["convex", "convex+gas-1", "convex+jpeg-40", "convex+slow"])
def test_changes_are_named_in_simulated_sessions(tissue: str) -> None:
    session = Session("in-plane", tissue, 2, 30.0)
    images = rendered(session, sessions())
    for zoom, moved in (
        ((1.01, 1.0), 0.0),
        ((1.0, 1.013), 0.0),
        ((0.9, 0.9), 0.0),
        ((1.1, 1.1), 0.0),
        ((1.0, 1.0), 0.0125),
    ):
        for since in (60, 200, 407, 633):
            watched = Watched(session.reference)
            watched.learn(lambda k: images[k], since / 30)
            changed = Other(zoom=zoom, moved=moved)
            found = watched.named(lambda k: changed.of(images[since + k]))  # noqa: B023
            assert found is not None, (zoom, moved, since)
