"""What shows tissue and what does not, and for how long it must not before that is a fault.

`pytest -s -m slow tests/appliance/core/detectors/test_no_picture.py` prints the table of values for every kind of
picture, over many seeds.
"""

from collections.abc import Callable, Iterator
from functools import cache
from itertools import cycle, islice
from zlib import crc32

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import betaincinv

from probewatch.appliance.core.detectors.no_picture import NoPicture
from probewatch.appliance.core.registration.texture import Texture, TextureReader
from probewatch.appliance.types import VerdictKind
from probewatch.drivers.recordings.replay import open_recording
from probewatch.drivers.samples import Frame, GreyImage
from probewatch.drivers.twins.scene.world import World, WorldSettings
from tests.support import no_tissue
from tests.support.recordings import plus_file
from tests.support.scatterers import Array1D, Look, render

SIZES = ((480, 640), (120, 160), (240, 320), (616, 820), (720, 1280), (1080, 1920))
STEP_NS = 33_333_333

SCATTERERS: dict[str, tuple[Array1D, Look]] = {
    "curved array": (Array1D(), Look()),
    "linear array": (Array1D(fan_deg=0), Look()),
    "256 lines": (Array1D(lines=256, width_lines=1.2, depths=900), Look()),
    "96 lines": (Array1D(lines=96, width_lines=1.2, depths=400), Look()),
    "gain -20 dB": (Array1D(), Look(gain_db=-20)),
    "gain +20 dB": (Array1D(), Look(gain_db=20)),
    "noise -12 dB": (Array1D(), Look(noise_db=-12)),
    "40 dB shown": (Array1D(), Look(dynamic_db=40)),
    "90 dB shown": (Array1D(), Look(dynamic_db=90)),
    "a third in contact": (Array1D(), Look(contact=0.33)),
    "a third, noisy": (Array1D(fan_deg=0), Look(contact=0.33, noise_db=-25)),
    "half in shadow": (Array1D(), Look(shadow=0.5)),
    "five averaged": (Array1D(), Look(averaged=5, noise_db=-15)),
    "wide fan": (Array1D(fan_deg=45, lines=192), Look()),
    "small field": (Array1D(fan_deg=25, fills=0.6), Look()),
    "narrow field": (Array1D(fan_deg=0, fills=0.5), Look()),
}

CART: dict[str, WorldSettings] = {
    "as it comes": WorldSettings(),
    "no overlay": WorldSettings(overlay=False),
    "gain -25 dB": WorldSettings(gain_db=-25),
    "gain +25 dB": WorldSettings(gain_db=25),
    "noise -20 dB": WorldSettings(noise_db=-20),
    "noise -10 dB": WorldSettings(noise_db=-10),
    "40 dB shown": WorldSettings(range_db=40),
    "90 dB shown": WorldSettings(range_db=90),
    "30 dB lost with depth": WorldSettings(attenuation_db=30, noise_db=-25),
    "fine scale": WorldSettings(scale_mm_per_px=(0.04, 0.04)),
    "coarse scale": WorldSettings(scale_mm_per_px=(0.1, 0.099)),
    "320 x 240": WorldSettings(width_px=320, height_px=240),
}

RECORDINGS = (
    "fCal_Test_Validation_3NWires_fCal2.0.igs.mha",
    "NwirePhantomFreehand.igs.mha",
    "WaterTankBottomTranslationVideoBuffer.igs.mha",
)


def texture(image: GreyImage) -> Texture:
    return TextureReader().read(image)


def seeded(kind: str, seed: int) -> np.random.Generator:
    return np.random.default_rng((seed, crc32(kind.encode())))


def no_pictures(kind: str, count: int, seed: int) -> Iterator[GreyImage]:
    """Every second one 640 × 480, the others of any size."""
    random = seeded(kind, seed)
    for k in range(count):
        yield no_tissue.KINDS[kind](random, SIZES[k % 6] if k % 2 else no_tissue.VGA)


def scattered(kind: str, count: int, seed: int, sizes: tuple[tuple[int, int], ...]) -> Iterator[GreyImage]:
    random = seeded(kind, seed)
    for k in range(count):
        yield no_tissue.grabbed(random, render(random, sizes[k % len(sizes)], *SCATTERERS[kind]), 4.0)


