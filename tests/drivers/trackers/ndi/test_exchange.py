"""Replies of a Polaris that are damaged, late or missing, on a real pseudo-terminal."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.twins.faults import Episode, Schedule
from tests.support.simulated_ndi import bench, moving, poses
from tests.support.stopwatch import Stopwatch


def test_a_device_that_stays_silent_is_given_up_in_plain_words(tmp_path: Path) -> None:
    with bench(tmp_path, rate=20.0, schedule=Schedule((Episode("lose-tracker", 0.0),))) as cart:
        with pytest.raises(DeviceLost, match="does not answer at any line speed") as refusal:
            cart.open()
        assert "switched on" in str(refusal.value)


def flip_a_bit(reply: bytes) -> bytes:
    return reply[:20] + bytes([reply[20] ^ 1]) + reply[21:]


@pytest.mark.parametrize(
    "spoil",
    [flip_a_bit, lambda reply: b"\n\xc4" + reply, lambda reply: b"OKAYA896\r", lambda reply: reply[:4] + b"\0\0\0\0"],
    ids=["bit", "junk before", "OKAY in place of data", "header CRC"],
)
def test_damaged_replies_are_refused_and_asked_for_again(tmp_path: Path, spoil: Callable[[bytes], bytes]) -> None:
    with bench(tmp_path, rate=1.0) as cart, cart.open(deadline_ms="1000") as tracker:
        spoilt = iter((True, True))
        cart.twin.spoil = lambda reply: spoil(reply) if next(spoilt, False) else reply
        found = poses(tracker, 10)
        assert tracker.telemetry.refused == 2
        for pose in found:
            assert pose.matrix is not None
            expected = moving("probe", cart.twin.device.frame_s(pose.sequence), 0)
            np.testing.assert_allclose(pose.matrix, expected, atol=1e-3)


@pytest.mark.parametrize(
    "spoil",
    [lambda reply: b"", lambda reply: reply[:30], lambda reply: b"\xc4\xa5", flip_a_bit],
    ids=["nothing", "half", "start word", "always damaged"],
)
def test_no_good_reply_within_the_deadline_is_a_lost_device(tmp_path: Path, spoil: Callable[[bytes], bytes]) -> None:
    with bench(tmp_path, rate=0.5) as cart, cart.open(deadline_ms="120") as tracker:
        poses(tracker, 2)
        cart.twin.spoil = spoil
        watch = Stopwatch(0.5)
        with pytest.raises(DeviceLost):
            poses(tracker, 10)
        assert watch.spent_s() < 0.3


def test_a_late_reply_never_becomes_the_next(tmp_path: Path) -> None:
    """The same old reply arrives again before each new one: only frames in order, none twice."""
    with bench(tmp_path) as cart, cart.open() as tracker:
        first: list[bytes] = []
        cart.twin.spoil = lambda reply: (first.append(reply), reply + first[0])[1]
        sequences = [pose.sequence for pose in poses(tracker, 20)]
        assert sequences == sorted(set(sequences))
