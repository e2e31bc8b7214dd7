"""The threads that keep devices open, and the log writer: what hangs, breaks or is slow holds up nobody else."""

import contextlib
import errno
import io
import json
import os
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Self

import numpy as np
import pytest
import structlog

from probewatch.appliance.service.devices.backoff import Backoff
from probewatch.appliance.service.devices.output_thread import OutputThread
from probewatch.appliance.service.devices.rate_meter import RateMeter
from probewatch.appliance.service.devices.source_thread import CaptureThread, TrackerThread
from probewatch.appliance.service.host.log import configure, get_log
from probewatch.appliance.supervision.annunciator import Role
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.device_api import Description
from probewatch.drivers.errors import ConfigurationError, DeviceLost, ProtocolError
from probewatch.drivers.samples import Frame, MarkerBody, Pose, PoseStatus, Sample, Stamp
from tests.support.polling import until
from tests.support.stopwatch import Stopwatch

CLOCK = HostClock()


class Contact:
    """An output whose device may be made to fail or hang."""

    def __init__(self) -> None:
        self.states: list[bool] = []
        self.broken = False
        self.flowing = threading.Event()
        self.flowing.set()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.states.append(False)

    def write(self, energised: bool) -> None:
        self.flowing.wait()
        if self.broken:
            raise DeviceLost("unplugged", "relay:/dev/x", "Plug it in")
        self.states.append(energised)


@pytest.fixture
def contact() -> Contact:
    return Contact()


@pytest.fixture
def output(contact: Contact) -> Iterator[OutputThread]:
    thread = OutputThread(Role.CONTACT, "relay:/dev/x", lambda url, clock: contact, CLOCK)
    thread.start()
    yield thread
    contact.flowing.set()
    thread.stop()
    thread.join(5)
    assert not thread.is_alive()


@pytest.fixture(autouse=True)
def _structlog_as_it_was() -> Iterator[None]:
    yield
    structlog.reset_defaults()


def commanded(output: OutputThread, energised: bool) -> Callable[[], bool]:
    def look() -> bool:
        output.command(energised, CLOCK.now_ns())
        return output.energised is energised

    return look


def test_a_contact_follows_its_commands_and_opens_at_the_end(output: OutputThread, contact: Contact) -> None:
    until(commanded(output, True))
    until(commanded(output, False))
    until(commanded(output, True))
    output.stop()
    output.join(5)
    assert contact.states[-1] is False


def test_a_contact_opens_when_the_tick_falls_silent(output: OutputThread) -> None:
    until(commanded(output, True))
    until(lambda: output.energised is False, 0.5)


def test_a_hanging_output_does_not_hold_up_the_one_who_commands(output: OutputThread, contact: Contact) -> None:
    until(commanded(output, True))
    contact.flowing.clear()
    watch = Stopwatch()
    for _ in range(1000):
        output.command(True, CLOCK.now_ns())
    assert watch.spent_s() < 0.5
    written_ns = output.written_ns
    assert written_ns is not None
    until(lambda: CLOCK.now_ns() - written_ns > 300_000_000)
    assert output.written_ns == written_ns, "its silence shows"


def test_a_command_that_waited_behind_a_hanging_output_is_not_carried_out(
    output: OutputThread, contact: Contact
) -> None:
    """The tick may have died since."""
    until(commanded(output, True))
    contact.flowing.clear()
    time.sleep(0.3)  # the thread hangs in a write now
    output.command(True, CLOCK.now_ns())
    time.sleep(0.3)
    before = len(contact.states)
    contact.flowing.set()
    until(lambda: len(contact.states) >= before + 3)
    assert contact.states[before + 1 :] == [False] * (len(contact.states) - before - 1), "the first was begun before"


def test_a_broken_output_is_opened_again(output: OutputThread, contact: Contact) -> None:
    until(commanded(output, True))
    contact.broken = True

    def lost() -> bool:
        output.command(True, CLOCK.now_ns())
        return output.lost is not None

    until(lost)
    assert "unplugged" in str(output.lost)
    until(lambda: output.energised is None)
    contact.broken = False
    until(lambda: commanded(output, True)() and output.lost is None)
    assert output.losses == 1


def test_while_the_computer_is_overloaded_a_flapping_device_is_said_once(
    output: OutputThread, contact: Contact
) -> None:
    lines = io.StringIO()
    with configure("info", lines):
        output._log = get_log(device="output")
        for number, overload_ns in enumerate((7, 7, 7, 9, None), 1):
            output.overload_ns = overload_ns
            contact.broken = True
            until(partial(_commanded, output, lambda thread, number=number: thread.losses == number))
            contact.broken = False
            until(partial(_commanded, output, lambda thread: thread.lost is None))
    said = [json.loads(line) for line in lines.getvalue().splitlines()]
    lost = [line.get("overloaded", False) for line in said if line["event"] == "device lost"]
    assert (output.losses, lost) == (5, [True, True, False]), "once for each overload, and always without one"
    assert len([line for line in said if line["event"] == "device back"]) == len(lost)


