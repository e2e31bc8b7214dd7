"""The state machine for many frames, in one process or as the share of one among several."""

import time
from math import ceil

import cv2

from tests.invariant.cart import Cart
from tests.invariant.machine import Room, room_test

_ROOMS, _STEPS = 12, 8
"""Of one seed, at most."""


def long_run(seed: int, frames: int, stride: int = 1) -> int:
    """Every stride-th seed from `seed` on until so many frames were delivered; returns how many were. Raises what
    breaks, with a note of the seed and its rooms; the same fails again.
    """
    Room.fps = 30.0
    first, start_s, ended = Cart.frames, time.monotonic(), 0

    def progress() -> None:
        nonlocal ended
        ended += 1
        passed_s = time.monotonic() - start_s
        print(f"\rseed {seed}: {Cart.frames - first:,} of {frames:,} frames, {passed_s:.0f} s ", end="", flush=True)

    Room.done = staticmethod(progress)
    while (done := Cart.frames - first) < frames:
        rooms = min(_ROOMS, ceil((frames - done) / done * ended)) if done else _ROOMS
        try:
            room_test(rooms, _STEPS, seed)()
        except BaseException as error:
            error.add_note(f"seed {seed}, {rooms} rooms")
            raise
        print()
        seed += stride
    return Cart.frames - first


def share(seed: int, frames: int, stride: int) -> int:
    cv2.setNumThreads(1)
    return long_run(seed, frames, stride)
