"""A change of depth is told from the scanner's own ruler; nothing else is taken for one."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.stats import beta

from probewatch.appliance.core.detectors.depth_ruler import DepthRuler
from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.types import Check, Fault, VerdictKind
from probewatch.drivers.recordings.replay import open_recording
from probewatch.drivers.samples import Frame, GreyImage
from tests.support.recordings import plus_file
from tests.support.rulers import HEIGHT, STYLES, TISSUE, WIDTH, Style, grabbed, picture

THOROUGH = pytest.mark.thorough
MASK = np.zeros((HEIGHT, WIDTH), np.bool_)
MASK[TISSUE] = True
GRABBERS = ((0.0, 0.0, 0), (5.0, 0.7, 0), (3.0, 0.6, 75), (8.0, 0.0, 0))


class Watched:
    """The detector, fed by hand: what the registration and the motion say is stated here."""

    def __init__(self, mask: np.ndarray | None = MASK) -> None:
        self.detector = DepthRuler(lambda: mask, 5.0, 3.0)
        self.changed = False
        self._count = 0

    def see(self, image: GreyImage, repeated: bool = False) -> Check | None:
        self._count += 1
        self.changed = self.detector.see(Observation(self._count * 33_000_000, image, repeated, followed=True))
        return next(iter(self.detector.checks()), None)

    def shown(self, shows: Callable[[Fault], bool], pictures_ago: int = 0) -> None:
        """Motion up to so many pictures ago shows these classes to be absent."""
        self.detector.on_verified(shows, (self._count - pictures_ago) * 33_000_000)

    def learn(self, show: Callable[[int], GreyImage], pictures: int = 20) -> Check | None:
        for k in range(pictures):
            self.see(show(k))
        self.shown(lambda fault: fault is Fault.SCALE)
        return next(iter(self.detector.checks()), None)


def learned(style: Style, seed: int = 1) -> Watched:
    watched = Watched()
    check = watched.learn(lambda k: picture(style, seed, k))
    assert check is not None
    assert (check.name, check.fault, check.value, check.verdict) == ("depth-ruler", Fault.SCALE, 0.0, VerdictKind.OK)
    return watched


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("zoom", [1.03, 0.97, 1.1])
def test_the_first_picture_withdraws_and_the_second_names_the_scale(style: Style, zoom: float) -> None:
    watched = learned(style)
    first = watched.see(picture(style, 1, 100, zoom))
    assert watched.changed
    assert first is not None
    assert first.verdict is VerdictKind.NOT_VERIFIED
    second = watched.see(picture(style, 1, 101, zoom))
    assert not watched.changed
    assert second is not None
    assert (second.fault, second.verdict) == (Fault.SCALE, VerdictKind.FAULT)
    assert second.value == pytest.approx(100 * (zoom - 1), abs=max(3 * second.sigma, 0.1))


def test_one_picture_alone_names_nothing_and_the_depth_before_is_no_fault() -> None:
    watched = learned(STYLES[0])
    watched.see(picture(STYLES[0], 1, 100, 1.1))
    back = watched.see(picture(STYLES[0], 1, 101))
    assert watched.changed
    assert back is not None
    assert (back.value, back.verdict) == (0.0, VerdictKind.OK)


def test_nothing_is_said_before_motion_has_shown_the_scales_and_motion_that_shows_them_answers_a_fault() -> None:
    watched = Watched()
    seen = [watched.see(picture(STYLES[0], 1, k, 1.0 if k < 25 else 1.1)) for k in range(30)]
    assert seen == [None] * 30
    watched.shown(lambda _: False)
    assert watched.see(picture(STYLES[0], 1, 40, 1.1)) is None
    watched.shown(lambda fault: fault is Fault.SCALE)
    for k in range(2):
        fault = watched.see(picture(STYLES[0], 1, 50 + k))
    assert fault is not None
    assert fault.verdict is VerdictKind.FAULT
    watched.shown(lambda fault: fault is Fault.SCALE)
    assert [check.verdict for check in watched.detector.checks()] == [VerdictKind.OK]


def test_motion_from_before_a_small_change_of_depth_does_not_answer_for_it() -> None:
    watched = learned(STYLES[0])
    for k in range(3):
        small = watched.see(picture(STYLES[0], 1, 50 + k, 1.015))
    assert not watched.changed
    assert small is not None
    watched.shown(lambda _: True, pictures_ago=5)
    assert watched.see(picture(STYLES[0], 1, 60, 1.015)) == small, "as far from the depth that motion has shown"
    watched.shown(lambda _: True)
    answered = watched.see(picture(STYLES[0], 1, 61, 1.015))
    assert answered is not None
    assert abs(answered.value) < abs(small.value) / 2


@pytest.mark.parametrize("ratio", [2.0, 2.5, 0.5])
def test_another_unit_of_the_ticks_withdraws_the_ok_and_names_nothing(ratio: float) -> None:
    style = Style(spacing_px=24.0 if ratio > 1 else 40.0, words=False, major=1)
    watched = learned(style)
    changed, checks = [], []
    for k in range(3):
        checks.append(watched.see(picture(style, 1, 100 + k, ratio)))
        changed.append(watched.changed)
    assert changed == [True, False, False]
    assert {check.verdict for check in checks if check is not None} == {VerdictKind.NOT_VERIFIED}


def test_a_menu_over_the_ruler_is_no_change_and_the_ruler_is_compared_again_when_it_goes() -> None:
    style = STYLES[0]
    watched = learned(style)
    for k in range(40):
        image = picture(style, 1, 100 + k)
        image[40:330, 380:] = 40
        for row in range(50, 330, 19):  # lines of a menu lie as regularly as ticks
            image[row, 380:] = 200
        assert watched.see(image) is None
        assert not watched.changed
    again = watched.see(picture(style, 1, 200))
    assert again is not None
    assert (again.value, again.verdict, watched.changed) == (0.0, VerdictKind.OK, False)
    for k in range(2):
        found = watched.see(picture(style, 1, 201 + k, 1.04))
    assert found is not None
    assert found.verdict is VerdictKind.FAULT


def test_repeated_pictures_and_another_screen_say_nothing() -> None:
    watched = learned(STYLES[0])
    watched.see(picture(STYLES[0], 1, 100, 1.1), repeated=True)
    assert not watched.changed
    black = np.zeros((HEIGHT, WIDTH), np.uint8)
    assert watched.see(black) is None
    assert not watched.changed
    assert watched.see(np.full_like(black, 255)) is None
    striped = black.copy()
    striped[::12] = 255
    assert watched.see(striped) is None
    assert not watched.changed


def test_a_focus_mark_a_missing_tick_and_a_curve_beside_change_nothing() -> None:
    style = STYLES[0]
    watched = learned(style)
    for k in range(60):
        image = picture(style, 1, 100 + k)
        cv2.drawMarker(image, (442, 60 + 4 * k), 220, cv2.MARKER_TRIANGLE_UP, 9, 1)
        image[150:156, 430:450] = 0
        cv2.line(image, (425 + k % 20, 20), (455, 340), 150, 1)
        check = watched.see(image)
        assert not watched.changed
        assert check is None or check.verdict is VerdictKind.OK


@pytest.mark.parametrize("mask", [None, np.zeros((10, 10), np.bool_)])
def test_without_a_mask_of_this_picture_nothing_is_looked_for(mask: np.ndarray | None) -> None:
    assert Watched(mask).learn(lambda k: picture(STYLES[0], 1, k)) is None


def test_pictures_without_a_ruler_have_none() -> None:
    bare = replace(STYLES[0], grey=0, words=False)
    assert Watched().learn(lambda k: picture(bare, 1, k), 60) is None
    assert Watched(np.zeros_like(MASK)).learn(lambda k: picture(bare, 1, k), 60) is None
    noise = Watched(np.zeros_like(MASK))
    assert noise.learn(lambda k: np.random.default_rng(k).integers(0, 256, MASK.shape, np.uint8), 60) is None


def test_a_ruler_that_the_scanner_moved_is_learned_anew_and_first_says_nothing() -> None:
    watched = learned(STYLES[0])
    moved = replace(STYLES[0], column=30, to_left=False)
    seen = [watched.see(picture(moved, 1, k, 1.1)) for k in range(340)]
    assert set(seen) == {None}
    watched.shown(lambda fault: fault is Fault.SCALE)
    for k in range(2):
        found = watched.see(picture(moved, 1, 400 + k))
    assert found is not None
    assert found.verdict is VerdictKind.FAULT


def test_a_large_picture_is_searched_in_bands_and_its_ruler_found() -> None:
    def large(k: int, zoom: float = 1.0) -> GreyImage:
        image = np.zeros((1080, 1920), np.uint8)
        image[np.round(np.arange(40, 1060, 30.4 * zoom)).astype(int), 1700:1712] = 200
        return image

    watched = Watched(np.zeros((1080, 1920), np.bool_))
    assert watched.learn(large, 130) is not None
    for k in range(2):
        found = watched.see(large(k, 1.03))
    assert found is not None
    assert found.verdict is VerdictKind.FAULT


def least_share(hits: int, runs: int) -> float:
    """Lower end of the 95 % interval of Clopper and Pearson."""
    return float(beta.ppf(0.025, hits, runs - hits + 1)) if hits else 0.0


def a_style(random: np.random.Generator) -> Style:
    """Any ruler with at least six ticks in view after a change of 10 %."""
    short = int(random.integers(3, 9))
    return Style(
        spacing_px=float(random.uniform(9.5, 52)),
        top_px=float(random.uniform(12, 30)),
        column=int(random.choice([random.integers(10, 66), random.integers(405, 450)])),
        short_px=short,
        long_px=short + int(random.integers(0, 8)),
        major=int(random.choice([2, 5, 10])),
        to_left=bool(random.integers(2)),
        grey=int(random.integers(90, 256)),
        thick_px=float(random.choice([1.0, 1.5, 2.0])),
        words=bool(random.integers(2)),
    )


@THOROUGH
@pytest.mark.parametrize("percent", [3, -3, 5, -5, 10, -10])
def test_changes_of_depth_are_named_by_the_second_picture_over_many_rulers(percent: int) -> None:
    """15 rulers on each of four grabbers: of those that were found, which are nearly all, all changes are named."""
    runs = 60
    found = named = 0
    z = []
    for seed in range(100 * abs(percent), 100 * abs(percent) + runs):
        style, grabber = a_style(np.random.default_rng((seed, 11))), GRABBERS[seed % 4]
        watched = Watched()
        if watched.learn(lambda k: grabbed(picture(style, seed, k), seed, k, *grabber), 22) is None:  # noqa: B023
            continue
        found += 1
        check = None
        for k in range(100, 102):
            check = watched.see(grabbed(picture(style, seed, k, 1 + percent / 100), seed, k, *grabber))
        if check is not None and check.verdict is VerdictKind.FAULT:
            named += 1
            z.append((check.value - percent) / check.sigma)
    print(f"{percent:+} %: found {found} of {runs}, named {named}, RMS z {np.sqrt(np.mean(np.square(z))):.2f}")
    assert least_share(found, runs) > 0.85
    assert least_share(named, found) > 0.9
    assert np.sqrt(np.mean(np.square(z))) < 1.2


@THOROUGH
def test_half_an_hour_of_gain_noise_menus_and_marks_names_nothing() -> None:
    """60 000 pictures, half an hour at 30 Hz: gain and TGC wander, menus come and go, a focus mark travels."""
    faults = withdrawn = pictures = 0
    for seed in range(30):
        random = np.random.default_rng((seed, 13))
        style, grabber = a_style(random), GRABBERS[seed % 4]
        drawn = [picture(style, seed, k, tissue=float(random.uniform(20, 110))) for k in range(8)]
        shown = [grabbed(image, seed, k, *grabber) for k, image in enumerate(drawn)]
        watched = Watched()
        watched.learn(lambda k: shown[k % 8], 30)  # noqa: B023
        for k in range(2000):
            image = shown[int(random.integers(8))]
            event = (k // 40) % 5
            if event:
                image = image.copy()
                _disturb(image, event, k, style.column)
            check = watched.see(image)
            pictures += 1
            withdrawn += watched.changed
            faults += check is not None and check.verdict is VerdictKind.FAULT
    print(f"{pictures} pictures: {faults} faults, {withdrawn} withdrawn")
    assert faults == 0
    assert withdrawn == 0


def _disturb(image: GreyImage, event: int, k: int, column: int) -> None:
    if event == 1:
        left = max(column - 60, 0)
        image[30:330, left : left + 120] = 50
        for row in range(44, 330, 17 + (k // 200) % 9):
            cv2.putText(image, "Persist 3", (left + 6, row), cv2.FONT_HERSHEY_PLAIN, 0.8, 220, 1)
            image[row + 4, left : left + 120] = 160
    elif event == 2:
        cv2.drawMarker(image, (column, 20 + k % 300), 220, cv2.MARKER_TRIANGLE_UP, 9, 1)
    elif event == 3:
        cv2.line(image, (column - 20 + k % 40, 20), (column + 10, 340), 150, 1)
    else:
        image[TISSUE] = np.clip(image[TISSUE] * 1.5, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("name", ["fCal_Test_Validation_3NWires_fCal2.0.igs.mha", "NwirePhantomFreehand.igs.mha"])
def test_recordings_without_an_overlay_show_no_ruler(name: str) -> None:
    """Wires in water, and black beside: whatever is taken for still, no row of ticks is found among it."""
    frames = [sample for sample in open_recording(plus_file(name)).samples() if isinstance(sample, Frame)]
    watched = Watched(np.zeros(frames[0].image.shape, np.bool_))
    assert watched.learn(lambda k: frames[k].image, len(frames) // 2) is None


def test_marks_that_turn_out_to_be_tissue_are_no_ruler() -> None:
    """At rest speckle is as still as a ruler; once it has moved, neither its loss nor its return says anything."""
    mask = MASK.copy()
    watched = Watched(mask)
    for k in range(30):
        watched.see(picture(STYLES[0], 1, k))
    mask[:] = True
    changes = []
    for k in range(30):
        watched.see(picture(STYLES[0], 1, 40 + k, 1.0 if k % 2 else 1.1))
        changes.append(watched.changed)
    assert not any(changes)
    watched.shown(lambda _: True)
    assert watched.detector.checks() == ()
