"""What the V4L2 source does with what a driver answers; the kernel's own vivid is asked in tests/cart."""

import errno
import fcntl
import os
from collections.abc import Iterator

import numpy as np
import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError, DeviceLost
from probewatch.drivers.registry import open_video
from probewatch.drivers.video.v4l2 import abi
from probewatch.drivers.video.v4l2.source import V4l2Video
from tests.support.descriptors import leaves_nothing_open
from tests.support.simulated_v4l2 import FLAGS, Driver, noise

NODE = "v4l2:/dev/null"


@pytest.fixture
def driver(monkeypatch: pytest.MonkeyPatch) -> Iterator[Driver]:
    made, real_open = Driver(), os.open

    def opened(path: str, flags: int, *rest: int) -> int:
        return os.dup(made.fd) if path == "/dev/null" else real_open(path, flags, *rest)

    monkeypatch.setattr(fcntl, "ioctl", made.ioctl)
    monkeypatch.setattr(os, "open", opened)
    yield made
    made.close()
    os.close(made.fd)


def opened(query: str = "", rate: float = 1.0) -> V4l2Video:
    source = open_video(NODE + query, HostClock(rate))
    assert isinstance(source, V4l2Video)
    return source


def test_pictures_come_with_their_number_and_time(driver: Driver) -> None:
    with opened() as source:
        driver.send(noise(seed=1).tobytes())
        driver.send(noise(seed=2).tobytes(), skip=3)
        first, second = source.read(1.0), source.read(1.0)
        assert source.read(0.01) is None
    assert first is not None
    assert second is not None
    np.testing.assert_array_equal(first.image, noise(seed=1))
    np.testing.assert_array_equal(second.image, noise(seed=2))
    assert second.sequence - first.sequence == 4
    assert first.stamp.err_ns == pytest.approx(20e6, rel=0.02)
    assert any("3 pictures were lost" in remark for remark in source.describe().remarks)


@pytest.mark.parametrize(
    ("rates_hz", "query", "taken"),
    [
        ({"YUYV": 5.0, "MJPG": 30.0}, "", "MJPG"),
        ({"YUYV": 25.0, "MJPG": 30.0}, "", "YUYV"),
        ({"YUYV": 5.0, "MJPG": 5.0}, "", "YUYV"),
        ({"YUYV": 5.0, "MJPG": 30.0}, "?format=YUYV", "YUYV"),
        ({"YUYV": 25.0, "MJPG": 60.0}, "?rate=60", "MJPG"),
    ],
)
def test_what_comes_often_enough_is_taken_before_what_loses_nothing(
    driver: Driver, rates_hz: dict[str, float], query: str, taken: str
) -> None:
    """1080p over USB: YUYV at 5 Hz, MJPG at 30."""
    driver.formats, driver.rates_hz = ["YUYV", "MJPG"], rates_hz
    with opened(query) as source:
        assert (driver.format, source.describe().rate_hz) == (taken, rates_hz[taken])


def test_pictures_that_come_seldom_are_remarked_with_what_may_come_more_often(driver: Driver) -> None:
    """A driver that keeps its rate while formats change reports 5 Hz of MJPG as well."""
    driver.formats, driver.rate_hz = ["YUYV", "MJPG"], 5.0
    told = "YUYV comes 5 times a second by the word of the device. format=MJPG may come more often, or a smaller size="
    for query, expected in (("", True), ("?rate=5", False), ("?format=YUYV", True)):
        with opened(query) as source:
            assert (told in source.describe().remarks) == expected, (query, source.describe().remarks)
    driver.formats = ["YUYV"]
    with opened() as source:
        assert any("A smaller size= may come" in remark for remark in source.describe().remarks)


def test_grey_is_preferred_and_another_format_is_taken_when_named(driver: Driver) -> None:
    with opened():
        assert driver.format == "GREY"
    with opened("?format=yuyv") as source:
        rows = np.repeat(noise(), 2, axis=1)
        driver.send(rows.tobytes())
        frame = source.read(1.0)
    assert driver.format == "YUYV"
    assert frame is not None
    np.testing.assert_array_equal(frame.image, noise())


