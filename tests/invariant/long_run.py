"""The state machine for many frames, in one process or as the share of one among several."""

import time
from dataclasses import dataclass
from math import ceil

import cv2

from tests.invariant.cart import Cart
from tests.invariant.machine import Room, room_test

_ROOMS, _STEPS = 12, 8
"""Of one seed, at most."""
_ROOM_FRAMES = 1900
"""Of such a room on average, over eight of one seed: how many rooms the first seed has, where fewer will do."""


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
        a_room = done / ended if done else _ROOM_FRAMES
        rooms = min(_ROOMS, ceil((frames - done) / a_room))
        try:
            room_test(rooms, _STEPS, seed)()
        except BaseException as error:
            error.add_note(f"seed {seed}, {rooms} rooms")
            raise
        print()
        seed += stride
    return Cart.frames - first


@dataclass(frozen=True)
class Share:
    """One process's part of a run: every stride-th seed from `seed` on."""

    seed: int
    frames: int
    stride: int

    def run(self) -> int:
        """Frames that were delivered."""
        cv2.setNumThreads(1)
        return long_run(self.seed, self.frames, self.stride)
