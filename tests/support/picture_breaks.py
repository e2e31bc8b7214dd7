"""A picture becomes another: what it becomes, and what lies between."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from probewatch.drivers.samples import GreyImage
from probewatch.drivers.twins.faults import blank_image


@dataclass(frozen=True)
class Other:
    """zoom: across and down. about: share of width and height that stays. moved: share of the width. gain: of the
    greys. turned_deg: of the picture, or of its lines down alone where it is sheared."""

    zoom: tuple[float, float] = (1.0, 1.0)
    about: tuple[float, float] = (0.5, 0.0)
    mirrored: tuple[bool, bool] = (False, False)
    moved: float = 0.0
    gain: float = 1.0
    turned_deg: float = 0.0
    sheared: bool = False

    def of(self, image: GreyImage, share: float = 1.0) -> GreyImage:
        """(h, w) uint8; share: how much of zoom and move is done."""
        height, width = image.shape
        slope = float(np.tan(np.deg2rad(share * self.turned_deg)))
        M = np.diag(np.array(self.zoom) ** share) @ [[1.0, -slope], [0.0 if self.sheared else slope, 1.0]]
        place = np.array(self.about) * [width - 1, height - 1]
        warp = np.column_stack([M, place - M @ place + [share * self.moved * width, 0.0]])
        seen = cv2.warpAffine(image, warp, (width, height))
        for axis, flipped in enumerate(self.mirrored):
            seen = cv2.flip(seen, 1 - axis) if flipped else seen
        return np.asarray(cv2.convertScaleAbs(seen, alpha=self.gain), np.uint8)


Between = Callable[[Other, list[GreyImage], int, int, int], GreyImage]
"""What is shown of pictures k … between `first` and `last`, where it becomes the other one."""


def black(other: Other, pictures: list[GreyImage], k: int, first: int, last: int) -> GreyImage:
    return blank_image(pictures[k].shape, k)


def frozen(other: Other, pictures: list[GreyImage], k: int, first: int, last: int) -> GreyImage:
    return pictures[first - 1]


def torn(other: Other, pictures: list[GreyImage], k: int, first: int, last: int) -> GreyImage:
    half = pictures[k].shape[0] // 2
    return np.vstack([pictures[k][:half], other.of(pictures[k])[half:]])


def animated(other: Other, pictures: list[GreyImage], k: int, first: int, last: int) -> GreyImage:
    return other.of(pictures[k], (k - first + 1) / (last - first + 1))


def faded(other: Other, pictures: list[GreyImage], k: int, first: int, last: int) -> GreyImage:
    share = (k - first + 1) / (last - first + 1)
    return np.asarray(cv2.addWeighted(pictures[k], 1 - share, other.of(pictures[k]), share, 0), np.uint8)


@dataclass(frozen=True)
class Break:
    """lasting: pictures that lie between."""

    other: Other
    between: Between = black
    lasting: int = 0

    def shown(self, pictures: list[GreyImage], k: int, first: int) -> GreyImage:
        """Picture k of a session that breaks at `first`."""
        if k < first:
            return pictures[k]
        last = first + self.lasting
        return self.other.of(pictures[k]) if k >= last else self.between(self.other, pictures, k, first, last)


ZOOMED, MIRRORED = Other((1.3, 1.3)), Other(mirrored=(True, False))
BREAKS: Mapping[str, Break] = {
    "zoomed at once": Break(ZOOMED),
    ".2 s of black, then zoomed": Break(ZOOMED, black, 6),
    "one torn picture, then zoomed": Break(ZOOMED, torn, 1),
    "zoomed twice": Break(Other((2.0, 2.0))),
    "zoomed about a region of interest": Break(Other((1.3, 1.3), (0.3, 0.65))),
    ".2 s of black, then mirrored": Break(MIRRORED, black, 6),
    "depth, flip and gain at once": Break(Other((0.75, 0.75), mirrored=(True, False), gain=1.3)),
    "an animated zoom": Break(ZOOMED, animated, 15),
    "an animated stretch": Break(Other((1.2, 1.0)), animated, 15),
    "one black picture, then zoomed": Break(ZOOMED, black, 1),
    "frozen for .24 s, then zoomed": Break(ZOOMED, frozen, 7),
    ".4 s of black, then deeper": Break(Other((0.7, 0.7)), black, 12),
    ".2 s of black, then magnified by 8.7 %": Break(Other((1.087, 1.087), (0.5, 0.5)), black, 6),
    ".2 s of black, then moved on the screen": Break(Other(moved=0.15), black, 6),
    "turned by 8° in a fade of .27 s": Break(Other(about=(0.5, 0.5), turned_deg=8.0), faded, 8),
    "sheared by 14° in a fade of .1 s": Break(Other(about=(0.5, 0.5), turned_deg=14.0, sheared=True), faded, 3),
    "moved on the screen in a fade of .1 s": Break(Other(moved=0.15), faded, 3),
    "mirrored in a fade of .27 s": Break(MIRRORED, faded, 8),
    "moved on the screen in a fade of .6 s": Break(Other(moved=0.15), faded, 18),
    ".1 s of black, then upside down": Break(Other(mirrored=(False, True)), black, 3),
}
