"""The feed with its real processes: what comes out is what the line took and said, and no client moves a verdict."""

import json
import os
import signal
import socket
import stat
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from probewatch.appliance.core.line import Line
from probewatch.appliance.limits import Limits
from probewatch.appliance.service.estimator.process_host import EstimatorHost
from probewatch.appliance.service.feed.message import FeedMessage, Judged, LineStarted, Lost, Taken, unpacked
from probewatch.appliance.service.feed.process_host import FeedHost
from probewatch.appliance.service.feed.request import FeedRequest
from probewatch.appliance.service.feed.server import MOST_CLIENTS, MOST_UNSENT, reduced
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.appliance.types import Calibration, Verdict
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Sample, Stamp
from probewatch.drivers.twins.scene.world import World, WorldSettings
from probewatch.tools.shared.feed import Feed
from tests.support import stand_in_estimator as stand_in
from tests.support.polling import until
from tests.support.stopwatch import Stopwatch

STAND_IN = (sys.executable, "-m", "tests.support.stand_in_estimator")
SIZE_PX = (240, 180)


def reference(scale: float = 0.25) -> Calibration:
    return Calibration(np.eye(3), (1, 1), np.array([scale, scale]), np.zeros(3), (64, 48))


def frame(number: int, order: int = stand_in.OK, size_px: tuple[int, int] = (64, 48)) -> Frame:
    return Frame(Stamp(number * 1_000_000, 5), number, np.full(size_px[::-1], order, np.uint8))


class Service:
    """Estimator and feed, ticked by a thread as the service's tick does."""

    def __init__(self, folder: Path, command: tuple[str, ...] | None = STAND_IN, known: bool = True) -> None:
        self.path = folder / "feed"
        self.feed = FeedHost(self.path)
        options = {} if command is None else {"command": command}
        self.estimator = EstimatorHost(reference() if known else None, Limits(), 500_000_000, **options)
        self.estimator.tap = self.feed.tap
        self.verdicts: list[Verdict] = []
        self.slowest_s = 0.0
        self._end, self._heard = threading.Event(), False
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> "Service":
        self._thread.start()
        until(lambda: self._heard, 30)
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()
        self.estimator.close()
        self.feed.close()

    def _run(self) -> None:
        while not self._end.wait(0.002):
            heard, verdicts = self.estimator.poll()
            self._heard = self._heard or heard
            self.verdicts += verdicts
            watch = Stopwatch()
            self.feed.look_after()
            self.slowest_s = max(self.slowest_s, watch.spent_s())

    def judged(self, sample: Frame) -> Verdict:
        """Put it, and wait for its verdict."""
        before = len(self.verdicts)
        self.estimator.put(sample)
        until(lambda: len(self.verdicts) > before)
        return self.verdicts[-1]


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """One for all tests whose clients only misbehave."""
    with Service(tmp_path_factory.mktemp("feed")) as service:
        yield service
        assert service.estimator.restarts == 0


def found(feed: Feed, wanted: Callable[[FeedMessage], bool]) -> list[FeedMessage]:
    """All messages up to the one that is wanted."""
    messages: list[FeedMessage] = []
    while not messages or not wanted(messages[-1]):
        message = feed.next(10)
        assert message is not None, messages
        messages.append(message)
    return messages


def of(number: int) -> Callable[[FeedMessage], bool]:
    """The verdict on that picture."""
    return lambda message: isinstance(message, Judged) and message.verdict.t_ns == number * 1_000_000


def scan(frames: int, seed: int = 1) -> tuple[Calibration, list[Sample]]:
    """A reference, and what scanner and tracker see of tissue, in order of time."""
    world = World(seed, settings=WorldSettings(*SIZE_PX))
    samples: list[Sample] = []
    for index in range(frames):
        t_s = index / 30
        samples.append(Frame(Stamp(round(t_s * 1e9), 40_000), index, world.frame(t_s, index)))
        for half in range(2):
            pose_s = t_s + (half + 0.5) / 60
            number = 2 * index + half
            pose = world.measured_pose(pose_s, number)
            samples.append(Pose(Stamp(round(pose_s * 1e9), 100_000), number, pose, 0.1 + number / 7, PoseStatus.OK))
    return calibration_from_image_to_probe(world.image_to_probe, SIZE_PX), samples


