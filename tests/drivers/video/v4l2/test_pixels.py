"""Captured bytes → grey, against OpenCV's own conversions, with lines longer than the picture is wide."""

import cv2
import numpy as np
import pytest

from probewatch.drivers.video.v4l2.pixels import FORMATS, BrokenPicture, grey

W, H, PAD = 64, 48, 32


def scene() -> np.ndarray:
    """(H, W, 3) uint8 BGR: noise, smoothed."""
    return cv2.GaussianBlur(np.random.default_rng(5).integers(0, 256, (H, W, 3), np.uint8), (5, 5), 0)


def padded(rows: np.ndarray) -> tuple[np.ndarray, int]:
    """(flat bytes with PAD bytes of rubbish after each line, bytes per line)."""
    wide = np.full((rows.shape[0], rows.shape[1] + PAD), 0xA5, np.uint8)
    wide[:, : rows.shape[1]] = rows
    return wide.ravel(), wide.shape[1]


def yuyv_of(y: np.ndarray) -> np.ndarray:
    """(H, W) luminance → (H, 2 W) bytes Y U Y V with chroma that is not neutral."""
    rows = np.empty((H, 2 * W), np.uint8)
    rows[:, ::2], rows[:, 1::4], rows[:, 3::4] = y, 90, 200
    return rows


def test_grey_is_passed_on() -> None:
    image = scene()[..., 1]
    data, stride = padded(image)
    np.testing.assert_array_equal(grey("GREY", data, W, H, stride), image)
    np.testing.assert_array_equal(grey("GREY", image.ravel(), W, H, 0), image)


def test_yuyv_is_what_opencv_takes_for_its_luminance() -> None:
    rows = yuyv_of(scene()[..., 0])
    data, stride = padded(rows)
    expected = cv2.cvtColor(rows.reshape(H, W, 2), cv2.COLOR_YUV2GRAY_YUYV)
    np.testing.assert_array_equal(grey("YUYV", data, W, H, stride), expected)


def test_uyvy_and_bgr_are_what_opencv_takes() -> None:
    rows = np.roll(yuyv_of(scene()[..., 0]), 1, axis=1)
    data, stride = padded(rows)
    expected = cv2.cvtColor(rows.reshape(H, W, 2), cv2.COLOR_YUV2GRAY_UYVY)
    np.testing.assert_array_equal(grey("UYVY", data, W, H, stride), expected)
    data, stride = padded(scene().reshape(H, 3 * W))
    np.testing.assert_array_equal(grey("BGR3", data, W, H, stride), cv2.cvtColor(scene(), cv2.COLOR_BGR2GRAY))