def _commanded(output: OutputThread, look: Callable[[OutputThread], bool]) -> bool:
    output.command(True, CLOCK.now_ns())
    return look(output)


class Tape:
    """A source that plays what it was given and then raises or falls silent."""

    def __init__(self, samples: list[Sample], end: Exception | None) -> None:
        self._samples, self._end = list(samples), end

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None: ...

    def read(self, timeout_s: float) -> Sample | None:  # type: ignore[override]
        if self._samples:
            return self._samples.pop(0)
        if self._end is not None:
            raise self._end
        time.sleep(timeout_s / 10)
        return None


def picture(sequence: int) -> Frame:
    return Frame(Stamp(sequence, 0), sequence, np.zeros((4, 4), np.uint8))


def test_capture_counts_what_the_device_sent_and_nobody_saw() -> None:
    seen: list[Sample] = []
    tapes = [
        Tape([picture(1), picture(2), picture(5)], DeviceLost("unplugged")),
        Tape([picture(0), picture(1)], None),
    ]
    thread = CaptureThread("video", "sim:/x", lambda url, clock: tapes.pop(0), seen.append, CLOCK)  # type: ignore[arg-type,return-value]
    thread.start()
    until(lambda: thread.samples == 5)
    thread.stop()
    thread.join(5)
    assert (thread.gaps, thread.losses, thread.lost, len(seen)) == (2, 1, None, 5)


def test_a_sample_stamped_later_than_it_arrived_is_refused_and_counted() -> None:
    seen: list[Sample] = []
    now_ns = CLOCK.now_ns()
    early = [Frame(Stamp(now_ns + 3600 * 10**9, err_ns), 1, picture(1).image) for err_ns in (0, 10**9)]
    late = Frame(Stamp(now_ns + 3600 * 10**9, 3601 * 10**9), 2, picture(1).image)
    tape = Tape([*early, late, picture(3)], None)
    thread = CaptureThread("video", "sim:/x", lambda url, clock: tape, seen.append, CLOCK)  # type: ignore[arg-type,return-value]
    thread.start()
    until(lambda: thread.samples == 2)
    thread.stop()
    thread.join(5)
    assert thread.early_stamps == 2
    assert [sample.sequence for sample in seen] == [2, 3], "the error of the stamp counts for it"


def test_a_picture_that_fits_no_slot_is_a_loss_with_a_remedy_not_a_crash() -> None:
    def refuse(sample: Sample) -> None:
        raise ValueError("a sample of 9 bytes does not fit a slot of 8")

    thread = CaptureThread("video", "sim:/x", lambda url, clock: Tape([picture(1)], None), refuse, CLOCK)  # type: ignore[arg-type,return-value]
    thread.start()
    until(lambda: thread.lost is not None)
    thread.stop()
    thread.join(5)
    assert "Lower the picture size" in str(thread.lost)
    assert thread.failure is None


def test_the_tracker_thread_tells_answers_from_news_from_poses() -> None:
    def pose(status: PoseStatus) -> Pose:
        return Pose(Stamp(1, 0), 1, np.eye(4) if status is PoseStatus.OK else None, 0.1, status)

    kinds = {
        PoseStatus.OK: (True, True, True),
        PoseStatus.MISSING: (True, True, False),
        PoseStatus.STALE: (True, False, False),
        PoseStatus.DISABLED: (False, True, False),
        PoseStatus.FAULT: (True, False, False),
        PoseStatus.NOT_UNDERSTOOD: (True, True, False),
    }
    for status, expected in kinds.items():
        thread = TrackerThread("tracker", "ndi:/x", lambda url, clock: Tape([], None), lambda _: None, CLOCK)  # type: ignore[arg-type,return-value]
        thread.note(pose(status), 7)
        noted = (thread.replies.reply_ns, thread.replies.fresh_ns, thread.replies.pose_ns)
        assert tuple(value == 7 for value in noted) == expected


class Bumped(Tape):
    """A tracker that was bumped, as long as nobody clears it; its first clearing fails."""

    def __init__(self, deaf: bool) -> None:
        super().__init__([], None)
        self.bumped, self._deaf = True, deaf

    def read(self, timeout_s: float) -> Sample | None:  # type: ignore[override]
        super().read(timeout_s)
        return Pose(Stamp(1, 0), 1, None, 0.1, PoseStatus.FAULT, "bumped" if self.bumped else "hot")

    def describe(self) -> Description:
        return Description("a tape", remarks=("low battery",))

    def clear_bump(self) -> None:
        if self._deaf:
            raise ProtocolError("no reply", "tape")
        self.bumped = False