def given(service: Service, samples: list[Sample], wanted: int, heard: Callable[[], object]) -> tuple[Verdict, ...]:
    """All of them, none dropped on the way: each waits until those before have been taken, and heard."""
    before, taken = len(service.verdicts), service.estimator.last.frames + service.estimator.last.poses
    for number, sample in enumerate(samples, 1):
        service.estimator.put(sample)
        if number % 4 == 0:
            until(lambda all_of=taken + number: service.estimator.last.frames + service.estimator.last.poses >= all_of)
        heard()
    until(lambda: len(service.verdicts) >= before + wanted, 60)
    return tuple(service.verdicts[before:])


@pytest.mark.thorough
def test_what_was_fed_gives_the_same_verdicts_again_bit_for_bit(tmp_path: Path) -> None:
    """On the real line; and the verdicts are those of a service that nobody listens to."""
    calibration, samples = scan(60)
    line = Line(calibration, Limits(), 500_000_000)
    alone = [verdict for sample in samples for verdict in line.step(sample)]
    with Service(tmp_path, command=None, known=False) as service:
        with Feed(service.path) as feed:
            until(lambda: service.feed.counts.clients == 1)
            service.estimator.set_reference(calibration)
            until(lambda: service.estimator.last.generation == 1)
            messages: list[FeedMessage] = []

            def hear() -> None:
                while (message := feed.next(0.001)) is not None:
                    messages.append(message)

            said = given(service, samples, len(alone), hear)
            if not any(map(of_time(said[-1].t_ns), messages)):
                messages += found(feed, of_time(said[-1].t_ns))
        until(lambda: service.feed.counts.clients == 0)
        service.estimator.set_reference(calibration)
        until(lambda: service.estimator.last.generation == 2)
        unheard = given(service, samples, len(alone), lambda: None)
    assert repr(said) == repr(unheard) == repr(tuple(alone))
    assert not [message for message in messages if isinstance(message, Lost)]
    (started,) = (message for message in messages if isinstance(message, LineStarted))
    assert started.step == 0
    again = Line(started.settings.reference, started.settings.limits, started.settings.stale_ns)
    told: list[Verdict] = []
    replayed: list[Verdict] = []
    for message in messages:
        if isinstance(message, Taken):
            replayed += again.step(message.sample)
        elif isinstance(message, Judged):
            told.append(message.verdict)
    assert repr(tuple(replayed)) == repr(tuple(told)) == repr(said)
    steps = [message.step for message in messages if isinstance(message, Taken)]
    assert steps == list(range(len(steps)))


def of_time(t_ns: int) -> Callable[[FeedMessage], bool]:
    return lambda message: isinstance(message, Judged) and message.verdict.t_ns == t_ns


def test_nobody_runs_and_nothing_is_wanted_while_nobody_listens(tmp_path: Path) -> None:
    with Service(tmp_path) as service:
        for number in range(20):
            service.judged(frame(number))
        assert service.feed.pid is None
        assert service.feed.counts == (0, 0, 0)
        assert stat.S_IMODE(service.path.stat().st_mode) == 0o660
    assert not service.path.exists()


def test_a_client_that_comes_late_is_told_at_which_step(service: Service) -> None:
    with Feed(service.path) as feed:
        service.judged(frame(101))
        messages = found(feed, of(101))
        with Feed(service.path) as second:
            service.judged(frame(103))
            others = found(second, of(103))
    first = next(message for message in messages if isinstance(message, Taken))
    assert first.sample.image.shape == (48, 64)
    started = next(message for message in others if isinstance(message, LineStarted))
    taken = [message.step for message in others if isinstance(message, Taken)]
    assert taken[0] == started.step
    assert started.settings.reference.image_size_px == (64, 48)