def test_a_buffer_is_copied_before_the_driver_gets_it_back(driver: Driver) -> None:
    with opened() as source:
        driver.send(noise(seed=1).tobytes())
        frame = source.read(1.0)
        for seed in range(2, 8):
            driver.send(noise(seed=seed).tobytes())
            source.read(1.0)
    assert frame is not None
    np.testing.assert_array_equal(frame.image, noise(seed=1))


def test_damaged_pictures_are_dropped_and_counted(driver: Driver) -> None:
    with opened() as source:
        driver.send(noise().tobytes(), flags=FLAGS | abi.BUF_FLAG_ERROR)
        driver.send(noise().tobytes()[:1000])
        driver.send(noise(seed=9).tobytes())
        frame = source.read(1.0)
        assert frame is not None
        np.testing.assert_array_equal(frame.image, noise(seed=9))
        assert source.damaged == 2
        assert any("2 damaged pictures" in remark for remark in source.describe().remarks)


def test_crop_and_orientation(driver: Driver) -> None:
    with opened("?crop=8,4,32,16&orientation=UN") as source:
        driver.send(noise().tobytes())
        frame = source.read(1.0)
    assert frame is not None
    np.testing.assert_array_equal(frame.image, noise()[4:20, 8:40][::-1, ::-1])


def test_a_crop_outside_the_picture_is_said_at_opening(driver: Driver) -> None:
    with pytest.raises(DeviceLost, match="64x48 pixels does not hold the crop"):
        opened("?crop=40,0,32,16")


def test_a_device_that_is_unplugged_amid_a_picture_is_closed_at_once(driver: Driver) -> None:
    """Also while the error is still at hand: a busy node could not be opened again."""
    with leaves_nothing_open(), opened() as source:
        driver.send(noise().tobytes())
        driver.refuse[abi.QBUF] = errno.ENODEV
        with pytest.raises(DeviceLost, match="unplugged") as refusal:
            source.read(1.0)
    assert refusal.value.remedy


@pytest.mark.parametrize(
    ("request_number", "number", "words"),
    [
        (abi.S_FMT, errno.EBUSY, "in use by another program"),
        (abi.REQBUFS, errno.EBUSY, "in use by another program"),
        (abi.STREAMON, errno.ENOSPC, "no room for this picture size"),
        (abi.QUERYCAP, errno.ENOTTY, "is not a video device"),
        (abi.QBUF, errno.EINVAL, "does not take its buffers"),
    ],
)
def test_refusals_at_opening_are_losses_and_leave_nothing_open(
    driver: Driver, request_number: int, number: int, words: str
) -> None:
    driver.refuse[request_number] = number
    with leaves_nothing_open():
        with pytest.raises(DeviceLost, match=words) as refusal:
            opened()
        assert refusal.value.remedy
        del refusal
    driver.refuse.clear()
    with opened() as source:
        driver.send(noise().tobytes())
        assert source.read(1.0) is not None


@pytest.mark.parametrize(
    ("number", "words"), [(errno.ENODEV, "unplugged"), (errno.EIO, "reports an error"), (errno.EINVAL, "no picture")]
)
def test_a_stream_that_breaks_is_a_loss(driver: Driver, number: int, words: str) -> None:
    with opened() as source:
        driver.refuse[abi.DQBUF] = number
        with pytest.raises(DeviceLost, match=words):
            source.read(0.5)


def test_without_a_signal_nothing_is_opened_and_its_loss_is_noticed(driver: Driver) -> None:
    driver.status = abi.IN_ST_NO_SIGNAL
    with pytest.raises(DeviceLost, match="no signal"):
        opened()
    driver.status = 0
    with opened(rate=50.0) as source:
        driver.status = abi.IN_ST_NO_SYNC
        with pytest.raises(DeviceLost, match="not steady"):
            [source.read(1.0) for _ in range(3)]