def cart(look: WorldSettings, count: int, seed: int = 1) -> Iterator[GreyImage]:
    seen = World(seed, settings=look)
    for k in range(count):
        yield seen.frame(0.9 * k, k)


def lifted(share: float, seed: int = 1, index: int = 0) -> GreyImage:
    """The cart's picture with so much of the array in contact, from the left; beside it the receiver's noise."""
    seen = World(seed)
    touching = np.where(np.arange(640) < share * 640, 1, 0).astype(np.float32)
    echoes = (part * touching for part in seen.echoes_at(seen.trajectory.pose(0.9 * index)))
    grey = seen._compressed(*echoes, index) & seen._screen.sector
    return np.asarray(cv2.max(grey, seen._screen.text), np.uint8)


def recorded(name: str, every: int) -> Iterator[GreyImage]:
    recording = open_recording(plus_file(name), need_poses=False)
    for k, frame in enumerate(sample for sample in recording.samples() if isinstance(sample, Frame)):
        if k % every == 0:
            yield frame.image


@pytest.mark.parametrize("kind", no_tissue.KINDS)
def test_what_shows_no_tissue_is_no_picture(kind: str) -> None:
    assert max(texture(image).tissue for image in no_pictures(kind, 4, seed=1)) < 0.8


@pytest.mark.parametrize("kind", SCATTERERS)
def test_speckle_of_an_independent_rendering_is_a_picture(kind: str) -> None:
    assert min(texture(image).tissue for image in scattered(kind, 1, 1, SIZES[:1])) > 1.5


@pytest.mark.parametrize("name", CART)
def test_the_simulated_cart_shows_a_picture(name: str) -> None:
    assert min(texture(image).tissue for image in cart(CART[name], 1)) > 1.2


@pytest.mark.parametrize("size", SIZES)
def test_a_picture_of_any_size_is_one(size: tuple[int, int]) -> None:
    (image,) = cart(CART["as it comes"], 1)
    how = cv2.INTER_AREA if size[0] < 480 else cv2.INTER_LINEAR
    assert texture(np.asarray(cv2.resize(image, size[::-1], interpolation=how), np.uint8)).tissue > 2


def test_a_third_of_the_probe_in_contact_is_a_picture_and_none_of_it_is_not() -> None:
    assert texture(lifted(0.36)).tissue > 1.5
    assert not texture(lifted(0.36)).water
    assert texture(lifted(0.0)).tissue < 0.5


@pytest.mark.parametrize("name", RECORDINGS)
def test_real_recordings_in_water_are_pictures(name: str) -> None:
    detector = NoPicture()
    seen = [detector.step(k * 80_000_000, image) for k, image in enumerate(recorded(name, every=4))]
    assert {check.verdict for check in seen} == {VerdictKind.OK}
    assert detector.texture is not None
    assert detector.texture.tissue > 1.1
    assert detector.texture.water or "WaterTank" in name, "a wall may pass for speckle"


@pytest.mark.parametrize("size", [(1, 1), (5, 7), (20, 20), (3000, 1), (1, 3000)])
def test_a_picture_too_small_for_a_patch_shows_nothing(size: tuple[int, int]) -> None:
    assert texture(np.full(size, 200, np.uint8)).tissue == 0


def test_a_reader_of_pictures_of_different_sizes_says_the_same_as_a_new_one_of_each() -> None:
    reader = TextureReader()
    pictures = [no_tissue.menu(seeded("menu", k), SIZES[k % 4]) for k in range(6)]
    assert [reader.read(image) for image in pictures] == [texture(image) for image in pictures]


SMALL = (120, 160)
NOTHING = [kind for kind in no_tissue.KINDS if kind not in ("menu", "words on black", "desktop")]
"""Kinds that are told from tissue in small pictures too."""


def said_of(pictures: Iterator[GreyImage]) -> VerdictKind:
    """After a second and a half of them."""
    detector = NoPicture()
    return [detector.step(k * STEP_NS, image).verdict for k, image in enumerate(islice(pictures, 45))][-1]


