"""Pictures that show no tissue, seeded: noise of many kinds, test cards, menus, desktops, flat pictures."""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from probewatch.drivers.samples import GreyImage

Size = tuple[int, int]
Random = np.random.Generator
Reals = NDArray[np.float32]
VGA = (480, 640)

_WORDS = ("Patient", "Smith", "Garcia", "MRN", "DOB", "Study", "Abdomen", "OB", "Vascular", "Gain", "Depth", "Export")


def _grey(picture: NDArray[np.floating]) -> GreyImage:
    return np.asarray(np.clip(np.rint(picture), 0, 255), np.uint8)


def _white(random: Random, size: Size) -> Reals:
    return random.standard_normal(size, np.float32)


def _amplitude(random: Random) -> float:
    """Grey levels: from what is hardly seen to snow, as many of the one as of the other."""
    return float(np.exp(random.uniform(np.log(2), np.log(70))))


def _seen(random: Random, noise: Reals) -> GreyImage:
    return _grey(random.uniform(30, 200) + _amplitude(random) * noise / max(float(noise.std()), 1e-6))


def grabbed(random: Random, picture: GreyImage, most_grey: float = 5.0) -> GreyImage:
    """With the white noise of a frame grabber, at most so many grey levels (standard deviation)."""
    return _grey(picture + random.uniform(0, most_grey) * _white(random, picture.shape))


def _jpeg(random: Random, picture: GreyImage, least: int = 25) -> GreyImage:
    quality = int(random.integers(least, 95))
    coded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE), np.uint8)


def black(random: Random, size: Size) -> GreyImage:
    return np.full(size, random.integers(0, 17), np.uint8)


def faint_noise(random: Random, size: Size) -> GreyImage:
    return _grey(random.uniform(-2, 8) + random.uniform(0.3, 4) * _white(random, size))


def white_noise(random: Random, size: Size) -> GreyImage:
    return _seen(random, _white(random, size))


def snow(random: Random, size: Size) -> GreyImage:
    if random.random() < 0.5:
        return random.integers(0, 256, size, np.uint8)
    return np.where(random.random(size) < random.uniform(0.01, 0.5), 255, 0).astype(np.uint8)


def softened_noise(random: Random, size: Size) -> GreyImage:
    """A low-pass of up to 1.5 px at 480 rows, in proportion at others."""
    blur = random.uniform(0.4, 1.5) * size[0] / 480
    return _seen(random, np.asarray(cv2.GaussianBlur(_white(random, size), (0, 0), max(blur, 0.3)), np.float32))


def scaled_noise(random: Random, size: Size) -> GreyImage:
    """Noise of a smaller picture, at least 240 rows of it where there are, drawn larger."""
    least = min(1.0, 240 / size[0])
    share = random.uniform(least, 1.0)
    rows, columns = max(round(size[0] * share), 2), max(round(size[1] * share), 2)
    how = (cv2.INTER_LINEAR, cv2.INTER_CUBIC, cv2.INTER_LANCZOS4, cv2.INTER_NEAREST)[random.integers(4)]
    small = _white(random, (rows, columns))
    return _seen(random, np.asarray(cv2.resize(small, size[::-1], interpolation=how), np.float32))


def jpeg_noise(random: Random, size: Size) -> GreyImage:
    return _jpeg(random, _seen(random, _white(random, size)))


def deinterlaced_noise(random: Random, size: Size) -> GreyImage:
    """One field doubled, one field with the lines between it interpolated, or both blended."""
    noise = _white(random, size)
    field = noise[::2].repeat(2, axis=0)[: size[0]]
    if random.random() < 0.67:
        noise = field if random.random() < 0.5 else (field + np.roll(field, 1, axis=0)) / 2
    else:
        noise = (noise + np.roll(noise, 1, axis=0)) / 2
    return _seen(random, noise.astype(np.float32))


def cable_noise(random: Random, size: Size) -> GreyImage:
    """Analogue video: of limited bandwidth along the line, white from line to line."""
    blur = random.uniform(0.5, 1.4) * size[1] / 640
    return _seen(random, np.asarray(cv2.GaussianBlur(_white(random, size), (0, 0), max(blur, 0.3), sigmaY=1e-3)))


def flat(random: Random, size: Size) -> GreyImage:
    return grabbed(random, np.full(size, random.integers(0, 256), np.uint8))


def gradient(random: Random, size: Size) -> GreyImage:
    y, x = np.mgrid[0 : size[0], 0 : size[1]] / np.array(size).reshape(2, 1, 1)
    a, b = random.uniform(-1, 1, 2)
    shade = np.hypot(x - 0.5, y - 0.5) if random.random() < 0.3 else a * x + b * y
    return grabbed(random, _grey(random.uniform(20, 255) * (shade - shade.min()) / max(np.ptp(shade), 1e-6)))


