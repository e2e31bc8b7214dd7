"""What is cut out of a captured picture, and how it is turned to the orientation that the line works in."""

import re
from dataclasses import dataclass

import numpy as np

from drivers.errors import ConfigurationError, DeviceLost
from drivers.samples import GreyImage

FLIPS = {"MF": (False, False), "MN": (True, False), "UF": (False, True), "UN": (True, True)}
"""Stored orientation → (rows, columns) to reverse for MF: marked side at column 0, near side at row 0."""

_CROP = re.compile(r"(\d{1,5}),(\d{1,5}),(\d{1,5}),(\d{1,5})")
LEAST_PX = 16
"""Side of the smallest picture, of any source, that is taken for one: less is a slip in an option or a damaged header.
No picture of a scanner is near it."""


@dataclass(frozen=True, slots=True)
class Cut:
    """crop: (left, top, width, height) px of the B-mode picture in the captured one, None for all of it."""

    crop: tuple[int, int, int, int] | None
    orientation: str

    def apply(self, image: GreyImage, where: str) -> GreyImage:
        """The part, turned to MF; a copy that owns its memory. Raises DeviceLost where the picture is too small."""
        if self.crop is not None:
            left, top, width, height = self.crop
            if image.shape[0] < top + height or image.shape[1] < left + width:
                size = f"{image.shape[1]}x{image.shape[0]}"
                remedy = "Correct crop= or the output size of the scanner"
                raise DeviceLost(f"the picture of {size} pixels does not hold the crop", where, remedy)
            image = image[top : top + height, left : left + width]
        rows, columns = FLIPS[self.orientation]
        return np.array(image[:: -1 if rows else 1, :: -1 if columns else 1], np.uint8, order="C")


def cut_from(options: dict[str, str], where: str) -> Cut:
    """Options crop=LEFT,TOP,WIDTH,HEIGHT and orientation=MF, MN, UF or UN. Raises ConfigurationError."""
    orientation = options.get("orientation", "MF").upper()
    if orientation not in FLIPS:
        raise ConfigurationError(f"orientation={orientation} is not known", where, f"Use {', '.join(FLIPS)}")
    text = options.get("crop")
    if text is None:
        return Cut(None, orientation)
    found = _CROP.fullmatch(text)
    if found is None or min(int(found[3]), int(found[4])) < LEAST_PX:
        remedy = f"Write crop=LEFT,TOP,WIDTH,HEIGHT in pixels, width and height at least {LEAST_PX}"
        raise ConfigurationError(f"crop={text} is not a part of a picture", where, remedy)
    left, top, width, height = (int(number) for number in found.groups())
    return Cut((left, top, width, height), orientation)