def test_a_bump_is_cleared_in_the_tracker_that_is_open_and_in_no_later_one() -> None:
    tapes = [deaf := Bumped(True), later := Bumped(False), Bumped(False)]
    left = list(tapes)
    thread = TrackerThread("tracker", "ndi:/x", lambda url, clock: left.pop(0), lambda _: None, CLOCK)  # type: ignore[arg-type,return-value]
    assert not thread.clear_bump(), "nothing is open yet"
    thread.start()
    until(thread.clear_bump)
    until(lambda: thread.losses == 1 and thread.lost is None)
    until(lambda: thread.remarks == ("bumped", "low battery"))
    assert (deaf.bumped, later.bumped) == (True, True)
    assert thread.clear_bump()
    until(lambda: thread.remarks == ("hot", "low battery"))
    thread.stop()
    thread.join(5)
    assert not later.bumped
    assert not thread.clear_bump()


class Measuring(Tape):
    """A tracker that fits the markers ever worse, but for one look."""

    def __init__(self) -> None:
        super().__init__([], None)
        self.fits_mm = [0.2, 5.0, 0.3, None, 0.3, *[2.0] * 5]

    def body(self) -> MarkerBody:
        return MarkerBody(fit_mm=self.fits_mm.pop(0), shape_mm=0.1)


def test_one_bad_fit_is_not_taken_for_a_bad_body() -> None:
    tape = Measuring()
    thread = TrackerThread("tracker", "ndi:/x", lambda url, clock: tape, lambda _: None, HostClock(10.0))  # type: ignore[arg-type,return-value]
    seen = [_looked(thread, tape) for _ in range(10)]
    assert seen == pytest.approx([0.2, 2.6, 0.3, 0.3, 0.3, 1.15, 1.15, 2.0, 2.0, 2.0])
    assert thread.body is not None
    assert (thread.body.shape_mm, thread.body.indicator) == (0.1, None)


def _looked(thread: TrackerThread, tape: Measuring) -> float | None:
    thread._look(tape)  # type: ignore[arg-type]
    return thread.body.fit_mm if thread.body else None


def test_a_url_that_can_never_work_ends_the_thread_with_its_error() -> None:
    def never(url: str, clock: HostClock) -> Contact:
        raise ConfigurationError("channel 9 does not exist", url)

    thread = OutputThread(Role.CONTACT, "relay:/dev/x", never, CLOCK)
    thread.start()
    thread.join(5)
    assert isinstance(thread.failure, ConfigurationError)


def test_a_driver_that_has_no_descriptor_for_a_file_of_its_options_is_lost_and_not_misconfigured() -> None:
    def open_tracker(url: str, clock: HostClock) -> Tape:
        try:
            raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))
        except OSError as error:
            raise ConfigurationError("the tool definition cannot be read", "probe.rom") from error

    thread = TrackerThread("tracker", "ndi:/dev/x?probe=probe.rom", open_tracker, lambda pose: None, CLOCK)
    thread.start()
    said = until(lambda: thread.lost)
    thread.stop()
    thread.join()
    assert "this computer has no room for it (Too many open files)" in said
    assert thread.failure is None


def test_backoff_doubles_to_its_cap_and_starts_over() -> None:
    backoff = Backoff(0.1, 0.5)
    assert [backoff.next_s() for _ in range(5)] == [0.1, 0.2, 0.4, 0.5, 0.5]
    backoff.reset()
    assert backoff.next_s() == 0.1


def test_rate_is_of_the_last_whole_window() -> None:
    meter = RateMeter()
    for tick in range(41):
        meter.note(tick * 50_000_000, tick * 3)
    assert meter.per_s == 60.0


def test_the_log_is_one_json_object_a_line() -> None:
    reader, writer = os.pipe()
    with os.fdopen(reader) as lines, os.fdopen(writer, "w") as stream:
        with configure("info", stream):
            get_log(device="video").info("device back", url="sim:/tmp/Gerät")
            get_log().debug("not shown")
        stream.close()
        said = [json.loads(line) for line in lines]
    assert len(said) == 1
    assert {"device": "video", "event": "device back", "level": "info", "url": "sim:/tmp/Gerät"}.items() <= said[
        0
    ].items()


def test_a_log_that_nobody_reads_drops_lines_and_delays_nobody() -> None:
    reader, writer = os.pipe()
    lines = os.fdopen(reader)
    with contextlib.suppress(BrokenPipeError), os.fdopen(writer, "w") as stream:
        log = configure("info", stream)
        watch = Stopwatch()
        for _ in range(5000):
            get_log().info("x" * 100)
        assert watch.spent_s() < 2
        assert log.dropped > 0
        lines.close()
        log.close()


def test_a_log_that_was_not_read_for_a_while_says_how_many_lines_are_missing() -> None:
    reader, writer = os.pipe()
    with os.fdopen(reader) as lines, os.fdopen(writer, "w") as stream:
        log = configure("info", stream)
        for number in range(5000):
            get_log().info("line", number=number)
        heard, dropped = [], 0
        while (len(heard) + dropped) < 5000:
            said = json.loads(lines.readline())
            dropped += said.get("lines", 0)
            heard += [said["number"]] if said["event"] == "line" else []
        log.close()
    assert (dropped, heard) == (log.dropped, sorted(set(heard)))
    assert dropped > 0
