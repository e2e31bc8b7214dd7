"""Films that are turned or mirrored for display."""

import struct
from pathlib import Path

import cv2
import pytest

from probewatch.drivers.errors import RecordingError
from probewatch.drivers.recordings.display_matrix import is_mirrored
from probewatch.drivers.recordings.film import Film
from tests.drivers.recordings.test_film import FPS, SIZE_PX
from tests.support.recordings import picture

_TRACK_MATRIX = {"as stored": (1, 0, 0, 1), "turned": (0, 1, -1, 0), "upside down": (-1, 0, 0, -1)}
_MIRRORED = {"left to right": (-1, 0, 0, 1), "top to bottom": (1, 0, 0, -1), "turned as well": (0, 1, 1, 0)}


def displayed(folder: Path, matrix: tuple[int, int, int, int]) -> Path:
    """An MP4 whose track header asks for this, the first two columns and rows of its matrix."""
    path = folder / "film.mp4"
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"mp4v"), FPS, SIZE_PX, False)
    for index in range(4):
        writer.write(picture(index, SIZE_PX))
    writer.release()
    content = bytearray(path.read_bytes())
    at = content.index(b"tkhd") + 4 + 40
    a, b, c, d = (65536 * one for one in matrix)
    struct.pack_into(">9i", content, at, a, b, 0, c, d, 0, 0, 0, 1 << 30)
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("matrix", _TRACK_MATRIX.values(), ids=_TRACK_MATRIX)
def test_a_film_that_is_turned_for_display_is_turned(tmp_path: Path, matrix: tuple[int, int, int, int]) -> None:
    size_px = SIZE_PX if matrix[0] else SIZE_PX[::-1]
    assert Film(displayed(tmp_path, matrix)).size_px == size_px


@pytest.mark.parametrize("matrix", _MIRRORED.values(), ids=_MIRRORED)
def test_a_film_that_is_mirrored_for_display_is_refused(tmp_path: Path, matrix: tuple[int, int, int, int]) -> None:
    """One was turned by 180°, the other two were judged as they are stored: a wrong polarity either way."""
    with pytest.raises(RecordingError, match=r"asks players to mirror .*ffmpeg -i film\.mp4 -c:v ffv1 new\.mkv"):
        Film(displayed(tmp_path, matrix))


def test_pictures_are_no_header_whatever_bytes_they_hold(tmp_path: Path) -> None:
    """All of a film was read for it, a second time, so that its pictures could refuse it."""
    path = displayed(tmp_path, (1, 0, 0, 1))
    likeness = b"tkhd" + bytes(40) + struct.pack(">9i", -65536, 0, 0, 0, 65536, 0, 0, 0, 1 << 30)
    path.write_bytes(path.read_bytes() + struct.pack(">I4s", 8 + len(likeness), b"mdat") + likeness)
    assert not is_mirrored(path)
    assert len(Film(path)) == 4


@pytest.mark.parametrize("size", [0, 4, 1 << 31])
def test_a_mirrored_film_whose_boxes_lead_nowhere_is_known_all_the_same(tmp_path: Path, size: int) -> None:
    path = displayed(tmp_path, (-1, 0, 0, 1))
    path.write_bytes(struct.pack(">I", size) + path.read_bytes()[4:])
    assert is_mirrored(path)


@pytest.mark.parametrize(
    "content", [b"", b"\0\0\0\x10ftyp", b"\0\0\0\x10ftypisom tkhd", b"\0\0\0\x10ftyp tkhd" + 60 * b"\xff"]
)
def test_a_cut_film_mirrors_nothing(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "cut.mp4"
    path.write_bytes(content)
    assert not is_mirrored(path)
