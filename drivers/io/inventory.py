"""Lists what is connected to this host, from /dev, /sys and /proc alone: no device is opened, so none is disturbed."""

import grp
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from probewatch.drivers.descriptor import GPIO_CHIP, SERIAL_PORT, VIDEO_NODE, Target
from probewatch.drivers.printable import printable_bytes

ROOT = Path("/")

_SERIAL = re.compile(r"tty(USB|ACM|AMA|S|mxc|THS)\d+")
_NO_HARDWARE = "0"
_LEVELS_UP = 5
"""Folders of /sys above a port in which its USB device is searched for. It is two above a USB serial port. Drivers that
put it deeper are covered as well; many more would find the hub or the host controller instead.
"""


@dataclass(frozen=True, slots=True)
class Found:
    """Holds one device. path: the name to configure, the permanent one where there is one. node: the kernel's name in
    /dev.

    title: what the device reports that it is. obstacle: why this user cannot open it now, in words; empty if it can be
    opened.
    """

    path: str
    node: str
    title: str
    obstacle: str = ""


def serial_ports(root: Path = ROOT) -> tuple[Found, ...]:
    """Returns the serial ports with hardware behind them, under the id that survives replugging where they have one."""
    folder = root / "sys/class/tty"
    names = [name for name in _names(folder, _SERIAL) if _read(folder / name / "type") != _NO_HARDWARE]
    return _found(root, {name: _usb_title(folder / name) for name in names}, "dev/serial/by-id")


def video_devices(root: Path = ROOT) -> tuple[Found, ...]:
    """Returns the V4L2 nodes. A camera may have a second node that carries no pictures."""
    folder = root / "sys/class/video4linux"
    titles = {name: _video_title(folder / name) for name in _names(folder, re.compile(r"video\d+"))}
    return _found(root, titles, "dev/v4l/by-id")


def gpio_chips(root: Path = ROOT) -> tuple[Found, ...]:
    """Returns the GPIO chips, with the label from their driver and the number of lines, as far as sysfs states them."""
    folder, labels = root / "sys/bus/gpio/devices", dict(_gpio_labels(root / "sys/class/gpio"))
    titles = {}
    for name in _names(folder, re.compile(r"gpiochip\d+")):
        parent = (folder / name).resolve().parent
        titles[name] = labels.get(parent, parent.name)
    return _found(root, titles, "")


CONNECTED: dict[Target, Callable[[Path], tuple[Found, ...]]] = {
    SERIAL_PORT: serial_ports,
    VIDEO_NODE: video_devices,
    GPIO_CHIP: gpio_chips,
}
"""Kinds of target that can be searched for on this host → the function that lists them."""


def _found(root: Path, titles: dict[str, str], by_id: str) -> tuple[Found, ...]:
    lasting = {link.resolve().name: f"/{by_id}/{link.name}" for link in _entries(root / by_id)} if by_id else {}
    holders = _holders(root)
    return tuple(
        Found(lasting.get(name, f"/dev/{name}"), f"/dev/{name}", title, _obstacle(root, name, holders))
        for name, title in sorted(titles.items(), key=lambda entry: _natural(entry[0]))
    )


def _obstacle(root: Path, name: str, holders: dict[str, str]) -> str:
    node = root / "dev" / name
    try:
        owner = node.stat()
    except OSError:
        return "has no node in /dev"
    if not os.access(node, os.R_OK | os.W_OK, effective_ids=True):
        return f"no permission; add this user to the group '{_group(owner.st_gid)}'"
    holder = holders.get(f"/dev/{name}")
    return f"in use by {holder}" if holder else ""


def _holders(root: Path) -> dict[str, str]:
    """Returns device node → name and number of the process that has it open, as far as this user may look."""
    found = {}
    for process in _entries(root / "proc"):
        if not process.name.isdecimal():
            continue
        for handle in _entries(process / "fd"):
            target = _link(handle)
            if target.startswith("/dev/"):
                found[target] = f"{_read(process / 'comm') or 'a process'} ({process.name})"
    return found


def _usb_title(device: Path) -> str:
    """Returns manufacturer and product of the adapter, from the nearest parent that is a USB device."""
    place = (device / "device").resolve()
    for parent in (place, *place.parents[:_LEVELS_UP]):
        product = _read(parent / "product")
        if product:
            words = (_read(parent / "manufacturer"), product, _read(parent / "serial"))
            return " ".join(word for word in words if word)
    return "serial port on the board"


def _video_title(device: Path) -> str:
    index = _read(device / "index")
    return f"{_read(device / 'name') or 'unnamed'}{f', node {index}' if index not in ('', '0') else ''}"


def _gpio_labels(folder: Path) -> Iterator[tuple[Path, str]]:
    """Yields (device behind the chip, label and number of lines)."""
    for chip in _entries(folder):
        label, lines = _read(chip / "label"), _read(chip / "ngpio")
        if label:
            yield (chip / "device").resolve(), f"{label}, {lines} lines" if lines else label


def _group(number: int) -> str:
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)


def _names(folder: Path, pattern: re.Pattern[str]) -> list[str]:
    return [entry.name for entry in _entries(folder) if pattern.fullmatch(entry.name)]


def _entries(folder: Path) -> list[Path]:
    """Returns the contents of the folder; nothing where it is absent, or this user may not read it."""
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []


def _read(path: Path) -> str:
    try:
        return printable_bytes(path.read_bytes())
    except OSError:
        return ""


def _link(path: Path) -> str:
    try:
        return str(path.readlink())
    except OSError:
        return ""


def _natural(name: str) -> tuple[str, int]:
    number = re.search(r"\d+$", name)
    return name.rstrip("0123456789"), int(number[0]) if number else 0
