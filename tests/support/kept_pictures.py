"""Rendered pictures on the disk, for all workers and runs: what the simulated world draws is the same every time.

Each is found by a digest of what it depends on: the code that renders, its libraries, the scene and its settings, pose
and number of the picture. They lie in build/rendered, or in the folder that PROBEWATCH_RENDERED names.
"""

import contextlib
import os
import platform
import tempfile
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path

import cv2
import numpy as np

from probewatch.drivers.samples import GreyImage

ROOT = Path(__file__).parents[2]
FOLDER = Path(os.environ.get("PROBEWATCH_RENDERED") or ROOT / "build/rendered")
MOST_BYTES = 2_500_000_000
"""What the folder keeps from one run to the next; those that were not used for longest go first. What the
quick and the thorough tests render is less than half of it."""
_RENDERING = (
    "drivers/twins",
    "drivers/rigid.py",
    "tools/study/session.py",
    "tools/study/samples.py",
    "tools/study/hand.py",
)


@cache
def rendering_digest() -> str:
    """What every picture depends on: sources, libraries, processor."""
    digest = sha256(f"{np.__version__} {cv2.__version__} {platform.machine()}".encode())
    for path in (ROOT / name for name in _RENDERING):
        for source in sorted(path.rglob("*.py")) or [path]:
            digest.update(source.relative_to(ROOT).as_posix().encode() + b"\0" + source.read_bytes())
    return digest.hexdigest()[:16]


def folder_of(scene: str) -> Path:
    """Where pictures of a scene lie; scene: all that they depend on beside the code, as text."""
    _limited_once()
    return FOLDER / sha256(f"{rendering_digest()} {scene}".encode()).hexdigest()[:16]


def sessions() -> Path:
    """Where those of studies lie, which `tools.study.samples.rendered` writes as recordings."""
    return folder_of("sessions")


def picture(path: Path, size_px: tuple[int, int], render: Callable[[], GreyImage]) -> GreyImage:
    """(h, w) uint8, read-only, from the file, or rendered and kept there; size_px: (width, height). A file of another
    size, as a computer that lost its power leaves it, is written again.
    """
    width, height = size_px
    with contextlib.suppress(FileNotFoundError):
        data = path.read_bytes()
        if len(data) == width * height:
            os.utime(path)
            return np.frombuffer(data, np.uint8).reshape(height, width)
    image = np.ascontiguousarray(render())
    _put(path, image.tobytes())
    image.flags.writeable = False
    return image


def _put(path: Path, data: bytes) -> None:
    """Under its name once it is whole, so that nobody reads half of it. Not forced to the disk, which takes longer than
    rendering: what is lost is rendered again.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as stream:
        stream.write(data)
    Path(stream.name).replace(path)


@cache
def _limited_once() -> None:
    limit(FOLDER, MOST_BYTES)


def limit(folder: Path, most_bytes: int) -> None:
    """Delete files until the folder holds no more than most_bytes, those first that were used least lately."""
    found = []
    for path in folder.rglob("*"):
        with contextlib.suppress(FileNotFoundError):
            if path.is_file():
                found.append((path.stat().st_mtime_ns, path.stat().st_size, path))
    excess = sum(size for _, size, _ in found) - most_bytes
    for _, size, path in sorted(found):
        if excess <= 0:
            return
        path.unlink(missing_ok=True)
        excess -= size
