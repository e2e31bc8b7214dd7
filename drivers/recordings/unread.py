"""Names what a sequence's file states and nothing here reads, for whoever relies on it."""

from collections.abc import Iterable, Mapping

from probewatch.drivers.printable import first_few, printable
from probewatch.drivers.recordings.keys import IMAGE_STATUS, ORIENTATION

_MOST_NAMES = 8
"""Largest number of fields that are named: nobody reads more than a line, and fewer hide the one that somebody has
added himself."""
_MOST_SHOWN = 40
"""Largest number of characters of a name that are shown."""
_READ = ("Timestamp", "FrameNumber", IMAGE_STATUS)
"""Fields of a frame that are read from every file."""
_LAYOUT = """
objecttype ndims binarydata binarydatabyteordermsb elementbyteordermsb compresseddata compresseddatasize dimsize
kinds elementtype elementdatafile elementnumberofchannels headersize elementspacing elementsize offset position
origin transformmatrix rotation orientation centerofrotation anatomicalorientation ultrasoundimageorientation
ultrasoundimagetype dimension type blocksize encoding endian content datafile lineskip byteskip sizes spacings
thicknesses axismins axismaxs centers centerings labels units space spacedimension spaceunits spaceorigin
spacedirections measurementframe customfieldnames customframefieldnames defaultframetransformname
"""
"""Fields of a header, in MetaImage and NRRD, that state how the pictures are stored. They are read, or mean nothing
here."""


def beside_layout(header: Iterable[str]) -> tuple[str, ...]:
    """Returns the names of a header's fields that do not state how its pictures are stored."""
    layout = frozenset(_LAYOUT.split())
    plain = {name: name.lower().replace(" ", "").replace("_", "") for name in header}
    return tuple(name for name, word in plain.items() if word not in layout and not word.startswith(("axis", "itk")))


def fields_unread(header: Iterable[str], frames: Iterable[Mapping[str, str]], transforms: Iterable[str]) -> list[str]:
    """Returns the names of the header's fields, as given, then those of the frames' fields that nothing reads.

    transforms: names of the transforms that are read.
    """
    read = {*_READ, *(f"{name}Transform{status}" for name in transforms for status in ("", "Status"))}
    there = dict.fromkeys(name for frame in frames for name in frame)
    unread = [name for name in there if name not in read]
    of_one = {f"{name}Status" for name in unread}  # the name of a transform stands for its status too
    return [*header, *(name for name in unread if name not in of_one)]


def unread_note(names: list[str]) -> str:
    """Returns one line for people; empty where everything was read."""
    shown = [printable(name)[:_MOST_SHOWN] for name in names]
    return f"not read of what the file says: {first_few(shown, _MOST_NAMES)}" if names else ""


def turned_note(stored: str, named: str | None) -> str:
    """Returns one line on pictures that are turned to MF; empty where they are not. named: the value of --orientation,
    None where it was not given.
    """
    by = ORIENTATION if named is None else "--orientation"
    return f"pictures turned from {stored} to MF, by {by}" if stored != "MF" else ""
