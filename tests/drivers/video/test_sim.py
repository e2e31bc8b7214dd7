"""The sim: driver against the real scanner twin in a process of its own, and against bytes that are not frames."""

import json
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack
from pathlib import Path
from threading import Event, Thread

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.device_api import VideoSource
from probewatch.drivers.errors import ConfigurationError, DeviceLost, ProtocolError
from probewatch.drivers.registry import open_video
from probewatch.drivers.samples import Frame, GreyImage
from probewatch.drivers.twins.fault_control import FaultControl
from probewatch.drivers.twins.faults import FUTURE_S, PICTURE_FAULTS, Episode, Schedule
from probewatch.drivers.twins.scanner import Scanner, VideoPlug
from probewatch.drivers.twins.scene.world import World, WorldSettings
from probewatch.drivers.video.sim import HEADER_BYTES, FrameHeader, pack_frame
from tests.support.polling import until
from tests.support.simulated import PROBEWATCH
from tests.support.stopwatch import Stopwatch

IMAGE = np.random.default_rng(2).integers(0, 256, (24, 32), np.uint8)


class Twin:
    """faults: how its control file begins."""

    def __init__(self, path: Path, faults: object = (), *more: str) -> None:
        self.control = path.with_name("faults.json")
        self.control.write_text(json.dumps(faults))
        self.origin_ns = time.monotonic_ns()
        command = [*PROBEWATCH, "simulate", "scanner", "--socket", str(path)]
        command += ["--origin-ns", str(self.origin_ns), "--control", str(self.control), *more]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.ready = json.loads(self.process.stdout.readline())

    def end(self, number: int = signal.SIGTERM) -> int:
        self.process.send_signal(number)
        assert self.process.stdout is not None
        assert self.process.stderr is not None
        # Not communicate(): it loses what readline() has read ahead.
        self.output, self.errors = self.process.stdout.read(), self.process.stderr.read()
        return self.process.wait(10)


@pytest.fixture
def twin_at() -> Iterator[Callable[..., Twin]]:
    """Starts twins, and ends those that the test has left."""
    with ExitStack() as left:

        def start(path: Path, faults: object = (), *more: str) -> Twin:
            twin = Twin(path, faults, *more)
            left.callback(twin.process.communicate)
            left.callback(twin.process.kill)
            return twin

        yield start


def frames(source: VideoSource, number: int) -> list[Frame]:
    found = [until(lambda: source.read(1.0)) for _ in range(number)]
    return [frame for frame in found if frame is not None]


def watch(source: VideoSource, seen: list[Frame]) -> None:
    """Collect frames until the source raises; one that never does must not go on for ever."""
    while len(seen) < 1000:
        frame = source.read(2.0)
        if frame is not None:
            seen.append(frame)


def test_frames_arrive_on_time_and_show_the_world(tmp_path: Path, twin_at: Callable[..., Twin]) -> None:
    twin = twin_at(tmp_path / "video", (), "--seed", "4")
    assert twin.ready == {"ready": True, "url": f"sim:{tmp_path}/video"}
    with open_video(twin.ready["url"], HostClock()) as source:
        received = []
        for _ in range(8):
            frame = until(lambda: source.read(1.0))
            assert frame is not None
            received.append((time.monotonic_ns(), frame))
    for arrival_ns, frame in received:
        assert frame.stamp.t_ns == twin.origin_ns + round(frame.sequence / 30 * 1e9)
        assert 0 < frame.stamp.err_ns <= 5_000_000
        assert arrival_ns >= frame.stamp.t_ns
    assert np.median([(arrival_ns - frame.stamp.t_ns) / 1e6 for arrival_ns, frame in received]) < 60
    sequences = [frame.sequence for _, frame in received]
    assert sequences == sorted(set(sequences))
    last = received[-1][1]
    assert np.array_equal(last.image, World(4).frame(last.sequence / 30, last.sequence))
    assert twin.end() == 0
    assert twin.errors == ""
    assert not (tmp_path / "video").exists()


@pytest.mark.thorough
def test_a_killed_scanner_is_lost_and_comes_back(tmp_path: Path, twin_at: Callable[..., Twin]) -> None:
    twin = twin_at(tmp_path / "video")
    with open_video(twin.ready["url"], HostClock()) as source:
        frames(source, 2)
        twin.end(signal.SIGKILL)
        with pytest.raises(DeviceLost, match="closed the video"):
            watch(source, [])
    with pytest.raises(DeviceLost, match="running"):
        open_video(twin.ready["url"], HostClock())
    again = twin_at(tmp_path / "video")
    with open_video(again.ready["url"], HostClock()) as source:
        assert len(frames(source, 2)) == 2
    with open_video(again.ready["url"], HostClock()) as source:
        assert len(frames(source, 2)) == 2
    assert again.end() == 0


