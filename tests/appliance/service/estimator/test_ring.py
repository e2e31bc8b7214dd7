"""The ring between the two processes, with a real second process at its other end."""

import contextlib
import mmap
import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from probewatch.appliance.service.estimator.ring import FRAMES, POSES, Ring, RingFds, Shape
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Sample, Stamp

SMALL = Shape(slots=4, payload_bytes=64 * 48 + 64)
PRODUCER = """
import sys, time
import numpy as np
from probewatch.appliance.service.estimator.ring import Ring, RingFds, Shape
from probewatch.drivers.samples import Frame, Stamp
ring = Ring(Shape(slots=4, payload_bytes=64 * 48 + 64), RingFds(*map(int, sys.argv[2:])))
print("ready", flush=True)
for sequence in range(int(sys.argv[1])):
    ring.put(Frame(Stamp(sequence, 0), sequence, np.full((48, 64), sequence % 251, np.uint8)))
print("done", flush=True)
time.sleep(60)
"""
HALF = Shape(slots=4, payload_bytes=64 + 128 * 128)
DIES_AMID_A_FRAME = """
import os, sys
import numpy as np
from probewatch.appliance.service.estimator.ring import Ring, RingFds, Shape
from probewatch.drivers.samples import Frame, Stamp
ring = Ring(Shape(slots=4, payload_bytes=64 + 128 * 128), RingFds(*map(int, sys.argv[3:])))
for sequence in range(int(sys.argv[1])):
    ring.put(Frame(Stamp(sequence, 0), sequence, np.full((128, 128), sequence + 1, np.uint8)))
image = np.memmap(sys.argv[2], np.uint8, "r", shape=(128, 128))
os.truncate(sys.argv[2], 128 * 128 // 2)
ring.put(Frame(Stamp(99, 0), 99, image[:, ::-1]))
"""
"""What lies beyond the end of a mapped file cannot be read: the kernel kills the process in mid-picture."""


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
        ring.put(Pose(Stamp(7, 8), 9, matrix, 0.25, PoseStatus.OK, witness=matrix + 1))
        (picture, pose, missing, witnessed), dropped = ring.take()
    assert dropped == 0
    assert isinstance(witnessed, Pose)
    assert np.array_equal(witnessed.witness, matrix + 1)
    assert isinstance(picture, Frame)
    assert (picture.stamp, picture.sequence) == (Stamp(-3, 7), 2**40)
    assert np.array_equal(picture.image, image[:, ::-1])
    assert isinstance(pose, Pose)
    assert (pose.stamp, pose.sequence, pose.rms_mm, pose.status) == (Stamp(1, 2), 3, 0.25, PoseStatus.OK)
    assert np.array_equal(pose.matrix, matrix)
    assert pose.witness is None
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


def test_the_standard_shapes_hold_what_the_cart_sends() -> None:
    with Ring(FRAMES) as frames, Ring(POSES) as poses:
        frames.put(frame(1, (1200, 1920)))
        poses.put(Pose(Stamp(1, 1), 1, np.eye(4), 0.1, PoseStatus.OK, "x" * 1000))
        assert len(frames.take()[0]) == len(poses.take()[0]) == 1


def producer(ring: Ring, count: int) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", PRODUCER, str(count), *map(str, ring.fds)]
    process = subprocess.Popen(command, pass_fds=ring.fds, stdout=subprocess.PIPE, text=True)
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
    for fd in ring.fds:
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(fd)


