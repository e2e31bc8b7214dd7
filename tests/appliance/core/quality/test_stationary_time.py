"""For how long a probe has rested: what counts, and what a slip, a moving tissue or a frozen tracker makes of it."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from probewatch.appliance.core.quality.stationary_time import StationaryTime
from probewatch.appliance.core.registration.keyframe import Registration
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array, inverse, rigid, rotation_from_vector
from probewatch.drivers.samples import Matrix4

FPS = 30
PERIOD_NS = round(1e9 / FPS)
LIMITS = Limits()
X = rigid(rotation_from_vector(np.array([0.6, -0.4, 0.9])), np.array([11.0, 62.0, 14.0]))
SCALE = np.array([0.12, 0.11])
REFERENCE = Calibration(X[:3, :3], (1, -1), SCALE, X[:3, 3], (400, 300))
AT = rigid(rotation_from_vector(np.array([1.0, 0.3, -0.5])), np.array([60.0, -80.0, -1500.0]))
STILL, NOWHERE = np.zeros(3), np.zeros(6)


def six(values: dict[int, float]) -> Array:
    """(6,) mm, and deg, of the axes named by number."""
    full = np.zeros(6)
    for axis, value in values.items():
        full[axis] = value
    return full


@dataclass
class Pictures:
    """What the tissue does in the picture, as `RealTimeTracker` would find it. tissue: (3,) lateral, axial mm, deg."""

    tissue: Array = field(default_factory=lambda: STILL)
    likeness: float = 0.97
    anchor: Array = field(default_factory=lambda: STILL)
    anchors: int = 0

    def take_anchor(self) -> None:
        self.anchor, self.anchors = self.tissue, self.anchors + 1

    def against_anchor(self) -> Registration:
        moved = self.tissue - self.anchor
        lateral, axial = REFERENCE.polarity
        turn_rad = np.deg2rad(moved[2]) * lateral * axial
        u_px = moved[:2] / SCALE * REFERENCE.polarity
        return Registration(u_px, turn_rad, 1.0, 0.0, np.eye(3), self.likeness, 1.0, converged=True)


@dataclass
class Scene:
    """Pictures and poses one after the other. way: (6,) of the picture plane since the start as the tracker has it, mm
    and deg."""

    stationary: StationaryTime = field(default_factory=lambda: StationaryTime(LIMITS, REFERENCE))
    pictures: Pictures = field(default_factory=Pictures)
    count: int = 0
    random: np.random.Generator = field(default_factory=lambda: np.random.default_rng(1))

    def picture(
        self,
        way: Array = NOWHERE,
        tissue: Array = STILL,
        *,
        likeness: float = 0.97,
        noise_mm: float = 0.05,
        turn_noise_deg: float = 0.02,
    ) -> None:
        self.count += 1
        own = way + np.array([*self.random.normal(0, noise_mm, 3), *self.random.normal(0, turn_noise_deg, 3)])
        self.pictures.tissue, self.pictures.likeness = tissue, likeness
        self.stationary.step(self.count * PERIOD_NS, self.pose(own), self.pictures)

    @staticmethod
    def pose(way: Array) -> Matrix4:
        """Sensor → tracker where the picture plane went this way: A = X B X⁻¹ moves the tissue by it."""
        A = rigid(rotation_from_vector(np.deg2rad(way[3:])), way[:3])
        return np.asarray(AT @ inverse(X) @ inverse(A) @ X)

    def rested_s(self, since_s: float = 0.0) -> float:
        return self.stationary.since(round(since_s * 1e9)) / 1e9


def test_a_hand_with_a_tremor_rests() -> None:
    scene = Scene()
    tremor = scene.random.normal(0, 0.2, (60 * FPS, 3))
    for x, y, z in tremor:
        scene.picture(np.array([x, y, z, 0, 0, 0]), np.array([x, y, 0.0]), likeness=np.exp(-(z**2)))
    assert scene.rested_s() > 58
    assert scene.rested_s(50.0) == pytest.approx(10, abs=1)
    assert scene.stationary.since(0, lasting=True) == scene.stationary.since(0)


def test_it_counts_for_no_longer_than_is_configured() -> None:
    scene = Scene(StationaryTime(Limits(at_rest_s=5), REFERENCE))
    for _ in range(20 * FPS):
        scene.picture()
    assert scene.rested_s() == 5


@pytest.mark.parametrize("axis", range(6))
def test_a_probe_that_is_moved_does_not_rest(axis: int) -> None:
    """Where it is put, another rest begins."""
    scene = Scene()
    for _ in range(3 * FPS):
        scene.picture()
    away = six({axis: 2.0})
    for _ in range(3 * FPS):
        scene.picture(away, away[[0, 1, 5]], likeness=0.5)
    assert scene.pictures.anchors == 2
    assert scene.rested_s() == pytest.approx(3, abs=0.2)
    assert scene.stationary.since(0, lasting=True) == 0


def test_a_probe_that_is_back_soon_has_rested_all_the_while() -> None:
    """Tracker and picture agree there as before, so that nothing has changed meanwhile."""
    scene = Scene()
    for seconds, way_mm in ((3, 0.0), (0.8, 2.0), (3, 0.0)):
        for _ in range(round(seconds * FPS)):
            scene.picture(six({2: way_mm}), likeness=0.97 if way_mm == 0 else 0.2)
    assert scene.rested_s() == pytest.approx(6.8, abs=0.2)


def test_a_probe_that_never_stays_costs_an_anchor_a_second() -> None:
    scene = Scene()
    for number in range(20 * FPS):
        away = six({0: 10 * np.sin(2 * np.pi * number / FPS / 3.1)})
        scene.picture(away, away[[0, 1, 5]])
    assert scene.pictures.anchors <= 20
    assert scene.rested_s() <= 4, "there and back within a second is where it was"


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("lost_every_s", [1000, 32])
@pytest.mark.parametrize("over_s", [5, pytest.param(60, marks=pytest.mark.thorough)])
def test_a_marker_body_that_slips_however_slowly_ends_the_rest_at_a_quarter_of_its_limit(
    axis: int, lost_every_s: int, over_s: int
) -> None:
    """By twice the limit; the picture stays as it is, or is lost now and then, so that another anchor is taken."""
    scene = Scene()
    limit = LIMITS.offset_mm if axis < 3 else LIMITS.rotation_deg
    for number in range(over_s * FPS):
        lost = number % (lost_every_s * FPS) >= lost_every_s * FPS / 2 and lost_every_s < over_s
        scene.picture(six({axis: 2 * limit * number / (over_s * FPS)}), likeness=0.2 if lost else 0.97)
    for _ in range(20 * FPS):
        scene.picture(six({axis: 2 * limit}))
    assert scene.rested_s() <= 0.15 * over_s + 1


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_probe_that_slips_out_of_a_body_that_stays_ends_the_rest(axis: int) -> None:
    """In the plane the picture shows its way; out of it, its likeness falls."""
    scene = Scene()
    for number in range(20 * FPS):
        tissue = np.zeros(3)
        tissue[axis] = 2 * (LIMITS.rotation_deg if axis == 2 else LIMITS.offset_mm) * number / (20 * FPS)
        scene.picture(tissue=tissue)
    assert scene.rested_s() <= 0.30 * 20
    unlike = Scene()
    for number in range(5 * FPS):
        unlike.picture(likeness=1 - number / (20 * FPS))
    assert unlike.rested_s() == pytest.approx(2, abs=0.2)


def test_between_breaths_that_bring_the_tissue_back_it_rests() -> None:
    scene = Scene()
    for number in range(40 * FPS):
        scene.picture(tissue=np.array([0.0, 4 * np.sin(np.pi * number / FPS / 4) ** 2, 0.0]))
    assert scene.pictures.anchors <= 4, "until one is of a time at which the tissue lingers"
    assert scene.rested_s() == pytest.approx(38, abs=5)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.7, 0.9])
@pytest.mark.parametrize("breath_s", [3.0, 5.0])
def test_the_first_anchor_waits_for_the_breath_that_brings_its_tissue_back(breath_s: float, share: float) -> None:
    """Wherever in the breath it was taken: a rest that begins later counts for nothing that was shown before."""
    scene = Scene()
    for number in range(15 * FPS):
        breath = np.pi * (share + number / FPS / breath_s)
        scene.picture(tissue=np.array([0.0, 4 * np.sin(breath) ** 2, 0.0]))
    assert scene.pictures.anchors == 1
    assert scene.rested_s() == pytest.approx(15, abs=breath_s)


@pytest.mark.parametrize("slips_s", [1.5, *(pytest.param(one, marks=pytest.mark.thorough) for one in (2.5, 3.5, 5.0))])
@pytest.mark.parametrize("lasts_s", [0.1, 1.0])
@pytest.mark.parametrize("axis", [0, 1, 2, 5])
def test_a_slip_while_no_picture_is_like_the_anchor_is_no_hand_that_moved(
    axis: int, lasts_s: float, slips_s: float
) -> None:
    """The hand settles .7 mm out of the plane of the first anchor; then the body slips by twice its limit."""
    scene, limit = Scene(), LIMITS.offset_mm if axis < 3 else LIMITS.rotation_deg
    for number in range(60 * FPS):
        t_s = number / FPS
        away = six({2: 0.0 if t_s < 0.3 else 0.7})
        slip = six({axis: 2 * limit * np.clip((t_s - slips_s) / lasts_s, 0, 1)})
        like = 0.85 if scene.pictures.anchors == 1 and t_s >= 0.3 else 0.97
        scene.picture(away + slip, likeness=like)
    assert scene.rested_s() <= slips_s


def test_an_anchor_of_the_last_motion_is_given_up_soon_where_the_tissue_is_still() -> None:
    """In place, and not like it: no breath will bring that picture back."""
    scene = Scene()
    for _ in range(15 * FPS):
        scene.picture(likeness=0.89 if scene.pictures.anchors == 1 and scene.count > 1 else 0.97)
    assert scene.pictures.anchors == 2
    assert scene.rested_s() == pytest.approx(13, abs=0.5)


def test_a_tracker_that_repeats_itself_shows_no_rest() -> None:
    scene = Scene()
    for _ in range(FPS):
        scene.picture()
    before_s, state = scene.rested_s(), scene.random.bit_generator.state
    for _ in range(5 * FPS):
        scene.random.bit_generator.state = state
        scene.picture()
    assert scene.rested_s() <= before_s + 0.2
    assert scene.stationary.since(0, lasting=True) == 0


def test_what_is_forgotten_is_no_rest() -> None:
    scene = Scene()
    for way_mm in (0.0, 5.0):
        for _ in range(4 * FPS):
            scene.picture(six({0: way_mm}), np.array([way_mm, 0.0, 0.0]))
    assert scene.rested_s(4.5) == pytest.approx(2.9, abs=0.4)
    scene.stationary.forget(5 * 10**9)
    assert scene.rested_s(4.5) == 0
    assert scene.rested_s() == pytest.approx(4, abs=0.3)
    scene.stationary.restart()
    assert scene.rested_s() == 0


def test_only_the_rest_that_followed_what_was_shown_counts() -> None:
    """Between two rests anything may have changed; a rest that began long after says nothing of what was before it."""
    scene = Scene()
    for seconds, likeness in ((20, 0.97), (16, 0.2), (20, 0.97)):
        for _ in range(seconds * FPS):
            scene.picture(likeness=likeness)
    assert scene.rested_s(2.0) == pytest.approx(18, abs=0.3)
    assert scene.rested_s(34.0) == pytest.approx(20, abs=3), "of what is shown just before the second"
    away = Scene()
    for number in range(20 * FPS):
        away.picture(six({2: 10.0 * np.sin(number / 7)}), likeness=0.2)
    for number in range(20 * FPS):
        away.picture(likeness=0.2 if number < 1.2 * FPS else 0.97)
    assert away.rested_s(3.0) == 0
    assert away.rested_s(17.0) == pytest.approx(20, abs=3)


@pytest.mark.parametrize("axis", range(6))
def test_a_hand_that_sinks_ends_its_rest_at_a_quarter_of_the_limit(axis: int) -> None:
    """One anchor for all of it: handed on, what each hides would add up."""
    scene = Scene()
    limit = LIMITS.offset_mm if axis < 3 else LIMITS.rotation_deg
    for number in range(60 * FPS):
        way = six({axis: limit * number / (60 * FPS)})
        scene.picture(way, way[[0, 1, 5]])
    assert scene.rested_s() == pytest.approx(15, abs=2.5)
    assert scene.stationary.since(0, lasting=True) == 0


@pytest.mark.parametrize("axis", [1, 2])
def test_a_probe_that_wanders_to_and_fro_rests_only_near_its_anchor(axis: int) -> None:
    """3 mm every 40 s, and the pictures go along: between two passages a rest may have been any."""
    scene = Scene()
    for number in range(80 * FPS):
        way = six({axis: 3.0 * np.sin(2 * np.pi * number / FPS / 40)})
        scene.picture(way, way[[0, 1, 5]])
    assert scene.rested_s() <= 4


def test_a_tracker_that_repeats_a_reading_between_which_poses_are_interpolated_shows_no_rest() -> None:
    scene = Scene()
    for number in range(20 * FPS):
        rounding = six(dict.fromkeys(range(3), 1e-12 * (number % 7)))
        scene.picture(rounding, noise_mm=0.0, turn_noise_deg=0.0)
    assert scene.rested_s() == 0


@pytest.mark.parametrize("broken", ["likeness", "pose", "tissue"])
def test_what_is_no_number_shows_no_rest(broken: str) -> None:
    scene = Scene()
    for _ in range(5 * FPS):
        scene.picture()
    before_s = scene.rested_s()
    for _ in range(10 * FPS):
        way = six({0: float("nan")}) if broken == "pose" else NOWHERE
        tissue = np.array([float("nan"), 0.0, 0.0]) if broken == "tissue" else STILL
        scene.picture(way, tissue, likeness=float("nan") if broken == "likeness" else 0.97)
    assert scene.rested_s() <= before_s + 0.2


def test_that_tracker_and_picture_have_parted_outlives_what_was_stamped_wrongly() -> None:
    """Shown at 3 s, slipped at 4 s, at rest from 5 s on; what is forgotten is all later."""
    scene = Scene()
    for number in range(10 * FPS):
        slipped = min(max(number / FPS - 4, 0.0), 1.0) * 8.0
        scene.picture(six({0: slipped}))
    assert scene.rested_s(3.0) <= 1.3
    scene.stationary.forget(9 * 10**9)
    for _ in range(10 * FPS):
        scene.picture(six({0: 8.0}))
    assert scene.rested_s(4.3) == 0


def _shaken(tremor_mm: float, *, frozen: bool, noise_mm: float = 0.05) -> Scene:
    scene = Scene()
    for x, y, z in scene.random.normal(0, tremor_mm, (30 * FPS, 3)):
        tissue = STILL if frozen else np.array([x, y, 0.0])
        tissue = tissue + np.array([*scene.random.normal(0, 0.01, 2), 0.0])
        scene.picture(six({0: x, 1: y, 2: z}), tissue, noise_mm=noise_mm)
    return scene


def test_a_picture_that_the_hand_does_not_stir_shows_no_rest() -> None:
    """Frozen, under noise of the line: alike for good."""
    for tremor_mm in (0.2, 0.3):
        assert _shaken(tremor_mm, frozen=True).rested_s() <= 4.0, tremor_mm


@pytest.mark.parametrize("noise_mm", [0.05, 0.1, 0.25])
def test_a_hand_that_stirs_the_picture_rests_under_the_noise_of_any_tracker(noise_mm: float) -> None:
    assert _shaken(0.15, frozen=False, noise_mm=noise_mm).rested_s() > 25


@pytest.mark.parametrize("noise_mm", [0.05, 0.1, 0.13])
def test_a_probe_in_a_holder_rests_where_the_tracker_is_calm(noise_mm: float) -> None:
    assert _shaken(0.0, frozen=False, noise_mm=noise_mm).rested_s() > 27
