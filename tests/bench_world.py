"""`python -m tests.bench_world`: pictures per second of the simulated world on one core."""

import time

import cv2

from drivers.twins.world import World


def main() -> None:
    """Print wall and processor time per frame of the clinical sweep at 640 × 480."""
    cv2.setNumThreads(1)
    world = World()
    world.frame(0.0, 0)
    frames = 200
    wall_s, busy_s = time.perf_counter(), time.process_time()
    for index in range(frames):
        world.frame(index / 30, index)
    wall_ms = (time.perf_counter() - wall_s) / frames * 1e3
    busy_ms = (time.process_time() - busy_s) / frames * 1e3
    print(f"frame 640 x 480: {wall_ms:.1f} ms wall, {busy_ms:.1f} ms processor, {1e3 / busy_ms:.0f} frames/s")


if __name__ == "__main__":
    main()