@pytest.mark.parametrize("before", [1, 5, 6, 7, 13])
def test_a_producer_that_dies_amid_a_frame_leaves_only_whole_ones(tmp_path: Path, before: int) -> None:
    file = tmp_path / "image"
    file.write_bytes(b"\xee" * 128 * 128)
    with Ring(HALF) as ring:
        command = [sys.executable, "-c", DIES_AMID_A_FRAME, str(before), str(file), *map(str, ring.fds)]
        assert subprocess.run(command, pass_fds=ring.fds, check=False).returncode == -signal.SIGBUS
        with mmap.mmap(ring.fds.memory, HALF.size, access=mmap.ACCESS_READ) as memory:
            start = HALF.start(before) + 64
            written = memory[start : start + 128 * 128].count(0xEE)
        assert written == 128 * 128 // 2, "it died in the middle"
        samples, dropped = ring.take()
    assert sequences(samples) == [*range(before)][-4:]
    assert dropped == before - len(samples)
    for sample in samples:
        assert isinstance(sample, Frame)
        assert (sample.image == sample.sequence + 1).all()


class Overtaken(Ring):
    """A consumer that the producer overtakes while it copies its first sample: `puts` more come between two halves."""

    puts = torn = 0

    def _copy(self, notice) -> bytes:  # type: ignore[no-untyped-def]
        begun = super()._copy(notice)
        for _ in range(self.puts):
            self.producer.put(frame(self.producer_next))
            self.producer_next += 1
        self.puts, half = 0, len(begun) // 2
        copy = begun[:half] + super()._copy(notice)[half:]
        self.torn += copy != begun
        return copy


@pytest.mark.parametrize("puts", range(9))
def test_what_is_overwritten_while_it_is_copied_is_dropped_and_counted(puts: int) -> None:
    with Ring(SMALL) as producer, Overtaken(SMALL, RingFds(*map(os.dup, producer.fds))) as consumer:
        consumer.producer, consumer.producer_next, consumer.puts = producer, 4, puts
        for sequence in range(4):
            producer.put(frame(sequence))
        samples, dropped = consumer.take()
        assert consumer.torn == (puts > 2), "from the third on it is written over"
        assert sequences(samples) == [*range(4)][puts:]
        assert dropped == 4 - len(samples)
        for sample in samples:
            assert isinstance(sample, Frame)
            assert (sample.image == sample.sequence).all()
        assert consumer.pending == (puts > 0)
        samples, dropped = consumer.take()
        assert sequences(samples) == [*range(4, 4 + puts)][-4:]
        assert dropped == puts - len(samples)


def test_a_consumer_that_hangs_holds_nobody_up_and_every_loss_is_counted() -> None:
    with Ring(SMALL) as producer, Ring(SMALL, RingFds(*map(os.dup, producer.fds))) as consumer:
        producer.put(frame(0))
        assert sequences(consumer.take()[0]) == [0]
        longest_s, total = 0.0, 10_000
        for sequence in range(1, total):
            start_s = time.perf_counter()
            producer.put(frame(sequence, (2, 2)))
            longest_s = max(longest_s, time.perf_counter() - start_s)
        assert longest_s < 0.5
        samples, dropped = consumer.take()
        assert sequences(samples) == [*range(total)][-4:]
        assert dropped == total - 1 - 4


def test_a_sample_wakes_who_waits_for_it() -> None:
    with Ring(SMALL) as ring:
        waiting = select.poll()
        waiting.register(ring, select.POLLIN)
        assert waiting.poll(0) == []
        ring.put(frame(0))
        assert waiting.poll(0) == [(ring.fileno(), select.POLLIN)]
        ring.take()
        assert waiting.poll(0) == []


def test_the_successor_of_a_dead_consumer_takes_what_is_new() -> None:
    with Ring(SMALL) as producer:
        with Ring(SMALL, RingFds(*map(os.dup, producer.fds))) as first:
            producer.put(frame(0))
            assert sequences(first.take()[0]) == [0]
        for sequence in range(1, 4):
            producer.put(frame(sequence))
        with Ring(SMALL, RingFds(*map(os.dup, producer.fds))) as second:
            second.discard()
            assert second.take() == ([], 0)
            for sequence in range(4, 10):
                producer.put(frame(sequence))
            samples, dropped = second.take()
    assert (sequences(samples), dropped) == ([6, 7, 8, 9], 2)
