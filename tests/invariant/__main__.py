"""`python -m tests.invariant [FRAMES [SEED]]`: the state machine for so many frames, other sequences for each seed."""

import sys
import time

import cv2

from tests.invariant.cart import Cart
from tests.invariant.machine import Room, room_test

FRAMES = 100_000
_ROOMS, _STEPS = 12, 8
"""Of one seed."""


def long_run(seed: int, frames: int) -> int:
    """Seeds from `seed` on until so many frames were delivered; returns how many were. Raises what breaks.

    A seed that fails is the last one printed, with the story of the cart; the same seed fails again.
    """
    Room.fps = 30.0
    first, start_s = Cart.frames, time.monotonic()

    def progress() -> None:
        done, passed_s = Cart.frames - first, time.monotonic() - start_s
        print(f"\rseed {seed}: {done:,} of {frames:,} frames, {passed_s:.0f} s ", end="", flush=True)

    Room.done = staticmethod(progress)
    while Cart.frames - first < frames:
        room_test(_ROOMS, _STEPS, seed)()
        print()
        seed += 1
    return Cart.frames - first


def main() -> None:
    cv2.setNumThreads(1)
    frames, seed = ([int(argument) for argument in sys.argv[1:]] + [FRAMES, 1][len(sys.argv) - 1 :])[:2]
    print(f"{long_run(seed, frames):,} frames: the contact never outlived its evidence")


if __name__ == "__main__":
    main()
