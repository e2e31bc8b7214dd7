"""`python -m tests.invariant [FRAMES [SEED]]`: the state machine for so many frames, other sequences for each seed.

Without a seed it is made of the commit, so that every commit tries other ones. The same frames and seed are the same
sequences on every computer: the frames are divided into shares, each with seeds of its own, and as many shares are
beside each other as there are processors.
"""

import os
from contextlib import closing
from hashlib import sha256

import click

from probewatch.tools.shared.interruption import said_when_interrupted
from probewatch.tools.study.table import commit
from probewatch.tools.study.workers import results
from tests.invariant.long_run import Share

_SHARE_FRAMES = 12_500
"""A minute of one processor: two of them are busy for the whole of the gate's 25,000 frames."""


@click.command()
@click.argument("frames", default=25_000, type=click.IntRange(1))
@click.argument("seed", required=False, type=click.IntRange(0))
def main(frames: int, seed: int | None) -> None:
    """Raise what breaks; its notes say the seed."""
    origin = "" if seed is not None else f", made of commit {commit().removesuffix('+')}"
    seed = seed_of(commit()) if seed is None else seed
    what = f"invariant, {frames:,} frames from seed {seed}{origin}; again: make invariant SEED={seed} FRAMES={frames}"
    print(what, flush=True)
    with (
        said_when_interrupted(what),
        closing(results(Share.run, shares(frames, seed), os.cpu_count() or 1, None)) as done,
    ):
        total = sum(done)
    print(f"{total:,} frames: the contact never outlived its evidence")


def seed_of(commit_told: str) -> int:
    """Another for each commit; files that differ from it, which "+" says, change no seed."""
    return int(sha256(commit_told.removesuffix("+").encode()).hexdigest()[:8], 16)


def shares(frames: int, seed: int) -> list[Share]:
    """Together so many frames or more."""
    count = -(-frames // _SHARE_FRAMES)
    return [Share(seed + number, -(-frames // count), count) for number in range(count)]


if __name__ == "__main__":
    main()
