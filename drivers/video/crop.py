"""Cuts the B-mode picture out of a captured one, and turns it to the orientation in which the line works."""

import re
from dataclasses import dataclass

from probewatch.drivers.descriptor import Given, Option
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.samples import GreyImage

FLIPS = {"MF": (False, False), "MN": (True, False), "UF": (False, True), "UN": (True, True)}
"""Stored orientation → (rows, columns) to reverse for MF: marked side at column 0, near side at row 0."""

_CROP = re.compile(r"(\d{1,5}),(\d{1,5}),(\d{1,5}),(\d{1,5})")
LEAST_PX = 16
"""Side of the smallest picture that is accepted from any source: less is a typing error in an option or a damaged
header. No picture of a scanner is near it.
"""

CROP = Option(
    "crop",
    "the part of the screen that is the B-mode picture; the calibration counts its pixels from there",
    "all of it",
    form="LEFT,TOP,WIDTH,HEIGHT",
    refusal="is not a part of a picture",
)
ORIENTATION = Option(
    "orientation",
    "the scanner shows the marked (M) or unmarked (U) side at the left, the probe's face at the top (F) or bottom (N)",
    "MF",
    words=tuple(FLIPS),
    refusal="is not known",
)


@dataclass(frozen=True, slots=True)
class Cut:
    """Represents what to cut out and how to turn it. crop: (left, top, width, height) px of the B-mode picture in the
    captured one, None for all of it. orientation: a key of FLIPS.
    """

    crop: tuple[int, int, int, int] | None
    orientation: str

    def require_within(self, width: int, height: int, where: str) -> None:
        """Raises DeviceLost where a picture of width × height pixels does not contain the crop."""
        if self.crop is None:
            return
        left, top, cut_width, cut_height = self.crop
        if height < top + cut_height or width < left + cut_width:
            remedy = "Correct crop= or the output size of the scanner"
            raise DeviceLost(f"the picture of {width}x{height} pixels does not hold the crop", where, remedy)

    def apply(self, image: GreyImage, where: str) -> GreyImage:
        """Returns the crop, turned to MF, as a view of the image. Raises DeviceLost where the picture is too small."""
        height, width = image.shape
        self.require_within(width, height, where)
        if self.crop is not None:
            left, top, width, height = self.crop
            image = image[top : top + height, left : left + width]
        rows, columns = FLIPS[self.orientation]
        return image[:: -1 if rows else 1, :: -1 if columns else 1]


def cut_from(given: Given) -> Cut:
    """Reads the options CROP and ORIENTATION. Raises ConfigurationError."""
    orientation, text = given.word(ORIENTATION.name), given.text(CROP.name)
    if text is None:
        return Cut(None, orientation)
    found = _CROP.fullmatch(text)
    if found is None or min(int(found[3]), int(found[4])) < LEAST_PX:
        remedy = f"Write crop={CROP.form} in pixels, width and height at least {LEAST_PX}"
        raise given.refusal(CROP.name, remedy)
    left, top, width, height = (int(number) for number in found.groups())
    return Cut((left, top, width, height), orientation)
