"""The SHA-256 of a file, which identifies it in a report."""

import hashlib
from pathlib import Path

from drivers.errors import RecordingError


def file_sha256(path: Path) -> str:
    """Returns the SHA-256 of a file of any size, in hexadecimal. Raises RecordingError."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise RecordingError(f"cannot be read ({error.strerror})", str(path), "Check the path and its rights") from None