@pytest.mark.thorough
def test_scheduled_faults_show_in_the_video(tmp_path: Path, twin_at: Callable[..., Twin]) -> None:
    schedule = [
        {"fault": "freeze-video", "from_s": 16, "to_s": 19},
        {"fault": "lose-video", "from_s": 21, "to_s": 23},
        {"fault": "flip-vertical", "from_s": 23},
    ]
    rate = 4.0
    twin = twin_at(tmp_path / "video", schedule, "--rate", str(rate), "--fps", "10")
    clock = HostClock(rate, twin.origin_ns)
    seen: list[Frame] = []
    with open_video(twin.ready["url"], clock) as source, pytest.raises(DeviceLost):
        watch(source, seen)
    frozen = [frame for frame in seen if 16 <= frame.sequence / 10 < 19]
    assert len(frozen) >= 10
    assert all(np.array_equal(frame.image, frozen[0].image) for frame in frozen)
    assert len({frame.sequence for frame in frozen}) == len(frozen)
    moving = [frame for frame in seen if frame.sequence / 10 >= 19]
    assert not np.array_equal(moving[0].image, moving[-1].image)
    assert max(frame.sequence for frame in seen) < 210

    def reopened() -> VideoSource | None:
        try:
            return open_video(twin.ready["url"], clock)
        except DeviceLost:
            return None

    with until(reopened) as source:
        frame = frames(source, 1)[0]
    assert frame.sequence >= 230
    assert np.array_equal(frame.image, World().frame(frame.sequence / 10, frame.sequence, {"flip-vertical"}))
    assert twin.end() == 0
    events = [json.loads(line) for line in twin.output.splitlines()]
    assert [event["faults"] for event in events if "faults" in event][:2] == [["freeze-video"], []]


def test_a_bad_fault_is_refused_by_name_and_the_twin_goes_on(tmp_path: Path, twin_at: Callable[..., Twin]) -> None:
    twin = twin_at(tmp_path / "video", [{"fault": "fire", "from_s": 1}])
    with open_video(twin.ready["url"], HostClock()) as source:
        assert len(frames(source, 2)) == 2
    assert twin.end() == 0
    refused = [event["refused"] for event in map(json.loads, twin.output.splitlines()) if "refused" in event]
    assert len(refused) == 1
    assert "line 1: 'fire' is not a known fault" in refused[0]
    assert "flip-lateral" in refused[0]


@pytest.fixture
def wire(tmp_path: Path) -> Iterator[tuple[VideoSource, socket.socket]]:
    with socket.socket(socket.AF_UNIX) as door:
        door.bind(str(tmp_path / "wire"))
        door.listen(1)
        with open_video(f"sim:{tmp_path}/wire", HostClock()) as source:
            far, _ = door.accept()
            with far:
                yield source, far


