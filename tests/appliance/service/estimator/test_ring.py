"""The ring between the two processes, with a real second process at its other end."""

import contextlib
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from appliance.service.estimator.ring import FRAMES, POSES, Ring, Shape
from drivers.samples import Frame, Pose, PoseStatus, Sample, Stamp

SMALL = Shape(slots=4, payload_bytes=64 * 48 + 64)
PRODUCER = """
import sys, time
import numpy as np
from appliance.service.estimator.ring import Ring, Shape
from drivers.samples import Frame, Stamp
ring = Ring(Shape(slots=4, payload_bytes=64 * 48 + 64), int(sys.argv[1]))
print("ready", flush=True)
for sequence in range(int(sys.argv[2])):
    ring.put(Frame(Stamp(sequence, 0), sequence, np.full((48, 64), sequence % 251, np.uint8)))
print("done", flush=True)
time.sleep(60)
"""


def frame(sequence: int, shape: tuple[int, int] = (48, 64)) -> Frame:
    return Frame(Stamp(sequence * 10, 5), sequence, np.full(shape, sequence % 251, np.uint8))


def sequences(samples: list[Sample]) -> list[int]:
    return [sample.sequence for sample in samples]


def test_samples_come_out_as_they_went_in() -> None:
    matrix = np.arange(16.0).reshape(4, 4)
    image = np.random.default_rng(1).integers(0, 256, (48, 64), dtype=np.uint8)
    with Ring(SMALL) as ring:
        ring.put(Frame(Stamp(-3, 7), 2**40, image[:, ::-1]))
        ring.put(Pose(Stamp(1, 2), 3, matrix, 0.25, PoseStatus.OK))
        ring.put(Pose(Stamp(4, 5), 6, None, float("nan"), PoseStatus.MISSING, "hinter dem Gerät"))
        (picture, pose, missing), dropped = ring.take()
    assert dropped == 0
    assert isinstance(picture, Frame)
    assert (picture.stamp, picture.sequence) == (Stamp(-3, 7), 2**40)
    assert np.array_equal(picture.image, image[:, ::-1])
    assert isinstance(pose, Pose)
    assert (pose.stamp, pose.sequence, pose.rms_mm, pose.status) == (Stamp(1, 2), 3, 0.25, PoseStatus.OK)
    assert np.array_equal(pose.matrix, matrix)
    assert isinstance(missing, Pose)
    assert missing.matrix is None
    assert (missing.status, missing.reason) == (PoseStatus.MISSING, "hinter dem Gerät")


def test_a_full_ring_drops_the_oldest_and_counts() -> None:
    with Ring(SMALL) as ring:
        for sequence in range(10):
            ring.put(frame(sequence))
        assert ring.backlog == 10
        samples, dropped = ring.take()
        assert (sequences(samples), dropped) == ([6, 7, 8, 9], 6)
        assert ring.take() == ([], 0)
        ring.put(frame(10))
        samples, dropped = ring.take()
        assert (sequences(samples), dropped) == ([10], 0)


def test_a_picture_too_large_is_refused() -> None:
    with Ring(SMALL) as ring, pytest.raises(ValueError, match="does not fit"):
        ring.put(frame(0, (480, 640)))


def test_a_half_written_slot_is_dropped() -> None:
    with Ring(SMALL) as ring:
        ring.put(frame(0))
        ring.put(frame(1))
        os.pwrite(ring.fd, b"\xff", 64 + SMALL.stride + 1000)
        samples, dropped = ring.take()
        assert (sequences(samples), dropped) == ([0], 1)


def test_the_standard_shapes_hold_what_the_cart_sends() -> None:
    with Ring(FRAMES) as frames, Ring(POSES) as poses:
        frames.put(frame(1, (1200, 1920)))
        poses.put(Pose(Stamp(1, 1), 1, np.eye(4), 0.1, PoseStatus.OK, "x" * 1000))
        assert len(frames.take()[0]) == len(poses.take()[0]) == 1


def producer(ring: Ring, count: int) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", PRODUCER, str(ring.fd), str(count)]
    process = subprocess.Popen(command, pass_fds=[ring.fd], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


@contextlib.contextmanager
def running(process: subprocess.Popen[str]):  # type: ignore[no-untyped-def]
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def test_a_racing_producer_never_yields_a_torn_or_disordered_sample() -> None:
    total = 20_000
    with Ring(SMALL) as ring, running(producer(ring, total)):
        seen, dropped, deadline = [], 0, time.monotonic() + 20
        while len(seen) + dropped < total and time.monotonic() < deadline:
            samples, lost = ring.take()
            dropped += lost
            for sample in samples:
                assert isinstance(sample, Frame)
                assert (sample.image == sample.sequence % 251).all()
            seen += sequences(samples)
    assert len(seen) + dropped == total
    assert seen == sorted(set(seen))
    assert seen[-1] == total - 1


def test_what_a_killed_producer_wrote_can_still_be_read_and_is_then_freed() -> None:
    with Ring(SMALL) as ring, running(producer(ring, 3)) as process:
        assert process.stdout.readline() == "done\n"
        process.send_signal(signal.SIGKILL)
        process.wait(5)
        assert sequences(ring.take()[0]) == [0, 1, 2]
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(ring.fd)
