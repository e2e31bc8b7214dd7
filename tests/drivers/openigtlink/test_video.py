"""The source of pictures against a server that says what the test tells it to, over a real connection."""

import time
from collections.abc import Iterator

import numpy as np
import pytest
from fastcrc import crc64

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.openigtlink.message import Message, encode
from probewatch.drivers.openigtlink.video import IgtlVideo
from probewatch.drivers.registry import open_video
from probewatch.drivers.samples import Frame
from tests.support.igtl import UTC_NS, Server, picture, server, transform, turned
from tests.support.stopwatch import Stopwatch

PIXELS = np.random.default_rng(5).integers(0, 256, (48, 64), np.uint8)
PERIOD_NS = 33_000_000


@pytest.fixture
def cart() -> Iterator[Server]:
    with server() as one:
        yield one


def opened(cart: Server, clock: HostClock | None = None, **options: str) -> IgtlVideo:
    query = "&".join(f"{key}={value}" for key, value in options.items())
    video = open_video(f"igtl://{cart.target}?{query}", clock or HostClock())
    assert isinstance(video, IgtlVideo)
    cart.accept()
    return video


def next_frame(video: IgtlVideo) -> Frame:
    frame = video.read(1.0)
    assert frame is not None
    return frame


def test_a_picture_is_a_frame(cart: Server) -> None:
    with opened(cart) as video:
        for count in range(4):
            cart.send(transform("ProbeToTracker", turned(), 0), picture("Image", PIXELS, count * PERIOD_NS))
            frame = next_frame(video)
            np.testing.assert_array_equal(frame.image, PIXELS)
            assert frame.sequence == count
            assert not frame.stamp.later_than(time.monotonic_ns())


def test_a_picture_is_cut_out_and_turned(cart: Server) -> None:
    with opened(cart, crop="8,4,32,24", orientation="UN") as video:
        cart.send(picture("Image", PIXELS, 0))
        np.testing.assert_array_equal(next_frame(video).image, PIXELS[4:28, 8:40][::-1, ::-1])


def test_colours_become_grey(cart: Server) -> None:
    with opened(cart) as video:
        cart.send(picture("Image", np.dstack([PIXELS] * 3), 0))
        np.testing.assert_array_equal(next_frame(video).image, PIXELS)


def test_deep_pixels_need_levels_and_say_so(cart: Server) -> None:
    deep = picture("Image", PIXELS.astype("<u2") * 16, 0, scalar=5)
    with opened(cart) as video:
        cart.send(deep)
        with pytest.raises(DeviceLost, match=r"'Image' sends pixels of uint16. Say what .* such as levels=0,4095"):
            video.read(1)
    with opened(cart, levels="0,4080") as video:
        cart.send(deep)
        np.testing.assert_array_equal(next_frame(video).image, PIXELS)


def test_of_several_pictures_one_must_be_named(cart: Server) -> None:
    both = [picture(name, PIXELS, 0) for name in ("Image_Tracker", "Doppler")]
    with opened(cart) as video:
        cart.send(*both)
        next_frame(video)
        with pytest.raises(DeviceLost, match=r"several pictures, 'Image_Tracker' and 'Doppler'. Name one"):
            video.read(1)
    with opened(cart, image="Doppler") as video:
        cart.send(*both)
        next_frame(video)
        assert video.read(0.05) is None


def test_a_picture_that_comes_again_is_dropped(cart: Server) -> None:
    with opened(cart) as video:
        cart.send(picture("Image", PIXELS, 0), picture("Image", PIXELS, 0), picture("Image", PIXELS, PERIOD_NS))
        assert [next_frame(video).sequence for _ in range(2)] == [0, 1]
        assert video.describe().remarks == (
            "1 pictures had the time of the one before and were dropped: each needs its own",
        )


def test_without_a_time_a_picture_has_that_of_its_arrival(cart: Server) -> None:
    with opened(cart) as video:
        cart.send(picture("Image", PIXELS, -UTC_NS), picture("Image", PIXELS, -UTC_NS))
        frames = [next_frame(video) for _ in range(2)]
        assert all(frame.stamp.err_ns >= 100_000_000 for frame in frames)
        assert frames[0].stamp.t_ns < frames[1].stamp.t_ns


def test_damage_is_refused_and_counted(cart: Server) -> None:
    with opened(cart) as video:
        spoilt = bytearray(picture("Image", PIXELS, 0))
        spoilt[500] ^= 1
        tiny = picture("Image", PIXELS[:8, :8], 0)
        cart.send(bytes(spoilt), tiny, encode(Message("IMAGE", "Image", b"short")), picture("Image", PIXELS, PERIOD_NS))
        assert next_frame(video).sequence == 0
        assert video.refused == 3


def test_a_picture_that_cannot_hold_the_crop_is_a_loss(cart: Server) -> None:
    with opened(cart, crop="0,0,640,480") as video:
        cart.send(picture("Image", PIXELS, 0))
        with pytest.raises(DeviceLost, match="64x48 pixels does not hold the crop"):
            video.read(1)


def test_a_server_without_pictures_lives_and_one_that_is_silent_is_lost(cart: Server) -> None:
    clock = HostClock(0.25)
    with opened(cart, clock, deadline_ms="300") as video:
        for count in range(5):
            cart.send(transform("ProbeToTracker", turned(), count * PERIOD_NS))
            assert video.read(0.1) is None
        watch = Stopwatch(0.25)
        with pytest.raises(DeviceLost, match="silent"):
            _read_on(video)
        assert watch.spent_s() < 0.55


@pytest.mark.parametrize("damage", [slice(50, 58), slice(60, 61)])
def test_a_picture_that_comes_damaged_each_time_is_told_as_that(cart: Server, damage: slice) -> None:
    with opened(cart) as video:
        sent = bytearray(picture("Image", PIXELS, 0))
        sent[damage] = bytes(damage.stop - damage.start)
        if damage.start > 58:
            sent[50:58] = crc64.ecma_182(bytes(sent[58:])).to_bytes(8, "big")
        cart.send(bytes(sent))
        assert video.read(0.2) is None
        told = video.describe()
        assert told.absent.startswith("no IMAGE could be read: ")
        assert "CRC-64" in told.remedy
        cart.send(picture("Image", PIXELS, PERIOD_NS))
        assert video.read(1.0) is not None
        assert video.describe().absent == ""


@pytest.mark.parametrize(
    ("named", "sent", "remedy"),
    [
        ("Image", picture("Image_Reference", PIXELS, 0), "image="),
        ("Image", encode(Message("VIDEO", "Image_Reference", b"H264", 0)), "as IMAGE"),
        ("", transform("ProbeToTracker", turned(), 0), "as IMAGE"),
    ],
)
def test_a_picture_that_never_came_is_told_with_what_came_instead(
    cart: Server, named: str, sent: bytes, remedy: str
) -> None:
    with opened(cart, **({"image": named} if named else {})) as video:
        cart.send(sent)
        assert video.read(0.2) is None
        told = video.describe()
        wanted = f"no IMAGE '{named}' came; the server sends " if named else "no IMAGE came; the server sends "
        assert told.absent.startswith(wanted)
        assert told.absent != wanted + "nothing"
        assert remedy in told.remedy
        assert told.model == "OpenIGTLink server"


def _read_on(video: IgtlVideo) -> None:
    for _ in range(100):
        video.read(0.1)