def test_another_reference_is_told_in_its_place(service: Service) -> None:
    with Feed(service.path) as feed:
        generation = service.estimator.last.generation
        service.estimator.set_reference(reference(0.5))
        until(lambda: service.estimator.last.generation == generation + 1)
        service.judged(frame(201))
        messages = found(feed, of(201))
    starts = [message for message in messages if isinstance(message, LineStarted) and message.step == 0]
    assert starts[-1].settings.reference.scale_mm_per_px.tolist() == [0.5, 0.5]
    assert isinstance(messages[-2], Taken)
    assert messages[-2].step == 0


def test_a_client_chooses_how_many_pictures_and_how_large(service: Service) -> None:
    with (
        Feed(service.path, FeedRequest(every=3, most_px=32)) as few,
        Feed(service.path, FeedRequest(pictures=False)) as none,
    ):
        for number in range(310, 322):
            service.judged(frame(number))
        some, words = found(few, of(321)), found(none, of(321))
    pictures = [message for message in some if isinstance(message, Taken)]
    assert {message.sample.image.shape for message in pictures} == {(24, 32)}
    assert {message.reduced_by for message in pictures} == {2}
    assert sum(message.sample.sequence >= 310 for message in pictures) == 4
    assert not [message for message in words if isinstance(message, Taken)]
    assert sum(isinstance(message, Judged) for message in words) >= 12
    assert not [message for message in (*some, *words) if isinstance(message, Lost)]


def test_a_picture_is_reduced_to_the_means_of_its_blocks() -> None:
    image = np.arange(35, dtype=np.uint8).reshape(5, 7)
    assert reduced(image, 2).tolist() == [[4, 6, 8], [18, 20, 22]]


@pytest.mark.thorough
def test_who_does_not_read_loses_samples_and_is_told_how_many(service: Service) -> None:
    """Everybody else, and the line, go on."""
    large_px = (1280, 960)
    pictures = 3 * MOST_UNSENT // (large_px[0] * large_px[1])
    with Feed(service.path) as asleep, Feed(service.path) as awake:
        seen: list[FeedMessage] = []
        for number in range(410, 410 + pictures):
            service.judged(frame(number, size_px=large_px))
            seen += found(awake, of(number))
        messages = found(asleep, lambda message: isinstance(message, Lost))
        service.judged(frame(900))
        messages += found(asleep, of(900))
    assert not [message for message in seen if isinstance(message, Lost)]
    counted = sum(message.samples for message in messages if isinstance(message, Lost))
    taken = {message.sample.sequence for message in messages if isinstance(message, Taken)}
    numbers = {*range(410, 410 + pictures)}
    assert counted == len(numbers - taken) > 0
    steps = [message.step for message in messages if isinstance(message, Taken)]
    assert steps == sorted(steps)


def test_garbage_a_crowd_and_a_sudden_death_are_nobody_elses_business(service: Service) -> None:
    with Feed(service.path) as feed, ExitStack() as running:
        before = len(service.verdicts)
        for said in (b"\xff" * 10_000, b"GET / HTTP/1.1\r\n\r\n", b"{}\n", b"\0", b'{"v": 1}\nand more'):
            with socket.socket(socket.AF_UNIX) as link:
                link.connect(str(service.path))
                link.sendall(said)
        crowd = [running.enter_context(socket.socket(socket.AF_UNIX)) for _ in range(100)]
        for link in crowd:
            link.connect(str(service.path))
        died = Feed(service.path)
        died._link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        for number in range(1001, 1021):
            service.judged(frame(number, size_px=(640, 480)))
            if number == 1010:
                died.close()  # amid a picture: it has read nothing
        found(feed, of(1020))
    assert len(service.verdicts) == before + 20
    assert service.estimator.last.dropped_frames == 0


def test_a_request_without_an_end_is_refused_in_words(service: Service) -> None:
    with socket.socket(socket.AF_UNIX) as link:
        link.connect(str(service.path))
        link.sendall(b'{"v": 1}')
        link.shutdown(socket.SHUT_WR)
        assert b"ends with a line feed" in link.makefile("rb").read()