@pytest.mark.parametrize(("code", "conversion"), [("YU12", cv2.COLOR_YUV2GRAY_I420), ("YV12", cv2.COLOR_YUV2GRAY_YV12)])
def test_planes_of_chroma_behind_the_luminance_are_left(code: str, conversion: int) -> None:
    planes = np.random.default_rng(6).integers(0, 256, (H * 3 // 2, W), np.uint8)
    np.testing.assert_array_equal(grey(code, planes.ravel(), W, H, W), cv2.cvtColor(planes, conversion))


def test_nv12_is_what_opencv_takes_for_its_luminance() -> None:
    planes = np.random.default_rng(6).integers(0, 256, (H * 3 // 2, W), np.uint8)
    data, stride = padded(planes)
    expected = cv2.cvtColor(planes, cv2.COLOR_YUV2GRAY_NV12)
    np.testing.assert_array_equal(grey("NV12", data, W, H, stride), expected)


def test_rgb_is_what_opencv_makes_grey() -> None:
    bgr = scene()
    data, stride = padded(bgr[..., ::-1].reshape(H, 3 * W))
    expected = cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)
    np.testing.assert_array_equal(grey("RGB3", data, W, H, stride), expected)
    red = np.zeros((H, 3 * W), np.uint8)
    red[:, ::3] = 255
    assert grey("RGB3", red.ravel(), W, H, 0)[0, 0] == 76, "the first byte is red: 0.299 · 255"


def test_mjpeg_with_filling_bytes() -> None:
    image = scene()[..., 2]
    whole, jpeg = cv2.imencode(".jpg", image)
    assert whole
    data = np.concatenate([jpeg.ravel(), np.zeros(200, np.uint8)])
    shown = grey("MJPG", data, W, H, 0)
    np.testing.assert_array_equal(shown, cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE))
    assert np.abs(shown.astype(int) - image).mean() < 8


@pytest.mark.parametrize(("code", "conversion"), [("YVYU", cv2.COLOR_YUV2GRAY_YVYU), ("VYUY", cv2.COLOR_YUV2GRAY_UYVY)])
def test_the_order_of_the_chroma_makes_no_difference(code: str, conversion: int) -> None:
    rows = np.roll(yuyv_of(scene()[..., 0]), code == "VYUY", axis=1)
    data, stride = padded(rows)
    np.testing.assert_array_equal(grey(code, data, W, H, stride), cv2.cvtColor(rows.reshape(H, W, 2), conversion))


@pytest.mark.parametrize("code", ["NV21", "NV16", "NV61", "422P"])
def test_other_planes_of_chroma_are_left_as_well(code: str) -> None:
    planes = np.random.default_rng(6).integers(0, 256, (2 * H, W), np.uint8)
    data, stride = padded(planes)
    np.testing.assert_array_equal(grey(code, data, W, H, stride), planes[:H])


@pytest.mark.parametrize("code", ["XR24", "AR24", "BGR4"])
def test_the_fourth_byte_of_a_colour_is_left(code: str) -> None:
    fourth = np.random.default_rng(7).integers(0, 256, (H, W, 1), np.uint8)
    data, stride = padded(np.concatenate([scene(), fourth], axis=2).reshape(H, 4 * W))
    np.testing.assert_array_equal(grey(code, data, W, H, stride), cv2.cvtColor(scene(), cv2.COLOR_BGR2GRAY))


NOTHING = b"\xff\xd8\xff\xd9"


@pytest.mark.parametrize(
    ("before", "behind"),
    [
        (2 * NOTHING, NOTHING),
        (b"", b"\xff" * 32),
        (NOTHING + b"\0", b"\0\xff" + NOTHING + b"\0"),
        (b"", b"what the buffer held before"),
        (b"header of a grabber", b"\xaa\x55"),
    ],
)
def test_empty_jpegs_and_filling_bytes_are_none_of_the_picture(before: bytes, behind: bytes) -> None:
    _, jpeg = cv2.imencode(".jpg", scene())
    shown = grey("MJPG", np.frombuffer(before + jpeg.tobytes() + behind, np.uint8), W, H, 0)
    np.testing.assert_array_equal(shown, cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE))
    cut = before + jpeg.tobytes()[:-40] + behind
    with pytest.raises(BrokenPicture, match="not a whole"):
        grey("MJPG", np.frombuffer(cut, np.uint8), W, H, 0)


@pytest.mark.parametrize("way", [[cv2.IMWRITE_JPEG_RST_INTERVAL, 2], [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]])
def test_every_kind_of_jpeg_is_read_to_its_own_end(way: list[int]) -> None:
    """Restarts amid the pixels, several scans, and a small picture within a segment of its own, as cameras write it."""
    _, jpeg = cv2.imencode(".jpg", scene(), way)
    thumbnail = cv2.imencode(".jpg", scene()[:8, :8])[1].tobytes()
    segment = b"\xff\xe1" + (2 + len(thumbnail)).to_bytes(2, "big") + thumbnail
    whole = jpeg.tobytes()[:2] + segment + jpeg.tobytes()[2:]
    for code in ("MJPG", "JPEG"):
        shown = grey(code, np.frombuffer(whole + b"left", np.uint8), W, H, 0)
        np.testing.assert_array_equal(shown, cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE))


def test_a_cut_jpeg_before_a_whole_one_is_not_shown_in_part() -> None:
    _, jpeg = cv2.imencode(".jpg", scene())
    with pytest.raises(BrokenPicture, match="not a whole"):
        grey("MJPG", np.frombuffer(jpeg.tobytes()[:-40] + jpeg.tobytes(), np.uint8), W, H, 0)


@pytest.mark.parametrize("code", FORMATS)
def test_too_few_bytes_are_refused(code: str) -> None:
    with pytest.raises(BrokenPicture):
        grey(code, np.zeros(W * H - 1, np.uint8), W, H, 0)


def test_a_cut_or_strange_jpeg_is_refused() -> None:
    _, jpeg = cv2.imencode(".jpg", scene())
    with pytest.raises(BrokenPicture, match="not a whole"):
        grey("MJPG", jpeg.ravel()[:-40], W, H, 0)
    with pytest.raises(BrokenPicture, match=f"{W}x{H}, not 32x32"):
        grey("MJPG", jpeg.ravel(), 32, 32, 0)
