"""After a gap in sight nothing counts any more that a hand could have changed meanwhile: no parameter is left out."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.line import Line
from probewatch.appliance.core.path.blocks import PARTS
from probewatch.appliance.core.path.noise import Habit, Noise
from probewatch.appliance.limits import Limits, RequiredAges
from probewatch.appliance.types import PARAMETERS, Check, Fault, VerdictKind
from probewatch.drivers.samples import Frame, GreyImage, Pose, PoseStatus, Sample, Stamp
from tests.appliance.core.test_line import SMALL, truth
from tests.support.sessions import kept

SHOWN = ("polarity", "latency", *PARAMETERS)
NS = 1_000_000_000
BLACK = np.zeros((SMALL.height_px, SMALL.width_px), np.uint8)
During = Callable[[Sample], Sample | None]


def line() -> Line:
    """One to which every parameter was just shown."""
    everything = RequiredAges.model_validate(dict.fromkeys(SHOWN, 600.0))
    watched = Line(truth(kept(3, settings=SMALL)), Limits(required_age_s=everything))
    told = tuple(Check(name, Fault(name.split("-", 1)[0]), 0.0, 0.1, "", 1.0, VerdictKind.OK, 5 * NS) for name in SHOWN)
    watched._evidence._verification.weigh(told, 0)
    return watched


def scan(from_s: float, to_s: float) -> Iterator[Sample]:
    world = kept(3, settings=SMALL)
    for k in range(round(from_s * 30), round(to_s * 30)):
        stamp = Stamp(5 * NS + round(k / 30 * 1e9), 100_000)
        yield Frame(stamp, k, world.frame(k / 30, k))
        yield Pose(stamp, k, world.probe_pose(k / 30), 0.1, PoseStatus.OK)


def unseen(sample: Sample) -> Sample | None:
    if isinstance(sample, Pose):
        return replace(sample, matrix=None, status=PoseStatus.MISSING)
    return sample


def shown(image: GreyImage) -> During:
    return lambda sample: replace(sample, image=image) if isinstance(sample, Frame) else sample


GAPS: dict[str, tuple[float, During]] = {
    "probe out of the tracker's sight": (0.4, unseen),
    "no pose for as long as makes the slip watch begin again": (0.24, unseen),
    "no pose at all": (0.4, lambda sample: None if isinstance(sample, Pose) else sample),
    "no picture at all": (0.4, lambda sample: None if isinstance(sample, Frame) else sample),
    "nothing": (0.4, lambda _: None),
    "frozen picture": (0.4, shown(next(one.image for one in scan(0.0, 0.1) if isinstance(one, Frame)))),
    "no tissue": (0.7, shown(BLACK)),
    "picture of another size": (0.4, shown(BLACK[::2, ::2])),
    "tracker that reports a fault": (
        0.4,
        lambda one: replace(one, matrix=None, status=PoseStatus.FAULT) if isinstance(one, Pose) else one,
    ),
}


def after(watched: Line, lasting_s: float, during: During) -> None:
    for sample in scan(0.0, 0.2):
        watched.step(sample)
    assert watched._evidence.status.verified_ns == 5 * NS
    for sample in scan(0.2, 0.2 + lasting_s):
        if (left := during(sample)) is not None:
            watched.step(left)
    for sample in scan(0.2 + lasting_s, 0.35 + lasting_s):
        watched.step(sample)


@pytest.mark.parametrize(("lasting_s", "during"), GAPS.values(), ids=GAPS)
def test_after_a_gap_no_parameter_is_shown(lasting_s: float, during: During) -> None:
    watched = line()
    after(watched, lasting_s, during)
    assert watched._evidence.status.verified_ns is None
    known = {name for name in SHOWN if name in watched._evidence._verification._shown_ns}
    assert known == set()


@pytest.mark.parametrize("step_ns", [0, -33_000_000], ids=["stand still", "go back"])
@pytest.mark.parametrize("poses_too", [False, True])
def test_pictures_whose_stamps_do_not_go_on_show_nothing(step_ns: int, poses_too: bool) -> None:
    """The contact stayed closed for as long as the oldest evidence may be old, whatever happened to the probe."""
    watched = line()
    last_ns = 0
    for sample in scan(0.0, 0.2):
        watched.step(sample)
        last_ns = sample.stamp.t_ns
    assert watched._evidence.status.verified_ns == 5 * NS
    for sample in scan(0.2, 0.3):
        last_ns += step_ns if isinstance(sample, Frame) else 0
        spoiled = poses_too or isinstance(sample, Frame)
        watched.step(replace(sample, stamp=Stamp(last_ns, 100_000)) if spoiled else sample)
    assert watched._evidence.status.verified_ns is None


def test_after_a_gap_the_breathing_is_still_known_and_nothing_else() -> None:
    watched = line()
    learned = Noise(np.ones((3, PARTS)), np.ones((3, PARTS)), {1: Habit(np.ones(8), 4.0)})
    noises = watched._evidence._examiner.noises
    noises.learn(NS, learned, 10 * NS, way_mm=10.0)
    noises.learn(2 * NS, Noise(np.ones((3, PARTS))), 10 * NS, way_mm=10.0)
    noises.see_breathing(10 * NS)
    lasting_s, during = GAPS["nothing"]
    after(watched, lasting_s, during)
    assert noises.of_motion(9 * NS) is noises.until(9 * NS) is learned
    assert not noises.breathing_known, "a wrong axial scale is not named before it was learned again"


def test_a_hand_that_passes_before_the_markers_takes_nothing_away() -> None:
    watched = line()
    after(watched, 0.2, unseen)
    assert watched._evidence.status.verified_ns == 5 * NS