@pytest.mark.parametrize(
    ("said", "why"),
    [
        (b'{"v": 1}' + b" " * 4096 + b"\n", b"a request has at most 4096 bytes"),
        (b'{"v": 1}\nand more', b"one line is asked, and nothing after it"),
    ],
)
def test_a_request_that_is_too_long_is_told_from_one_that_goes_on(service: Service, said: bytes, why: bytes) -> None:
    with socket.socket(socket.AF_UNIX) as link:
        link.connect(str(service.path))
        link.sendall(said)
        link.shutdown(socket.SHUT_WR)
        assert why in link.makefile("rb").read()


def test_a_message_can_be_kept_as_it_came(service: Service) -> None:
    with Feed(service.path) as feed:
        service.judged(frame(1100))
        header, pixels = feed.next_raw(10)
        assert isinstance(unpacked(header, pixels), LineStarted)
        header, pixels = feed.next_raw(10)
        assert (json.loads(header)["kind"], len(pixels)) == ("frame", 64 * 48)
        assert feed.next_raw(10) is not None
        assert feed.next_raw(0.05) is None


def test_there_are_so_many_places(service: Service) -> None:
    until(lambda: service.feed.counts.clients == 0)
    feeds = [Feed(service.path) for _ in range(MOST_CLIENTS)]
    with pytest.raises(DeviceLost, match="8 clients listen already"):
        Feed(service.path)
    for feed in feeds:
        feed.close()
    until(lambda: service.feed.counts.clients == 0)
    Feed(service.path).close()


def test_who_is_shown_no_pictures_hears_the_words_alone(tmp_path: Path) -> None:
    service = Service(tmp_path)
    service.feed.close()
    service.feed = FeedHost(tmp_path / "feed", without_pictures=(os.getuid(),))
    service.estimator.tap = service.feed.tap
    with service:
        with pytest.raises(DeviceLost, match="your user is shown no pictures"):
            Feed(service.path)
        with Feed(service.path, FeedRequest(pictures=False)) as feed:
            service.judged(frame(1))
            messages = found(feed, of(1))
    assert not any(isinstance(message, Taken) and isinstance(message.sample, Frame) for message in messages)


@pytest.mark.thorough
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_feed_that_dies_or_hangs_moves_no_verdict(tmp_path: Path, how: signal.Signals) -> None:
    with Service(tmp_path) as service, Feed(service.path) as feed:
        os.kill(service.feed.pid, how)
        for number in range(10, 500):
            service.judged(frame(number))
        assert service.estimator.restarts == 0
        assert service.estimator.last.dropped_frames == 0
        if how is signal.SIGKILL:
            with pytest.raises(DeviceLost):
                found(feed, of(499))
            until(lambda: service.feed.pid is None)
            Feed(service.path).close()
        else:
            os.kill(service.feed.pid, signal.SIGCONT)
            messages = found(feed, lambda message: isinstance(message, Lost))
            service.judged(frame(700))
            messages += found(feed, of(700))
            taken = {message.sample.sequence for message in messages if isinstance(message, Taken)}
            counted = sum(message.samples for message in messages if isinstance(message, Lost))
            assert counted == 490 - len(taken & {*range(10, 500)})


@pytest.mark.thorough
def test_an_estimator_that_dies_is_told_as_the_end(tmp_path: Path) -> None:
    with Service(tmp_path) as service, Feed(service.path) as feed:
        os.kill(service.estimator.pid, signal.SIGKILL)
        with pytest.raises(DeviceLost, match="no service offers its feed"):
            found(feed, lambda message: False)
        until(lambda: service.estimator.restarts == 1 and service.estimator.reporting)
        Feed(service.path).close()


def test_what_is_in_the_way_is_told_and_the_service_goes_on(tmp_path: Path) -> None:
    (tmp_path / "feed").write_text("a file")
    with Service(tmp_path) as service:
        assert "another file of that name" in service.feed.refused
        service.judged(frame(1))
    assert (tmp_path / "feed").read_text() == "a file"
    assert FeedHost(None).refused == "[feed] offered = false"
    assert "nowhere" in FeedHost(tmp_path / "nowhere" / "feed").refused or FeedHost(tmp_path / "no" / "feed").refused
