"""From the driver's buffer to the line the pixels of a frame are written three times, and checksums none."""

import zlib
from typing import Any

import cv2
import numpy as np
import pytest

from tests.support.frame_walk import HOPS, captured, copies, walk

GREY = cv2.GaussianBlur(np.random.default_rng(3).integers(0, 256, (960, 1280), np.uint8), (9, 9), 0)


@pytest.mark.parametrize("query", ["", "&orientation=UN", "&crop=0,0,1280,960&orientation=MN"])
@pytest.mark.parametrize("code", ["GREY", "NV12", "YUYV", "RGB3", "MJPG"])
def test_each_hop_writes_a_picture_once(code: str, query: str) -> None:
    written = copies(code, GREY, query)
    compressed = len(captured(code, GREY)) / GREY.size if code == "MJPG" else 0
    assert written == {hop: pytest.approx(1 + compressed * (hop == "read"), abs=0.01) for hop in HOPS}


def test_no_checksum_is_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    summed = []
    real = zlib.crc32

    def counted(data: Any, start: int = 0) -> int:
        summed.append(len(data))
        return real(data, start)

    monkeypatch.setattr(zlib, "crc32", counted)
    with walk("GREY", (1280, 960)) as on:
        on.driver.send(GREY.tobytes())
        on.put(on.read())
        assert np.array_equal(on.take().image, GREY)
    assert summed == []
