"""Reads a film, such as a screen recorder writes, as one half of a recording; the other half is a table of poses
(pose_table.py).

Any film that OpenCV decodes is read; its time begins with 0 at its first picture.
"""

import os
import re
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from probewatch.drivers.errors import RecordingError
from probewatch.drivers.files.regular_file import reading
from probewatch.drivers.recordings.display_matrix import is_mirrored
from probewatch.drivers.recordings.metaimage import MAX_PIXELS, unreadable
from probewatch.drivers.samples import GreyImage
from probewatch.drivers.trackers.plus_transform import TransformReading, without_matrix
from probewatch.drivers.video.crop import FLIPS
from probewatch.drivers.video.no_film import why_no_film

_MOST_PICTURES = 1_000_000
"""Largest number of pictures that are read from a film: nine hours at 30 Hz, whose times are all kept. A damaged film
may have no end."""
_COMPLETE = 0.9
"""Share of the pictures that a header counts, or of the time that they take, from which a film is complete: where the
rate varies, a Matroska film has fewer pictures than are counted from its duration. Less accepts a film that has lost
its end. Not measured."""
_DARK = 64
"""Grey value, of 255, that the brightest pixel must reach in a film of more than 8 bits: in ultrasound it is saturated
or nearly so. More refuses a dim film; less takes values of 12 or 14 bits in pixels of 16 for a black picture. Not
measured."""
_LOOKED_AT = 10
"""Number of pictures in which the brightest pixel is sought. More costs decoding; fewer may all show a probe in the
air."""
_LISTS = (b"#EXTM3U", b"ffconcat", b"ID3")
"""First bytes of the files that FFmpeg takes for lists of other films, wherever those lie, and of the tag that it skips
before it looks for such bytes."""
_PATTERN = re.compile(r"%[0-9]*d|%[*?\[\]{}]")
"""What makes FFmpeg read a name as a pattern that stands for one file per picture."""


