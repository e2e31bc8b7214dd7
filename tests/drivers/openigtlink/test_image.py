"""Which pictures become grey ones, and by which words the others are refused."""

import tracemalloc

import numpy as np
import pytest

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.openigtlink.image import Image, Levels, grey_picture, parse_image

PIXELS = np.random.default_rng(3).integers(0, 256, (24, 32), np.uint8)


def image(pixels: np.ndarray, scalar: int = 3, components: int = 1, order: int = 2) -> Image:
    rows, columns = pixels.shape[:2]
    return parse_image(Image((columns, rows, 1), pixels.tobytes(), scalar, components, order).content)


def test_grey_is_taken_as_it_is() -> None:
    np.testing.assert_array_equal(grey_picture(image(PIXELS), None), PIXELS)


@pytest.mark.parametrize(("components", "weights"), [(3, (0.299, 0.587, 0.114)), (4, (0.299, 0.587, 0.114, 0.0))])
def test_colours_are_weighted_as_bt_601_says(components: int, weights: tuple[float, ...]) -> None:
    colours = np.random.default_rng(4).integers(0, 256, (24, 32, components), np.uint8)
    found = grey_picture(image(colours, components=components), None)
    assert np.abs(found - colours @ np.array(weights)).max() <= 0.51


@pytest.mark.parametrize(("order", "kind"), [(1, ">u2"), (2, "<u2")])
def test_sixteen_bits_are_spread_between_the_levels(order: int, kind: str) -> None:
    pixels = np.array([[0, 1000, 2000, 3000, 5000, 60000] * 4] * 16)
    found = grey_picture(image(pixels.astype(kind), 5, order=order), (1000.0, 3000.0))
    np.testing.assert_array_equal(found[0, :6], [0, 0, 128, 255, 255, 255])


def test_floating_point_that_is_no_number_is_black() -> None:
    pixels = np.full((16, 16), np.nan, "<f4")
    pixels[0, :3] = np.inf, -np.inf, 0.5
    assert grey_picture(image(pixels, 10), (0.0, 1.0))[0, :4].tolist() == [255, 0, 128, 0]


def test_a_huge_picture_is_spread_without_as_huge_a_memory() -> None:
    """64 MiB of them once took 1.8 GB, beyond which the kernel ends the service."""
    huge = image(np.full((2048, 4096), 9, np.uint8))
    tracemalloc.start()
    try:
        found = grey_picture(huge, (0.0, 18.0))
        _, peak_bytes = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert found.shape == (2048, 4096)
    assert (found == 128).all()
    assert peak_bytes < 8 * found.size, "less than its values as floating point"


def refused(picture: Image, levels: Levels | None = None) -> str:
    with pytest.raises(ValueError, match=r"Have it|Name a picture|Say what") as refusal:
        grey_picture(picture, levels)
    return str(refusal.value)


def test_what_cannot_be_converted_is_refused_by_name() -> None:
    assert "pixels of uint16" in refused(image(PIXELS.astype("<u2"), 5))
    assert "levels=0,4095" in refused(image(PIXELS.astype("<i2"), 4))
    assert "2 components a pixel" in refused(image(np.dstack([PIXELS, PIXELS]), components=2))
    assert "volumes of 32 x 24 x 2" in refused(Image((32, 24, 2), PIXELS.tobytes() * 2, part=(32, 24, 2)))
    assert "parts of 32 x 12 x 1" in refused(Image((32, 24, 1), PIXELS.tobytes()[:384], part=(32, 12, 1)))


@pytest.mark.parametrize(
    ("wrong", "what"),
    [
        ({"scalar": 9}, "scalar type 9"),
        ({"order": 0}, "byte order 0"),
        ({"components": 0}, "0 components"),
        ({"size": (32, 25, 1)}, "announces 800 bytes"),
        ({"size": (32, 12, 1), "part": (32, 24, 1)}, "has no part of 32 x 24 x 1"),
        ({"offset": (1, 0, 0)}, "has no part"),
    ],
)
def test_a_header_that_cannot_be_is_refused(wrong: dict[str, object], what: str) -> None:
    fields: dict[str, object] = {"size": (32, 24, 1), "data": PIXELS.tobytes()} | wrong
    with pytest.raises(ProtocolError, match=what):
        parse_image(Image(**fields).content)  # type: ignore[arg-type]
