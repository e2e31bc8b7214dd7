"""Which files this process holds open, for tests that none is left behind."""

import contextlib
import gc
from collections.abc import Iterator
from pathlib import Path


def open_files() -> frozenset[str]:
    """Return the number of every descriptor of this process with what it points to: a path, a socket's inode."""
    held = []
    for entry in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):  # the descriptor of this very listing
            held.append(f"{entry.name} {entry.readlink()}")
    return frozenset(held)


@contextlib.contextmanager
def leaves_nothing_open() -> Iterator[None]:
    """Assert that no file is open at the end that was not open at the beginning.

    What earlier tests left as garbage is closed first; garbage made within counts as open.
    """
    gc.collect()
    before = open_files()
    yield
    assert open_files() <= before