@pytest.mark.parametrize("kind", NOTHING)
def test_a_small_picture_that_shows_nothing_is_no_picture(kind: str) -> None:
    random = seeded(kind, 3)
    shown = [no_tissue.KINDS[kind](random, SMALL) for _ in range(9)]
    assert said_of(cycle(shown)) is VerdictKind.NOT_VERIFIED


@pytest.mark.parametrize("kind", ["curved array", "256 lines", "gain +20 dB", "a third, noisy"])
def test_a_small_picture_of_tissue_is_a_picture(kind: str) -> None:
    assert said_of(cycle(list(scattered(kind, 5, 3, (SMALL,))))) is VerdictKind.OK


def blank() -> GreyImage:
    return np.zeros((60, 80), np.uint8)


@cache
def good() -> GreyImage:
    return render(np.random.default_rng(5), (240, 320))[60:150, 100:220]


def test_the_pictures_of_the_tests_in_time_are_what_they_claim() -> None:
    assert (texture(blank()).tissue, texture(good()).tissue > 2) == (0, True)


def verdicts(pictures: list[bool], step_ns: int = STEP_NS, detector: NoPicture | None = None) -> list[VerdictKind]:
    """Of good and blank pictures so far apart."""
    detector = detector or NoPicture()
    return [detector.step(k * step_ns, good() if seen else blank()).verdict for k, seen in enumerate(pictures)]


def first(kind: VerdictKind, of: list[VerdictKind]) -> int:
    return of.index(kind) if kind in of else 10**6


@pytest.mark.parametrize("rate_hz", [4, 5, 10, 12, 25, 30, 60])
def test_no_picture_is_named_within_a_second_and_a_picture_is_back_soon(rate_hz: int) -> None:
    step_ns = 10**9 // rate_hz
    said = verdicts([True] * 2 * rate_hz + [False] * 2 * rate_hz + [True] * 2 * rate_hz, step_ns)
    assert set(said[: 2 * rate_hz]) == {VerdictKind.OK}
    assert 0.4 <= (first(VerdictKind.NOT_VERIFIED, said) - 2 * rate_hz) / rate_hz <= 0.8
    back_s = first(VerdictKind.OK, said[4 * rate_hz :]) / rate_hz
    assert 0.2 <= back_s <= 0.5
    assert set(said[-rate_hz:]) == {VerdictKind.OK}


def test_a_stream_that_never_showed_tissue_is_named_within_a_second() -> None:
    assert first(VerdictKind.NOT_VERIFIED, verdicts([False] * 30)) * STEP_NS < 700_000_000


@pytest.mark.parametrize(
    ("good_ones", "blank_ones", "kind"),
    [
        (1, 1, VerdictKind.NOT_VERIFIED),
        (1, 11, VerdictKind.NOT_VERIFIED),
        (6, 1, VerdictKind.OK),
        (30, 3, VerdictKind.OK),
    ],
)
def test_flicker_is_no_picture_and_a_lone_bad_one_is_no_matter(
    good_ones: int, blank_ones: int, kind: VerdictKind
) -> None:
    said = verdicts([True] * 30 + ([True] * good_ones + [False] * blank_ones) * 12)
    assert said[-1] is kind
    assert kind is VerdictKind.NOT_VERIFIED or VerdictKind.NOT_VERIFIED not in said


def test_a_pause_of_the_video_is_not_counted() -> None:
    detector = NoPicture()
    verdicts([True] * 30, detector=detector)
    check = detector.step(30 * STEP_NS + 60_000_000_000, good())
    assert (check.verdict, check.value) == (VerdictKind.OK, 0.0)
    assert detector.step(200_000_000_000, blank()).verdict is VerdictKind.OK


def test_the_check_says_how_long_and_is_failed_beyond_its_limit() -> None:
    detector = NoPicture()
    checks = [detector.step(k * STEP_NS, blank()) for k in range(40)]
    assert all((check.ratio > 1) == (check.verdict is VerdictKind.NOT_VERIFIED) for check in checks)
    assert (checks[-1].name, checks[-1].fault, checks[-1].unit) == ("no-picture", "no-picture", "ms")
    assert checks[-1].value == pytest.approx(39 * STEP_NS / 1e6, abs=40)


