"""`python -m tests.invariant [FRAMES [SEED]]`: the state machine for so many frames, other sequences for each seed.

As many processes as there are processors share the frames; each takes every so manyth seed.
"""

import multiprocessing
import os
import sys
from concurrent.futures import ProcessPoolExecutor

from tests.invariant.long_run import share

FRAMES = 100_000


def main() -> None:
    frames, seed = ([int(argument) for argument in sys.argv[1:]] + [FRAMES, 1][len(sys.argv) - 1 :])[:2]
    count = os.cpu_count() or 1
    with ProcessPoolExecutor(count, multiprocessing.get_context("spawn")) as pool:
        parts = [pool.submit(share, seed + number, -(-frames // count), count) for number in range(count)]
        done = sum(part.result() for part in parts)
    print(f"{done:,} frames: the contact never outlived its evidence")


if __name__ == "__main__":
    main()
