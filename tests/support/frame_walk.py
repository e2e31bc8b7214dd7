"""The walk of a frame from the buffer of a simulated V4L2 driver to the estimator, one hop after the other."""

import fcntl
import os
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
import pytest

from probewatch.appliance.service.estimator.ring import FRAMES, Ring, RingFds
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.registry import open_video
from probewatch.drivers.samples import Frame, GreyImage
from probewatch.drivers.video.v4l2.source import V4l2Video
from tests.support.simulated_v4l2 import Driver

HOPS = ("read", "put", "take")
_T = TypeVar("_T")


class LargeDriver(Driver):
    """Its buffers hold 1920 × 1080 pixels of three bytes."""

    room = 1 << 23


def captured(code: str, grey: GreyImage) -> bytes:
    """What a driver puts into its buffer for this picture."""
    if code == "YUYV":
        return np.repeat(grey, 2, axis=1).tobytes()
    if code == "RGB3":
        return np.repeat(grey, 3, axis=1).tobytes()
    if code == "MJPG":
        return cv2.imencode(".jpg", grey)[1].tobytes()
    return grey.tobytes()


@dataclass
class Walk:
    """An open source, and both ends of a ring."""

    driver: Driver
    source: V4l2Video
    producer: Ring
    consumer: Ring

    def read(self) -> Frame:
        """Hop 1, in the capture thread."""
        frame = self.source.read(1.0)
        assert frame is not None
        return frame

    def put(self, frame: Frame) -> None:
        """Hop 2, in the capture thread."""
        self.producer.put(frame)

    def take(self) -> Frame:
        """Hop 3, in the estimator."""
        (frame,), dropped = self.consumer.take()
        assert isinstance(frame, Frame)
        assert dropped == 0
        return frame


@contextmanager
def walk(code: str, size_px: tuple[int, int], query: str = "") -> Iterator[Walk]:
    """size_px: (width, height). query: more options of the URL, each with its &."""
    driver, real_open = LargeDriver(), os.open
    driver.formats, driver.size_px = [code], size_px

    def opened(path: str, flags: int, *rest: int) -> int:
        return os.dup(driver.fd) if path == "/dev/null" else real_open(path, flags, *rest)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fcntl, "ioctl", driver.ioctl)
        patch.setattr(os, "open", opened)
        with (
            open_video(f"v4l2:/dev/null?format={code}{query}", HostClock()) as source,
            Ring(FRAMES) as producer,
            Ring(FRAMES, RingFds(*map(os.dup, producer.fds))) as consumer,
        ):
            assert isinstance(source, V4l2Video)
            yield Walk(driver, source, producer, consumer)
    driver.close()
    os.close(driver.fd)


def allocated(work: Callable[[], _T]) -> tuple[_T, int]:
    """(what work returns, the most bytes that Python and NumPy held at once on its way, above those before)."""
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        made = work()
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return made, peak - before


def copies(code: str, grey: GreyImage, query: str = "") -> dict[str, float]:
    """Hop → pictures of memory that it wrote. The ring's memory was there before: what put writes is what came out."""
    height, width = grey.shape
    with walk(code, (width, height), query) as on:
        for _ in range(2):  # the first walk also loads code and opens caches
            on.driver.send(captured(code, grey))
            frame, read_bytes = allocated(on.read)
            _, put_bytes = allocated(lambda frame=frame: on.put(frame))
            taken, take_bytes = allocated(on.take)
        assert np.array_equal(taken.image, frame.image)
    written = (read_bytes, put_bytes + taken.image.size, take_bytes)
    return {hop: count / grey.size for hop, count in zip(HOPS, written, strict=True)}