@settings(max_examples=10)
@given(st.lists(st.integers(-(10**12), 10**12), min_size=60, max_size=60))
def test_blank_pictures_fail_whatever_their_stamps_are(stamps_ns: list[int]) -> None:
    detector = NoPicture()
    assert [detector.step(t_ns, blank()) for t_ns in stamps_ns][-1].verdict is VerdictKind.NOT_VERIFIED


@pytest.mark.parametrize("rate_hz", [10, 12, 15, 20, 24, 25, 30, 50, 60])
def test_every_second_picture_blank_is_named_at_any_rate(rate_hz: int) -> None:
    step_ns = 10**9 // rate_hz
    said = verdicts([True] * rate_hz + [True, False] * rate_hz, step_ns)
    assert (first(VerdictKind.NOT_VERIFIED, said) - rate_hz) / rate_hz < 1.2


def test_good_pictures_with_stamps_that_stand_still_bring_nothing_back() -> None:
    detector = NoPicture()
    verdicts([False] * 30, detector=detector)
    assert {detector.step(0, good()).verdict for _ in range(30)} == {VerdictKind.NOT_VERIFIED}


def at_most(errors: int, of: int) -> float:
    """Upper end of the exact 95 % interval, one-sided."""
    return 1.0 if errors == of else float(betaincinv(errors + 1, of - errors, 0.95))


def row(kind: str, values: list[float], wrong: Callable[[float], bool]) -> tuple[int, int]:
    errors = sum(map(wrong, values))
    low, middle, high = np.percentile(values, [0, 50, 100])
    print(f"{kind:40s} {low:5.2f} {middle:5.2f} {high:5.2f} {errors:4d} of {len(values)}", end="")
    print(f"  at most {100 * at_most(errors, len(values)):.2f} %")
    return errors, len(values)


@pytest.mark.slow
def test_few_pictures_without_tissue_are_taken_for_some() -> None:
    """Per picture; a stream passes only if three in four do."""
    print("\nno tissue: least, median, most of what makes a picture from 1 on; wrong ones")
    told = [
        row(kind, [texture(image).tissue for image in no_pictures(kind, 240, seed=2)], lambda value: value >= 1)
        for kind in no_tissue.KINDS
    ]
    errors, of = np.sum(told, axis=0)
    assert at_most(int(errors), int(of)) < 0.01
    assert all(errors <= 0.03 * of for errors, of in told)


@pytest.mark.slow
def test_few_pictures_of_tissue_are_taken_for_none() -> None:
    """Per picture; a stream fails only if one in four does. Speckle of 256 lines is too fine for 120 rows."""
    print("\ntissue: least, median, most; wrong ones")
    large = (SIZES[0], *SIZES[2:])
    told = [
        row("scatterers: " + kind, [texture(image).tissue for image in scattered(kind, 30, 2, large)], missed)
        for kind in SCATTERERS
    ]
    for name, look in CART.items():
        values = [texture(image).tissue for seed in range(2, 7) for image in cart(look, 8, seed)]
        told.append(row("cart: " + name, values, missed))
    for share in (0.36, 0.5):
        values = [texture(lifted(share, seed, k)).tissue for seed in range(2, 7) for k in range(8)]
        told.append(row(f"cart: {share:.0%} in contact", values, missed))
    for name in RECORDINGS:
        told.append(row("water: " + name[:24], [texture(image).tissue for image in recorded(name, 1)], missed))
    errors, of = np.sum(told, axis=0)
    assert at_most(int(errors), int(of)) < 0.005
    small = [texture(image).tissue for kind in SCATTERERS for image in scattered(kind, 20, 3, SIZES[1:2])]
    row("scatterers at 160 x 120", small, missed)
    air = [texture(lifted(0.0, seed, k)).tissue for seed in range(2, 7) for k in range(6)]
    row("cart: in air (either is right)", air, missed)


def missed(value: float) -> bool:
    return value < 1