def test_the_timings_of_a_digital_signal_are_taken_over_and_watched(driver: Driver) -> None:
    driver.timings = abi.DvTimings(width=64, height=48, pixelclock=25_000_000)
    with opened(rate=50.0) as source:
        assert abi.S_DV_TIMINGS in driver.asked
        driver.timings = abi.DvTimings(width=128, height=96, pixelclock=74_000_000)
        with pytest.raises(DeviceLost, match="size or rate of the video signal changed"):
            [source.read(1.0) for _ in range(3)]
    driver.refuse[abi.QUERY_DV_TIMINGS] = errno.ERANGE
    with pytest.raises(DeviceLost, match="out of the grabber's range"):
        opened()


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("?size=800x600", "64x48 instead of 800x600"),
        ("?format=MJPG", "does not give MJPG, only YUYV, GREY"),
    ],
)
def test_what_the_device_cannot_do_is_said(driver: Driver, query: str, words: str) -> None:
    with pytest.raises(DeviceLost, match=words):
        opened(query)


@pytest.mark.parametrize("field", [abi.FIELD_INTERLACED, abi.FIELD_ALTERNATE])
def test_an_interlaced_source_is_refused_with_what_to_do(driver: Driver, field: int) -> None:
    driver.field = field
    with pytest.raises(DeviceLost, match="interlaced") as refusal:
        opened()
    assert "progressive" in refusal.value.remedy


@pytest.mark.parametrize("field", [abi.FIELD_NONE, abi.FIELD_ANY])
def test_a_source_of_whole_pictures_is_taken(driver: Driver, field: int) -> None:
    driver.field = field
    with opened() as source:
        driver.send(noise().tobytes())
        assert source.read(1.0) is not None


def test_a_rounded_rate_is_said_and_a_silent_driver_gets_a_usual_one(driver: Driver) -> None:
    with opened("?rate=30") as source:
        assert "30 pictures per second were asked for, it gives 25" in source.describe().remarks
    driver.refuse[abi.G_PARM] = errno.ENOTTY
    with opened() as source:
        assert any("does not report its rate" in remark for remark in source.describe().remarks)


@pytest.mark.parametrize(
    ("capabilities", "words"),
    [
        (abi.CAP_STREAMING, "not a video capture device"),
        (abi.CAP_VIDEO_CAPTURE_MPLANE | abi.CAP_STREAMING, "several planes"),
        (abi.CAP_VIDEO_CAPTURE, "cannot stream"),
    ],
)
def test_other_nodes_are_refused(driver: Driver, capabilities: int, words: str) -> None:
    driver.capabilities = capabilities
    with pytest.raises(DeviceLost, match=words):
        opened()


def test_a_stamp_of_another_clock_is_said(driver: Driver) -> None:
    with opened() as source:
        driver.send(noise().tobytes(), flags=0, t_ns=0)
        frame = source.read(1.0)
        assert frame is not None
        assert frame.stamp.err_ns > 40e6
        assert any("without a time of this host" in remark for remark in source.describe().remarks)


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("v4l2:video0", "not the path"),
        ("v4l2:/dev/video0?colour=red", "unknown option 'colour'"),
        ("v4l2:/dev/video0?size=big", "size=big"),
        ("v4l2:/dev/video0?size=4x4", "size=4x4"),
        ("v4l2:/dev/video0?rate=0", "rate=0"),
        ("v4l2:/dev/video0?format=H264", "format=H264"),
        ("v4l2:/dev/video0?input=hdmi", "input=hdmi"),
    ],
)
def test_a_url_that_can_never_work_is_refused(url: str, words: str) -> None:
    with pytest.raises(ConfigurationError) as refusal:
        open_video(url, HostClock())
    assert words in str(refusal.value)


@pytest.mark.parametrize("path", ["/dev/no-such-video", "/dev/zero", "/etc/passwd"])
def test_what_is_no_video_device_is_lost(path: str) -> None:
    with pytest.raises(DeviceLost, match=r"no such video device|is not a video device"):
        open_video(f"v4l2:{path}", HostClock())