def bars(random: Random, size: Size) -> GreyImage:
    """SMPTE bars in grey: seven bars, the reversed row, the PLUGE row."""
    picture = np.zeros(size, np.uint8)
    rows, columns = size
    greys = [180, 162, 131, 112, 84, 65, 35]
    edges = np.linspace(0, columns, 8).astype(int)
    for k, grey in enumerate(greys):
        picture[: 2 * rows // 3, edges[k] : edges[k + 1]] = grey
        picture[2 * rows // 3 : 3 * rows // 4, edges[k] : edges[k + 1]] = greys[6 - k] if k % 2 == 0 else 16
    for k, grey in enumerate((44, 235, 61, 16, 10, 16, 22, 16)):
        picture[3 * rows // 4 :, k * columns // 8 : (k + 1) * columns // 8] = grey
    return grabbed(random, picture)


def bursts(random: Random, size: Size) -> GreyImage:
    """Multiburst: gratings, sine or square, upright, level or tilted, from coarse to fine."""
    y, x = np.mgrid[0 : size[0], 0 : size[1]].astype(np.float32)
    tilt = random.choice([0.0, np.pi / 2, random.uniform(0, np.pi)])
    along, band = x * np.cos(tilt) + y * np.sin(tilt), (x / size[1] * 6).astype(int)
    period = np.geomspace(size[0] / 6, size[0] / 160, 6)[band] * random.uniform(0.7, 1.4)
    wave = np.sin(2 * np.pi * along / period)
    if random.random() < 0.5:
        wave = np.sign(wave)
    return grabbed(random, _grey(128 + random.uniform(20, 110) * wave))


def zone_plate(random: Random, size: Size) -> GreyImage:
    y, x = np.mgrid[0 : size[0], 0 : size[1]].astype(np.float32)
    square = (x - random.uniform(0, size[1])) ** 2 + (y - random.uniform(0, size[0])) ** 2
    wave = np.cos(random.uniform(0.3, 1.5) * square / size[0])
    return grabbed(random, _grey(128 + random.uniform(40, 110) * wave))


def test_card(random: Random, size: Size) -> GreyImage:
    """Grid, circle, grey steps, resolution wedges of lines, a star and a name."""
    rows, columns = size
    picture = np.full(size, random.integers(80, 150), np.uint8)
    for k in range(0, columns, max(columns // 16, 4)):
        cv2.line(picture, (k, 0), (k, rows), 220, max(rows // 480, 1))
    for k in range(0, rows, max(columns // 16, 4)):
        cv2.line(picture, (0, k), (columns, k), 220, max(rows // 480, 1))
    cv2.circle(picture, (columns // 2, rows // 2), int(0.45 * rows), 230, max(rows // 240, 1))
    for k in range(8):
        left = columns // 4 + k * columns // 16
        cv2.rectangle(picture, (left, rows // 3), (left + columns // 16, rows // 3 + rows // 10), 36 * k, -1)
        stripes = (np.arange(columns // 16) // max(8 - k, 1) % 2 * 255).astype(np.uint8)
        picture[rows // 2 : rows // 2 + rows // 8, left : left + columns // 16] = stripes
    y, x = np.mgrid[0:rows, 0:columns]
    star = np.hypot(x - columns / 2, y - 0.8 * rows) < rows / 9
    spokes = 255 * (np.sin(36 * np.arctan2(y - 0.8 * rows, x - columns / 2)) > 0)
    picture[star] = spokes[star]
    _write(picture, "TEST CARD", columns // 3, rows // 5, rows / 400, 10)
    return grabbed(random, picture)


def checkerboard(random: Random, size: Size) -> GreyImage:
    side = int(random.integers(max(size[0] // 120, 2), size[0] // 6))
    y, x = np.mgrid[0 : size[0], 0 : size[1]] // side
    return grabbed(random, _grey(60 + 130.0 * ((x + y) % 2)))


def _write(picture: GreyImage, text: str, column: int, row: int, scale: float, grey: int) -> None:
    thick = 1 if scale < 0.9 else round(scale * 1.6)
    cv2.putText(picture, text, (column, row), cv2.FONT_HERSHEY_SIMPLEX, scale, grey, thick, cv2.LINE_AA)


def _phrase(random: Random) -> str:
    return f"{random.choice(_WORDS)} {random.choice(_WORDS)} {random.integers(10, 100000)}"


def menu(random: Random, size: Size) -> GreyImage:
    """A patient list: a title, columns of text, striped rows or ruled lines, buttons."""
    rows, columns = size
    back, ink = (20, 225) if random.random() < 0.6 else (225, 20)
    picture = np.full(size, back, np.uint8)
    scale = random.uniform(0.35, 0.7) * rows / 480
    step = max(round(34 * scale), 8)
    _write(picture, "PATIENT LIST", columns // 20, step + step // 2, scale * 1.7, ink)
    styled = random.integers(3)
    for k, row in enumerate(range(3 * step, rows - 3 * step, step)):
        if styled == 0 and k % 2:
            picture[row - int(0.75 * step) : row + step // 4] = (back * 3 + ink) // 4
        if styled == 1:
            cv2.line(picture, (0, row + step // 4), (columns, row + step // 4), (back + ink) // 2, 1)
        for column in range(columns // 20, columns - 1, columns // 3):
            _write(picture, _phrase(random), column, row, scale, ink)
    for k in range(4):
        left = columns // 20 + k * columns // 4
        cv2.rectangle(picture, (left, rows - 2 * step), (left + columns // 6, rows - step // 2), (back + ink) // 2, -1)
        _write(picture, str(random.choice(_WORDS)), left + 5, rows - step, scale, ink)
    picture = _jpeg(random, picture, 60) if random.random() < 0.3 else picture
    return grabbed(random, picture)


def words_on_black(random: Random, size: Size) -> GreyImage:
    """What a scanner leaves on its screen when it shows no picture: names, settings, a ruler, a logo, a notice."""
    rows, columns = size
    picture = np.zeros(size, np.uint8)
    scale = random.uniform(0.35, 0.6) * rows / 480
    for k in range(int(random.integers(1, 9))):
        _write(picture, _phrase(random), 6, round((k + 1) * 40 * scale), scale, 230)
    for row in range(rows // 10, rows, rows // 12):
        cv2.line(picture, (columns - 14, row), (columns - 4, row), 220, 1)
    if random.random() < 0.5:
        _write(
            picture, str(random.choice(["FROZEN", "No probe", "NO SIGNAL"])), columns // 3, rows // 2, 3 * scale, 200
        )
    if random.random() < 0.5:
        cv2.ellipse(picture, (columns // 2, -rows), (int(1.1 * rows), int(1.1 * rows)), 0, 70, 110, 180, 1, cv2.LINE_AA)
    return grabbed(random, picture, 3.0)


def desktop(random: Random, size: Size) -> GreyImage:
    """Windows with title bars, text, buttons and icons on a shaded ground."""
    rows, columns = size
    shade = np.linspace(random.uniform(20, 120), random.uniform(60, 200), rows)[:, None]
    picture = np.broadcast_to(shade, size).astype(np.uint8).copy()
    scale = random.uniform(0.35, 0.55) * rows / 480
    for k in range(6):
        cv2.circle(picture, (columns // 18, (2 * k + 1) * rows // 13), rows // 30, int(random.integers(40, 255)), -1)
        _write(picture, "File", columns // 40, (2 * k + 2) * rows // 13, scale, 240)
    for _ in range(int(random.integers(2, 6))):
        left, top = int(random.integers(0, columns // 2)), int(random.integers(0, rows // 2))
        right, low = (
            left + int(random.integers(columns // 4, columns // 2)),
            top + int(random.integers(rows // 4, rows // 2)),
        )
        cv2.rectangle(picture, (left, top), (right, low), int(random.choice([235, 40])), -1)
        cv2.rectangle(picture, (left, top), (right, top + rows // 24), int(random.integers(60, 180)), -1)
        _write(picture, _phrase(random), left + 4, top + rows // 30, scale, 250)
        ink = 20 if picture[min(low, rows) - 2, left + 1] > 128 else 230
        for row in range(top + rows // 10, low, max(round(34 * scale), 8)):
            _write(
                picture, _phrase(random)[: max((right - left) // round(22 * scale + 1), 1)], left + 6, row, scale, ink
            )
    return grabbed(random, picture)


KINDS: dict[str, Callable[[Random, Size], GreyImage]] = {
    made.__name__.replace("_", " "): made
    for made in (
        black,
        faint_noise,
        white_noise,
        snow,
        softened_noise,
        scaled_noise,
        jpeg_noise,
        deinterlaced_noise,
        cable_noise,
        flat,
        gradient,
        bars,
        bursts,
        zone_plate,
        test_card,
        checkerboard,
        menu,
        words_on_black,
        desktop,
    )
}
"""Name → function of a random generator and (rows, columns)."""
