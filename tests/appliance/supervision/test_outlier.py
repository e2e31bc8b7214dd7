"""Spoilt pictures and wild poses, one at a time, through the whole chain from samples to the state of the room."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.line import Line
from probewatch.appliance.supervision.timeline import Judging, Timeline
from probewatch.appliance.types import State
from probewatch.drivers.samples import Frame, GreyImage, Pose, PoseStatus, Sample
from tests.appliance.core.test_line import SMALL, truth
from tests.support.sessions import ORIGIN_NS, SWEPT, kept, session

FIRST_S, APART_S = 9.0, 1.5
"""Verified by then; longer apart than a calibration fault takes to halt."""
RANDOM = np.random.default_rng(5)


def picture(change: Callable[[GreyImage], GreyImage]) -> Callable[[Frame], Frame]:
    return lambda frame: replace(frame, image=np.ascontiguousarray(change(frame.image)))


def moved(mm: float) -> Callable[[Pose], Pose]:
    step = np.array([[0, 0, 0, mm], [0] * 4, [0] * 4, [0] * 4])
    return lambda pose: replace(pose, matrix=pose.matrix + step)


OUTLIERS: dict[str, tuple[type[Sample], Callable[[Sample], Sample]]] = {
    "black": (Frame, picture(np.zeros_like)),
    "white": (Frame, picture(lambda image: np.full_like(image, 255))),
    "noise": (Frame, picture(lambda image: RANDOM.integers(0, 256, image.shape, dtype=np.uint8))),
    "torn": (Frame, picture(lambda image: np.vstack([image[:120], np.roll(image, 40, axis=1)[120:]]))),
    "shifted": (Frame, picture(lambda image: np.roll(image, 25, axis=1))),
    "a menu": (
        Frame,
        picture(lambda image: np.kron(RANDOM.integers(0, 2, (30, 40), np.uint8), np.full((10, 10), 255, np.uint8))),
    ),
    "a pose 5 mm away": (Pose, moved(5.0)),
    "a pose 50 mm away": (Pose, moved(50.0)),
    "a pose missing": (Pose, lambda pose: replace(pose, matrix=None, rms_mm=np.nan, status=PoseStatus.MISSING)),
    "mirrored": (Frame, picture(lambda image: image[:, ::-1])),
}
"""What grabber, scanner or tracker make of one sample."""
FLIPPED_S = FIRST_S + APART_S * len(OUTLIERS)


def spoilt(samples: Iterator[Sample]) -> Iterator[Sample]:
    """Each outlier once, in turn; at last every picture mirrored."""
    waiting = [*OUTLIERS]
    for sample in samples:
        t_s = (sample.stamp.t_ns - ORIGIN_NS) / 1e9
        if waiting and t_s >= FLIPPED_S - APART_S * len(waiting) and isinstance(sample, OUTLIERS[waiting[0]][0]):
            yield OUTLIERS[waiting.pop(0)][1](sample)
        elif t_s >= FLIPPED_S and isinstance(sample, Frame):
            yield picture(lambda image: image[:, ::-1])(sample)
        else:
            yield sample


@pytest.mark.thorough
def test_an_outlier_of_one_sample_never_alarms_and_what_stays_wrong_does() -> None:
    world = kept(3, settings=SMALL)
    line = Line(truth(world), SWEPT)
    end_ns = ORIGIN_NS + round((FLIPPED_S + 1) * 1e9)
    timeline = Timeline(ORIGIN_NS, ORIGIN_NS, end_ns, Judging(SWEPT))
    for sample in spoilt(session(world, FLIPPED_S + 1)):
        timeline.step(sample, line.step(sample))
    timeline.finish()
    before = [change.state for change in timeline.changes if change.t_s < FLIPPED_S]
    assert State.MONITORING in before
    assert set(before) <= {State.SELF_TEST, State.WAITING, State.NOT_VERIFIED, State.MONITORING}
    for k, name in enumerate([*OUTLIERS][:-1]):
        at_s = FIRST_S + APART_S * k
        (*_, last) = (change for change in timeline.changes if change.t_s < at_s)
        assert last.state is State.MONITORING, f"before {name} nothing could be lost"
    assert [change.state for change in timeline.changes if change.t_s >= FLIPPED_S] == [State.WARNING, State.HALT]
