"""Finds recordings in a folder or an object store that fsspec reaches, and copies them while they are needed."""

import re
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from probewatch.drivers.errors import ConfigurationError, DeviceLost
from probewatch.drivers.printable import printable
from probewatch.drivers.recordings.metaimage import MAX_HEADER_BYTES
from probewatch.tools.shared.digest import HEADERS, pictures_named
from probewatch.tools.shared.found_recordings import SUFFIXES
from probewatch.tools.study.table import INSTALL

_COPY_BYTES = 1 << 22
"""Bytes taken from the store at once: a request of an object store costs some 50 ms, whatever its size. Not
measured."""

_HEAD_BYTES = 1 << 18
"""Bytes taken from the store at once of a header, which is read for the state of its recording: a kB, or one a picture.
More takes pictures with it, less takes more requests. Not measured."""
_BOX = re.compile(r"-(?P<session>[^-/]+)-(?P<part>\d{5})\.mcap$")
"""Names that a recorder gives the files of one run."""


class NotFetchedError(Exception):
    """Carries the reason why a recording could not be fetched; another time it may be."""


def is_url(name: str) -> bool:
    """Returns whether the name is that of a place for fsspec, and not a path of this computer."""
    return "://" in name


def listed(url: str) -> list[tuple[str, ...]]:
    """Returns the URLs of the recordings under a folder, or of the one file that is named; the files of one run of a
    recorder belong together. Raises ConfigurationError for what cannot be a place, or holds none, DeviceLost where it
    does not answer.
    """
    if urlsplit(url).username is not None:
        remedy = "Give them as the store's own tools take them, by environment or file"
        raise ConfigurationError("credentials in an address would stand in the table", printable(url), remedy)
    filesystem, path = _opened(url)
    try:
        names = [path] if filesystem.isfile(path) else filesystem.find(path)
        found = sorted(filesystem.unstrip_protocol(name) for name in names)
    except Exception as error:  # each store has its own
        raise DeviceLost(
            f"cannot be listed: {_said(error)}", printable(url), "Check address and permissions"
        ) from error
    recordings = [name for name in found if name.lower().endswith(SUFFIXES)]
    if not recordings:
        raise ConfigurationError("holds no recordings", printable(url), f"It looks for {', '.join(SUFFIXES)}")
    together: dict[str, list[str]] = {}
    for name in recordings:
        box = _BOX.search(name)
        together.setdefault(name if box is None else box["session"], []).append(name)
    return [tuple(names) for names in together.values()]


def state_of(urls: tuple[str, ...]) -> str:
    """Returns what changes with the content of the files, also of those that have the pictures of a header, as their
    store reports it; empty where it has no such thing.
    """
    try:
        whole = [one for url in urls for one in (url, *_pictures_of(url))]
        return " ".join(f"{filesystem.checksum(path):x}" for filesystem, path in map(_opened, whole))
    except Exception:  # each store has its own, and what does not answer is reported when it is fetched
        return ""


@contextmanager
def fetched(urls: tuple[str, ...]) -> Iterator[tuple[Path, ...]]:
    """Yields copies on this computer, under their own names, until the context is left; the file with the pictures of a
    header follows it. Raises NotFetchedError.
    """
    with tempfile.TemporaryDirectory(prefix="probewatch-study-") as folder:
        yield tuple(file for number, url in enumerate(urls) for file in _copies(url, Path(folder) / str(number)))


def _copies(url: str, folder: Path) -> Iterator[Path]:
    folder.mkdir()
    yield (header := _copied(url, folder))
    if (name := _named(header)) is not None:
        yield _copied(_beside(url, name), folder)


def _named(header: Path) -> str | None:
    """Returns the name of the file with the pictures of a header; None where it has them itself."""
    if not header.name.lower().endswith(SUFFIXES):
        return None
    with header.open("rb") as stream, suppress(ValueError):  # the reader of the recording says what is wrong
        return pictures_named(stream)
    return None


def _pictures_of(url: str) -> Iterator[str]:
    """Yields the URL of the file with the pictures, for a header that has none; it is read in the store, as far as it
    names where they are.
    """
    if url.lower().endswith(HEADERS):
        filesystem, path = _opened(url)
        with filesystem.open(path, "rb", block_size=_HEAD_BYTES) as stream:
            name = pictures_named(_header(stream))
        if name is not None:
            yield _beside(url, name)


def _header(stream: Iterable[bytes]) -> Iterator[bytes]:
    """Yields the lines up to the longest header that is read; what is longer is not a recording."""
    taken = 0
    for line in stream:
        taken += len(line)
        if taken > MAX_HEADER_BYTES:
            return
        yield line


def _beside(url: str, name: str) -> str:
    return f"{url.rpartition('/')[0]}/{name}"


def _copied(url: str, folder: Path) -> Path:
    filesystem, path = _opened(url)
    copy = folder / Path(path).name
    try:
        with filesystem.open(path, "rb") as source, copy.open("wb") as target:
            while data := source.read(_COPY_BYTES):
                target.write(data)
    except Exception as error:  # each store has its own
        raise NotFetchedError(f"{copy.name}: {_said(error)}") from error
    return copy


def _opened(url: str) -> tuple[Any, str]:
    """Returns (file system, path in it). Raises ConfigurationError."""
    try:
        import fsspec  # noqa: PLC0415  an extra that a cart does not have
    except ImportError:
        remedy = INSTALL
        raise ConfigurationError("needs the package fsspec", printable(url), remedy) from None
    try:
        filesystem, path = fsspec.core.url_to_fs(url)
    except Exception as error:
        remedy = "Such as file:///archive or s3://bucket/archive; a store needs its package, such as s3fs"
        raise ConfigurationError(f"cannot be reached: {_said(error)}", printable(url), remedy) from error
    return filesystem, path


def _said(error: Exception) -> str:
    return printable(str(error) or type(error).__name__)
