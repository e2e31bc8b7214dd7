"""Which pose a frame gets: between the two that bracket it, never the nearest, never one beyond."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from probewatch.appliance.core.acquisition.pairing import GAP, NEVER, NO_POSE, NOT_OK, REASONS, Pairing, Unpaired
from probewatch.appliance.types import StampedPair
from probewatch.drivers.rigid import rigid, rotation_from_vector
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp

PICTURE = np.zeros((2, 3), np.uint8)
MS = 1_000_000


def frame(t_ms: float, err_ms: float = 0.0) -> Frame:
    return Frame(Stamp(round(t_ms * MS), round(err_ms * MS)), round(t_ms), PICTURE)


def pose(t_ms: float, status: PoseStatus = PoseStatus.OK, err_ms: float = 0.0) -> Pose:
    """The probe runs along x at 1 mm/ms and turns about z at 1 mrad/ms."""
    place = rigid(rotation_from_vector(np.array([0, 0, t_ms * 1e-3])), np.array([t_ms, 5.0, -7.0]))
    stamp = Stamp(round(t_ms * MS), round(err_ms * MS))
    return Pose(stamp, round(t_ms), place if status is PoseStatus.OK else None, 0.1, status)


def settled(pairing: Pairing, *samples: Frame | Pose) -> list[StampedPair | Unpaired]:
    return [item for sample in samples for item in pairing.step(sample)]


def reasons(items: list[StampedPair | Unpaired]) -> list[str]:
    """Each of them one that the page can say in every language."""
    found = [item.reason for item in items if isinstance(item, Unpaired)]
    assert set(found) <= set(REASONS)
    return found


@pytest.mark.parametrize("t_ms", [100, 101, 110, 119, 120])
def test_a_frame_gets_the_pose_of_its_own_time(t_ms: float) -> None:
    (pair,) = settled(Pairing(), pose(100), frame(t_ms), pose(120), pose(140))
    assert isinstance(pair, StampedPair)
    np.testing.assert_allclose(pair.matrix, pose(t_ms).matrix, atol=1e-9)
    assert pair.stamp.t_ns == t_ms * MS


def test_a_frame_waits_for_the_pose_after_it() -> None:
    pairing = Pairing()
    assert settled(pairing, pose(100), frame(101), pose(100.9)) == []
    (pair,) = settled(pairing, pose(102))
    assert isinstance(pair, StampedPair)


def test_poses_may_come_long_before_the_frame() -> None:
    pairing = Pairing()
    items = settled(pairing, *(pose(10 * k) for k in range(30)), frame(105), frame(155))
    assert [item.matrix[0, 3] for item in items if isinstance(item, StampedPair)] == pytest.approx([105, 155])


def test_nothing_is_extrapolated_backwards() -> None:
    assert reasons(settled(Pairing(), pose(100), frame(99.9), pose(120))) == [NO_POSE]


def test_nothing_is_extrapolated_forwards() -> None:
    pairing = Pairing()
    assert settled(pairing, pose(100), pose(120), frame(120.1)) == []
    assert reasons(list(pairing.finish())) == [NEVER]
    assert pairing.unpaired == {NEVER: 1}


@pytest.mark.parametrize("status", [status for status in PoseStatus if status is not PoseStatus.OK])
@pytest.mark.parametrize("worse", [0, 1], ids=["before", "after"])
def test_both_poses_must_be_usable(status: PoseStatus, worse: int) -> None:
    statuses = [PoseStatus.OK, PoseStatus.OK]
    statuses[worse] = status
    items = settled(Pairing(), pose(100, statuses[0]), frame(110), pose(120, statuses[1]))
    assert reasons(items) == [NOT_OK + status.value]


def test_a_usable_pose_at_the_frame_needs_no_second_one() -> None:
    pairing = Pairing()
    (pair,) = settled(pairing, pose(90, PoseStatus.MISSING), pose(100), frame(100))
    assert isinstance(pair, StampedPair)
    assert pair.gap_ns == 0
    np.testing.assert_array_equal(pair.matrix, pose(100).matrix)


@pytest.mark.parametrize(("gap_ms", "paired"), [(50, True), (50.000001, False)])
def test_poses_bracket_up_to_the_largest_gap(gap_ms: float, paired: bool) -> None:
    (item,) = settled(Pairing(max_gap_ns=50 * MS), pose(100), frame(110), pose(100 + gap_ms))
    if paired:
        assert isinstance(item, StampedPair)
        assert item.gap_ns == 50 * MS
    else:
        assert reasons([item]) == [GAP]


@pytest.mark.parametrize("latency_ms", [-30, 0, 45])
def test_latency_shifts_which_pose_belongs_to_the_frame(latency_ms: int) -> None:
    """A tracker that is late by 45 ms reports the pose of the picture 45 ms after it."""
    pairing = Pairing()
    pairing.latency_ns = latency_ms * MS
    (pair,) = settled(pairing, *(pose(20 * k) for k in range(8)), frame(97), pose(160))
    assert isinstance(pair, StampedPair)
    assert pair.matrix[0, 3] == pytest.approx(97 + latency_ms)
    assert pair.stamp.t_ns == 97 * MS, "the pair stands at the time of the picture"


def test_what_was_stamped_in_the_future_is_forgotten() -> None:
    pairing = Pairing()
    assert settled(pairing, pose(90), pose(900), frame(100), frame(110)) != []
    pairing.forget_poses(95 * MS)
    pairing.forget_frames(105 * MS)
    (pair,) = settled(pairing, frame(106), pose(120))
    assert isinstance(pair, StampedPair)
    assert pair.gap_ns == 30 * MS


def test_waiting_is_bounded_and_gives_up_the_oldest() -> None:
    pairing = Pairing(max_waiting=3)
    items = settled(pairing, *(frame(k) for k in range(1, 6)))
    assert [(item.frame.sequence, item.reason) for item in items if isinstance(item, Unpaired)] == [
        (1, NEVER),
        (2, NEVER),
    ]
    assert [item.frame.sequence for item in pairing.finish()] == [3, 4, 5]


def test_the_doubt_of_the_worst_stamp_stands_for_the_pair() -> None:
    (pair,) = settled(Pairing(), pose(100, err_ms=0.2), frame(110, err_ms=0.1), pose(120, err_ms=0.7))
    assert isinstance(pair, StampedPair)
    assert pair.stamp.err_ns == 0.7 * MS


instants = st.integers(0, 400).map(lambda tenths: tenths / 10)
statuses = st.sampled_from([PoseStatus.OK, PoseStatus.OK, PoseStatus.OK, *PoseStatus])
samples = st.lists(
    st.one_of(instants.map(frame), st.builds(pose, instants, statuses)),
    max_size=60,
    unique_by=lambda sample: (type(sample), sample.stamp.t_ns),
)


@given(samples, st.integers(-20, 20), st.integers(1, 8))
def test_every_frame_is_settled_once_and_no_pose_is_invented(
    stream: list[Frame | Pose], latency_ms: int, waiting: int
) -> None:
    pairing = Pairing(max_gap_ns=10 * MS, max_waiting=waiting)
    pairing.latency_ns = latency_ms * MS
    stream = sorted(stream, key=lambda sample: sample.stamp.t_ns)
    items = [*settled(pairing, *stream), *pairing.finish()]
    frames = [id(sample) for sample in stream if isinstance(sample, Frame)]
    assert Counter(id(item.frame) for item in items) == Counter(frames)
    assert Counter(reasons(items)) == pairing.unpaired
    for pair in items:
        if isinstance(pair, StampedPair):
            assert 0 <= pair.gap_ns <= 10 * MS
            wanted = pose(pair.stamp.t_ns / MS + latency_ms)
            np.testing.assert_allclose(pair.matrix, wanted.matrix, atol=1e-9)
