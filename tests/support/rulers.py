"""Depth rulers as other scanners draw them, on pictures of moving noise: no code of the simulated scanner."""

from dataclasses import dataclass

import cv2
import numpy as np

from probewatch.drivers.samples import GreyImage

HEIGHT, WIDTH = 360, 480
TISSUE = np.s_[20:340, 90:390]


@dataclass(frozen=True)
class Style:
    """spacing_px, top_px: of the ticks, fractions of px drawn with grey edges. column: first of the short ticks.
    short_px, long_px: lengths; every major-th is long. to_left: the long ones grow to the left. grey: of the ticks.
    words: numbers beside the long ticks.
    """

    spacing_px: float = 21.3
    top_px: float = 24.4
    column: int = 440
    short_px: int = 5
    long_px: int = 10
    major: int = 5
    to_left: bool = True
    grey: int = 200
    thick_px: float = 1.0
    words: bool = True


STYLES = (
    Style(),
    Style(spacing_px=12.7, column=14, to_left=False, grey=120, thick_px=2.0),
    Style(spacing_px=40.0, top_px=30.0, column=404, short_px=8, long_px=8, words=False),
    Style(spacing_px=9.8, column=60, short_px=3, long_px=7, major=10, grey=255),
    Style(spacing_px=55.0, column=424, short_px=4, long_px=14, major=2, grey=90, thick_px=3.0),
)


def picture(style: Style, seed: int, index: int, zoom: float = 1.0, tissue: float = 60.0) -> GreyImage:
    """(HEIGHT, WIDTH) uint8: grains that are new in each picture, text, and the ruler of a depth that magnifies so."""
    grains = np.random.default_rng((seed, index)).rayleigh(tissue, (HEIGHT // 3, WIDTH // 3)).clip(0, 255)
    image = np.zeros((HEIGHT, WIDTH), np.uint8)
    image[TISSUE] = cv2.resize(grains.astype(np.uint8), (WIDTH, HEIGHT))[TISSUE]
    cv2.putText(image, "C5-1", (6, 14), cv2.FONT_HERSHEY_PLAIN, 0.8, 200, 1)
    rows = np.arange(style.top_px, HEIGHT - 8, style.spacing_px * zoom)
    for number, row in enumerate(rows):
        long = number % style.major == 0
        length = style.long_px if long else style.short_px
        start = style.column - (length - style.short_px if style.to_left else 0)
        _tick(image, row, start, length, style)
        if style.words and long and number:
            place = (style.column + (12 if style.to_left else 16), round(row) + 4)
            cv2.putText(image, str(number), place, cv2.FONT_HERSHEY_PLAIN, 0.7, 180, 1)
    return image


def _tick(image: GreyImage, row: float, start: int, length: int, style: Style) -> None:
    places = np.arange(HEIGHT)
    cover = np.clip(style.thick_px / 2 + 0.5 - np.abs(places - row), 0, min(1.0, style.thick_px))
    drawn = (style.grey * cover).astype(np.uint8)[:, None]
    image[:, start : start + length] = np.maximum(image[:, start : start + length], drawn)


def grabbed(image: GreyImage, seed: int, index: int, noise_grey: float, blur_px: float, quality: int) -> GreyImage:
    """As a video grabber hands it on: blurred, noisy, and compressed as JPEG where quality is not 0."""
    out = image.astype(np.float32)
    if blur_px:
        out = cv2.GaussianBlur(out, (0, 0), blur_px)
    out += np.random.default_rng((seed, index, 7)).normal(0, noise_grey, image.shape)
    grey = out.clip(0, 255).astype(np.uint8)
    if quality:
        _, data = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, quality])
        grey = np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), np.uint8)
    return grey
