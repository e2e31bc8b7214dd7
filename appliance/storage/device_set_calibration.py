"""Reads the calibration in a device-set XML of the PLUS toolkit by composing its transforms."""

from collections import defaultdict, deque
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.appliance.types import Calibration
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.markup import SAVE_AS_UTF_8, NotUtf8Error, numbers_of, xml_of
from probewatch.drivers.samples import Matrix4

_Named = tuple[str, str, str]
"""From, To and Matrix of a transform."""
_Step = tuple[_Named, bool]
"""A transform on the path from one frame to another, and whether it is inverted there."""


def device_set_calibration(data: bytes, path: Path, image_size_px: tuple[int, int] | None, probe: str) -> Calibration:
    """Returns the calibration in a device set; arguments as for `read_calibration`. Raises ConfigurationError."""
    if image_size_px is None:
        what = "a PLUS calibration does not state the size of the pictures"
        raise ConfigurationError(what, str(path), "Give it with pictures, or a .toml calibration")
    start, _, end = probe.rpartition("To") if "To" in probe else ("Image", "", probe)
    transforms = _xml_transforms(data, path)
    way = _way(transforms, start, end)
    twice = next((one for one, _ in way if sum(one[:2] == other[:2] for other in transforms) > 1), None)
    if not way or twice is not None:
        lack = f"no way from {start} to {end}" if twice is None else f"two transforms {twice[0]} to {twice[1]}"
        names = ", ".join(f"{one} to {other}" for one, other, _ in transforms) or "none"
        remedy = (
            "Give a device set with one probe calibration; or make a .toml of it (calibration import), which serves"
        )
        remedy += " a recording whose tool has another name; or name its transform, such as LeftImageToProbe: --probe"
        what = f"has {lack} in CoordinateDefinitions; it has {names}"
        raise ConfigurationError(what, str(path), f"{remedy}, configure --calibration-probe, or [calibration] probe")
    matrix = np.eye(4)
    for (one, other, text), turned in way:
        where = f"{path}: Transform From {one} To {other}"
        step = _sixteen(text, where)
        matrix = (_inverse(step, where) if turned else step) @ matrix
    return calibration_from_image_to_probe(matrix, image_size_px, where=f"{path}: from {start} to {end}")


def _way(transforms: Sequence[_Named], start: str, end: str) -> list[_Step]:
    """Returns the shortest chain from one frame to the other, as PLUS composes transforms; empty where there is none. A
    transform is inverted, as PLUS does too, only where no other path leads there.
    """
    return _shortest(transforms, start, end, (False,)) or _shortest(transforms, start, end, (False, True))


def _shortest(transforms: Sequence[_Named], start: str, end: str, allowed: tuple[bool, ...]) -> list[_Step]:
    leaving = defaultdict[str, list[_Step]](list)
    for one in transforms:
        for turned in allowed:
            leaving[one[turned]].append((one, turned))
    ways: dict[str, list[_Step]] = {start: []}
    frames = deque([start])
    while frames and end not in ways:
        at = frames.popleft()
        for step in leaving[at]:
            one, turned = step
            reached = one[not turned]
            if reached not in ways:
                ways[reached] = [*ways[at], step]
                frames.append(reached)
    return ways.get(end, [])


def _inverse(matrix: Matrix4, where: str) -> Matrix4:
    try:
        return np.asarray(np.linalg.inv(matrix))
    except np.linalg.LinAlgError:
        raise ConfigurationError("Matrix cannot be turned back", where, "Restore the file") from None


def _sixteen(text: str, where: str) -> Matrix4:
    try:
        return np.array(numbers_of(text)).reshape(4, 4)
    except ValueError:
        raise ConfigurationError("Matrix is not sixteen numbers", where, "Restore the file") from None


def _xml_transforms(data: bytes, path: Path) -> list[_Named]:
    """Returns every Transform."""
    try:
        root = xml_of(data)
    except NotUtf8Error as error:
        raise ConfigurationError(str(error), str(path), SAVE_AS_UTF_8) from None
    except ValueError as error:
        raise ConfigurationError(f"is not XML as PLUS writes it: {error}", str(path), "Restore the file") from error
    nodes = root.iterfind(".//CoordinateDefinitions//Transform")
    return [(node.get("From", ""), node.get("To", ""), node.get("Matrix", "")) for node in nodes]