class Film:
    """Represents a film as a sequence of pictures without poses. Raises RecordingError where nothing can be decoded.

    lacking: number of pictures that its header counts and that are missing, as in a film that was cut.
    """

    def __init__(self, path: Path, orientation: str | None = None) -> None:
        self.path = path
        named = (orientation or "MF").upper()
        if named[:2] not in FLIPS:
            raise RecordingError(f"orientation {named} is not known", str(path), f"Use {', '.join(FLIPS)}")
        self._flips = FLIPS[named[:2]]
        self._times_ns, self.size_px, counted = self._looked_through()
        there = len(self._times_ns)
        self.lacking = counted - there if there < _COMPLETE * counted else 0

    def __len__(self) -> int:
        return len(self._times_ns)

    def transform_names(self) -> list[str]:
        return []

    def misnamed(self) -> list[str]:
        return []

    def stamp_ns(self, index: int) -> int:
        return self._times_ns[index]

    def sequence(self, index: int) -> int:
        return index

    def image_ok(self, index: int) -> bool:
        return True

    def transform(self, index: int, name: str) -> TransformReading:
        return without_matrix("MISSING", name)

    def pictures(self) -> Iterator[GreyImage]:
        """Yields each picture in turn, (height, width), MF-oriented; one is in memory."""
        rows, columns = (slice(None, None, -1 if flip else 1) for flip in self._flips)
        film = self._opened()
        try:
            for _ in self._times_ns:
                there, picture = film.read()
                if not there:
                    break
                grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture
                yield np.ascontiguousarray(np.asarray(grey, np.uint8)[rows, columns])
        finally:
            film.release()

    def _opened(self) -> cv2.VideoCapture:
        try:
            with reading(self.path) as stream:
                head = stream.read(max(map(len, _LISTS)))
        except OSError as error:
            raise unreadable(self.path, error) from error
        if head.startswith(_LISTS):
            what = "is a list of other files, not a film that holds its own pictures"
            raise RecordingError(what, str(self.path), "Convert it to MP4 or MKV where those files are yours")
        place = str(self.path.absolute())  # as FFmpeg takes what precedes a colon for a protocol
        if _PATTERN.search(place):
            what = "has a % in its name or folder that stands for the numbers of other files"
            raise RecordingError(what, str(self.path), "Rename it without the %")
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # keeps its lines out of the output of the command
        cv2.utils.logging.setLogLevel(0)
        film = cv2.VideoCapture(place, cv2.CAP_FFMPEG)
        remedy = "Copy it again where it is cut, else convert it to MP4 or MKV"
        if refused := why_no_film(film, "cannot be decoded as a film", remedy):
            raise RecordingError(refused[0], str(self.path), refused[1])
        return film

    def _looked_through(self) -> tuple[list[int], tuple[int, int], int]:
        """Reads the whole film once, and returns (times of all pictures, ns from the first; (width, height); number of
        pictures that the header counts, 0 where it counts none or the film lasts about as long as it states).

        Raises RecordingError for a film that cannot be used.
        """
        film, times_ns, seen = self._opened(), list[int](), _Look()
        if is_mirrored(self.path):
            film.release()
            what = "asks players to mirror its pictures, which the decoder here does not do"
            remedy = f"Store them as they are to be seen: ffmpeg -i {self.path.name} -c:v ffv1 new.mkv"
            raise RecordingError(what, str(self.path), remedy)
        try:
            told = film.get(cv2.CAP_PROP_FRAME_COUNT)
            counted = round(told) if 0 < told < _MOST_PICTURES else 0
            lasts_s = counted / film.get(cv2.CAP_PROP_FPS) if film.get(cv2.CAP_PROP_FPS) > 0 else 0.0
            deep_bits = _deep_grey(round(film.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)))
            size_px = round(film.get(cv2.CAP_PROP_FRAME_WIDTH)), round(film.get(cv2.CAP_PROP_FRAME_HEIGHT))
            if size_px[0] * size_px[1] > MAX_PIXELS:
                what = f"has {size_px[0]} × {size_px[1]} pixels; more than {MAX_PIXELS} are no picture of a scanner"
                raise RecordingError(what, str(self.path), "Cut the pictures, or make them smaller")
            while len(times_ns) < _MOST_PICTURES and film.grab():
                times_ns.append(round(film.get(cv2.CAP_PROP_POS_MSEC) * 1e6))
                seen.look(film)
            codec = round(film.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little", signed=True).decode("ascii", "replace")
        finally:
            film.release()
        if not times_ns and counted > 1:
            what = f"counts {counted} pictures, none of which can be decoded here (codec {codec.strip()})"
            raise RecordingError(what, str(self.path), f"Convert it: ffmpeg -i {self.path.name} -c:v ffv1 new.mkv")
        if not times_ns:
            raise RecordingError("holds no pictures", str(self.path), "It may be cut short: copy it again")
        if seen.alike and len(times_ns) > 1:
            what = f"gives one and the same picture {len(times_ns)} times: it is interlaced, or was frozen throughout"
            remedy = f"Make interlaced pictures whole: ffmpeg -i {self.path.name} -vf yadif -c:v ffv1 new.mkv"
            raise RecordingError(what, str(self.path), remedy)
        if deep_bits and seen.brightest < _DARK:
            what = (
                f"has pixels of {deep_bits} bits, none of which comes to a quarter of white, as of 12 bits stored in 16"
            )
            raise RecordingError(
                what, str(self.path), "Rescale all pictures alike to 8 bits of grey, and save them again"
            )
        first_ns = times_ns[0]
        is_whole = times_ns[-1] - first_ns >= _COMPLETE * lasts_s * 1e9
        return [t_ns - first_ns for t_ns in times_ns], size_px, 0 if is_whole else counted


def _deep_grey(pixel_format: int) -> int:
    """Returns the bits of a grey pixel where they are more than 8, else 0. FFmpeg tags such formats with Y, 1, 0 and
    the bits, in this order or reversed.
    """
    tag = (pixel_format & 0xFFFFFFFF).to_bytes(4, "little")
    tag = tag if tag[:1] == b"Y" else tag[::-1]
    return tag[3] if tag[:3] == b"Y1\0" and tag[3] > 8 else 0


class _Look:
    """Tracks what the first pictures show. alike: whether all are the same so far, as those of an interlaced film are:
    FFmpeg's scaler refuses them, and OpenCV ignores that and returns whatever its memory holds, each time the same.
    brightest: the brightest pixel in them, of 255.
    """

    def __init__(self) -> None:
        self.alike, self.brightest, self._count = True, 0, 0
        self._first: np.ndarray | None = None

    def look(self, film: cv2.VideoCapture) -> None:
        """Examines the picture that was grabbed last; does nothing once enough were seen and two have differed."""
        if not self.alike and self._count >= _LOOKED_AT:
            return
        there, picture = film.retrieve()
        if not there:
            return
        self._count += 1
        self.alike = self.alike and (self._first is None or np.array_equal(picture, self._first))
        self._first = picture
        self.brightest = max(self.brightest, int(picture.max()))
