"""Reads what a PLUS device set states about the devices beside its calibration: the part of the picture, and their
delays.

The calibration is read by `calibration_file`. The remarks are for a person: PLUS applies these settings itself to what
it sends over OpenIGTLink, and a cart that reads the devices with its own drivers needs them stated.
"""

from collections.abc import Iterator
from xml.etree import ElementTree as ET

from probewatch.appliance.storage.calibration_file import is_device_set
from probewatch.drivers.files.markup import number_of, xml_of
from probewatch.drivers.printable import first_few, printable
from probewatch.drivers.video.crop import FLIPS

_LEAST_OFFSET_S = 0.0005
"""Smallest offset, s, that is worth a remark: half of the last digit of latency_ms as a person gives it. Anything
smaller counts as PLUS's 0."""
_MOST_LISTED = 6
"""Largest number of transforms that are named as not kept: a device set has a handful, and nobody reads more than two
lines."""
_MOST_SHOWN = 40
"""Largest number of characters of a name or value that are repeated; those of PLUS are shorter."""
_KEPT = ("From", "To", "Matrix")
"""Attributes of a transform that make the calibration."""
_MOST_REMARKS = 8
"""Largest number of remarks on one file: a device set has a handful of devices, and nobody reads more than a screen."""


def clip_px(content: bytes) -> tuple[int, int, int, int] | None:
    """Returns (left, top, width, height) of the part of the picture that the calibration is of; None unless one is
    named.
    """
    named = {clip for node in _devices(content) for clip in _clips(node)}
    return named.pop() if len(named) == 1 else None


def remarks(content: bytes, image_size_px: tuple[int, int] | None = None) -> tuple[str, ...]:
    """Returns sentences for the person who takes the calibration; empty for a file that is no device set.

    image_size_px: (width, height) of the pictures, where it is known.
    """
    devices = _devices(content)
    return (*_of_clips(devices, image_size_px), *_of_orientations(devices), *_of_offsets(devices))[:_MOST_REMARKS]


def not_kept(content: bytes) -> tuple[str, ...]:
    """Returns one sentence on what transforms state beside their matrix, such as Error and Date; none where they state
    nothing.
    """
    said = []
    for node in _nodes(content, ".//CoordinateDefinitions//Transform"):
        beside = [f"{name} {_shown(value)}" for name, value in node.attrib.items() if name not in _KEPT]
        if beside:
            said.append(f"{' and '.join(beside)} ({_shown(node.get('From', ''))} to {_shown(node.get('To', ''))})")
    return (f"not kept of what the file says: {first_few(said, _MOST_LISTED)}",) if said else ()


def _of_clips(devices: list[ET.Element], image_size_px: tuple[int, int] | None) -> Iterator[str]:
    for node in devices:
        for clip in dict.fromkeys(_clips(node)):
            left, top, width, height = clip
            said = f"PLUS cuts {width} x {height} px from ({left}, {top}) out of the picture of {_name(node)}"
            wrong = ""
            if image_size_px is not None and image_size_px != (width, height):
                wrong = f", and {image_size_px[0]} x {image_size_px[1]} were given"
            yield (
                f"{said}; the calibration is of that part{wrong}. With v4l2: or opencv: give "
                f"crop={left},{top},{width},{height} in the URL; over igtl: PLUS has cut it already"
            )


def _of_orientations(devices: list[ET.Element]) -> Iterator[str]:
    for device in devices:
        named = {node.get("PortUsImageOrientation", "").upper()[:2] for node in device.iter()}
        for stored in sorted(named & (FLIPS.keys() - {"MF"})):
            yield (
                f"PLUS turns the picture of {_name(device)} from {stored} to MF, to which the calibration refers. With "
                f"v4l2: or opencv: give orientation={stored} in the URL; over igtl: PLUS has turned it already"
            )


def _of_offsets(devices: list[ET.Element]) -> Iterator[str]:
    for node in devices:
        offset_s = _number(node.get("LocalTimeOffsetSec", ""))
        if offset_s is not None and abs(offset_s) >= _LEAST_OFFSET_S:
            yield (
                f"PLUS adds LocalTimeOffsetSec = {offset_s:g} s to the times of {_name(node)}. Over igtl: it has done "
                "so already; where this cart reads the devices itself, measure it with 'probewatch latency' and give "
                "latency_ms in the tracker's URL"
            )


def _devices(content: bytes) -> list[ET.Element]:
    return _nodes(content, ".//DataCollection//Device")


def _nodes(content: bytes, path: str) -> list[ET.Element]:
    if not is_device_set(content):
        return []
    try:
        return list(xml_of(content).iterfind(path))
    except ValueError:
        return []


def _shown(text: str) -> str:
    return printable(text)[:_MOST_SHOWN]


def _name(node: ET.Element) -> str:
    return f"'{_shown(node.get('Id', ''))}'"


def _clips(device: ET.Element) -> Iterator[tuple[int, int, int, int]]:
    """Yields the clips of the device and its sources; PLUS writes a size of 0 or -1 for all of the picture."""
    for node in device.iter():
        origin, size = (_pair(node.get(f"ClipRectangle{what}", "")) for what in ("Origin", "Size"))
        if size is not None and min(size) > 0:
            yield (*(origin or (0, 0)), *size)


def _pair(text: str) -> tuple[int, int] | None:
    words = text.split()[:2]
    if len(words) < 2 or not all(word.lstrip("-").isdecimal() and len(word) < 7 for word in words):
        return None
    return int(words[0]), int(words[1])


def _number(text: str) -> float | None:
    try:
        return number_of(text)
    except ValueError:
        return None