def test_a_frame_in_parts_is_kept_until_it_is_whole(wire: tuple[VideoSource, socket.socket]) -> None:
    source, far = wire
    data = pack_frame(7, 123_456, 99, IMAGE) + pack_frame(9, 234_567, 98, IMAGE[::-1])
    for end in (10, HEADER_BYTES + 5, len(data) // 2 - 1):
        far.sendall(data[:end])
        data = data[end:]
        if end < 100:
            assert source.read(0.02) is None
    far.sendall(data)
    first, second = frames(source, 2)
    assert (first.sequence, first.stamp.t_ns, first.stamp.err_ns) == (7, 123_456, 99)
    assert np.array_equal(first.image, IMAGE)
    assert (second.sequence, second.image[0, 0]) == (9, IMAGE[-1, 0])


def test_waiting_ends_at_the_deadline_though_bytes_trickle(wire: tuple[VideoSource, socket.socket]) -> None:
    source, far = wire
    far.sendall(pack_frame(1, 0, 0, IMAGE)[:-1])
    watch = Stopwatch()
    assert source.read(0.1) is None
    assert watch.elapsed_s() > 0.09
    assert watch.spent_s() < 1.0


def test_an_end_within_a_frame_is_a_loss(wire: tuple[VideoSource, socket.socket]) -> None:
    source, far = wire
    far.sendall(pack_frame(1, 0, 0, IMAGE)[:-1])
    far.close()
    with pytest.raises(DeviceLost, match="in the middle of a frame"):
        source.read(1.0)


def test_garbage_is_refused(wire: tuple[VideoSource, socket.socket]) -> None:
    source, far = wire
    far.sendall(b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n")
    with pytest.raises(ProtocolError, match="no frame starts here"):
        source.read(1.0)


@pytest.mark.parametrize(
    ("place", "value", "names"),
    [(0, b"X", "PWSV"), (4, b"\x02", "version 2"), (6, b"\x10", "16 bits"), (28, b"\xff\xff\xff\xff", "plausible")],
)
def test_each_field_of_the_header_is_bounded(place: int, value: bytes, names: str) -> None:
    header = bytearray(FrameHeader(1, 2, 3, 640, 480).pack())
    header[place : place + len(value)] = value
    with pytest.raises(ProtocolError, match=names):
        FrameHeader.parse(bytes(header), "sim:x")
    with pytest.raises(ProtocolError, match="36 bytes"):
        FrameHeader.parse(bytes(header[:-1]))


@given(
    st.binary(min_size=HEADER_BYTES, max_size=HEADER_BYTES)
    | st.binary(min_size=28, max_size=28).map(lambda b: b"PWSV\1\0\x08\0" + b)
)
def test_no_header_breaks_the_parser(data: bytes) -> None:
    try:
        header = FrameHeader.parse(data)
    except ProtocolError:
        return
    assert header.pack() == data
    assert header.body_bytes <= 4096 * 4096


def test_absent_and_impossible_sockets_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(DeviceLost, match="no such file"):
        open_video(f"sim:{tmp_path}/nothing", HostClock())
    with pytest.raises(ConfigurationError, match="longer than 107"):
        open_video("sim:/" + "x" * 120, HostClock())
    with pytest.raises(ConfigurationError, match="unknown option 'gain'"):
        open_video(f"sim:{tmp_path}/nothing?gain=3", HostClock())
    (tmp_path / "file").touch()
    with pytest.raises(DeviceLost):
        open_video(f"sim:{tmp_path}/file", HostClock())


class Grey(World):
    """Its pictures cost nothing."""

    def frame(self, t_s: float, index: int, active: Collection[str] = ()) -> GreyImage:
        return np.full((24, 32), 100, np.uint8)


def test_a_flicker_blanks_every_second_picture_and_one_stamp_is_of_the_future(tmp_path: Path) -> None:
    faults = Schedule((Episode("flicker-blank", 1.0, 3.0), Episode("future-stamp", 2.0, 3.0)))
    clock, stop = HostClock(4.0), Event()
    with VideoPlug(tmp_path / "video") as plug, open_video(f"sim:{tmp_path}/video", clock) as source:
        world = Grey(1, settings=WorldSettings(fps=10))
        thread = Thread(target=Scanner(world, plug, clock, FaultControl(PICTURE_FAULTS, faults)).run, args=(stop,))
        thread.start()
        try:
            seen = frames(source, 40)
        finally:
            stop.set()
            thread.join()
    for frame in seen:
        flickering = 10 <= frame.sequence < 30
        assert (frame.image.max() < 10) == (flickering and frame.sequence % 2 == 1), frame.sequence
    ahead = {
        frame.sequence: round((frame.stamp.t_ns - clock.origin_ns) / 1e9 - frame.sequence / 10, 3) for frame in seen
    }
    early = {sequence: ahead_s for sequence, ahead_s in ahead.items() if ahead_s != 0}
    assert list(early.values()) == [FUTURE_S]
    assert min(early) >= 20, "the first of the fault"


class Waiting(World):
    """Its third picture waits for the processor."""

    def frame(self, t_s: float, index: int, active: Collection[str] = ()) -> GreyImage:
        self.pictures = getattr(self, "pictures", 0) + 1
        if self.pictures == 3:
            time.sleep(3.0)
        return super().frame(t_s, index, active)


@pytest.mark.thorough
def test_a_scanner_that_was_short_of_time_shows_pictures_again_at_once(tmp_path: Path) -> None:
    """It renders ahead by what a picture costs; what it waited for the processor is no cost."""
    clock, stop = HostClock(), Event()
    with VideoPlug(tmp_path / "video") as plug:
        scanner = Scanner(Waiting(1), plug, clock, FaultControl(PICTURE_FAULTS))
        thread = Thread(target=scanner.run, args=(stop,))
        thread.start()
        try:
            with open_video(f"sim:{tmp_path}/video", clock) as source:
                until(lambda: (found := source.read(1.0)) is not None and found.stamp.t_ns > clock.origin_ns + 3e9)
                watch = Stopwatch()
                frames(source, 6)
                assert watch.spent_s() < 1.2
        finally:
            stop.set()
            thread.join()
