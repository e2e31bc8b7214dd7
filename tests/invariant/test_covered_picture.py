"""A picture that is covered in part for a moment, and another one when the cover is taken away: samples to contact."""

import cv2
import numpy as np
import pytest

from probewatch.drivers.samples import GreyImage, Matrix4
from tests.invariant.cart import Cart
from tests.invariant.scenarios import VERIFIED_WITHIN_S


class CoveredCart(Cart):
    """A menu hides a third of its picture, or all of it is another."""

    covered = mirrored = False

    def _seen(self, pose: Matrix4) -> tuple[GreyImage, bool]:
        image, genuine = super()._seen(pose)
        if self.mirrored:
            return cv2.flip(image, 1), False
        return (covered(image), False) if self.covered else (image, genuine)


def covered(image: GreyImage) -> GreyImage:
    """Grey, with lines of text."""
    image = image.copy()
    menu = image[:, int(0.65 * image.shape[1]) :]
    menu[:], menu[::6] = 40, 90
    return np.asarray(image)


@pytest.mark.thorough
@pytest.mark.parametrize("fps", [10.0, 20.0])
def test_what_a_cover_hid_is_not_what_was_before(fps: float) -> None:
    """The last whole picture is 300 ms old when the other one comes, and the covered ones between counted as sight."""
    cart = CoveredCart(1, fps=fps)
    assert cart.run(VERIFIED_WITHIN_S, until=lambda: cart.closed), cart.told()
    cart.meet(moving=False)
    cart.run(2.0)
    assert cart.closed
    cart.covered = True
    cart.run(0.2)
    cart.mirrored = True
    assert cart.run(0.5, until=lambda: not cart.closed), cart.told()
    assert not cart.run(5.0, until=lambda: cart.closed), cart.told()
