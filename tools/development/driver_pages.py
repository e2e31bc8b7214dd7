"""Generates what is made of the drivers' descriptors: the tables of docs/trackers.md, docs/devices.md and
docs/connect.md, each between two marks, and the unit's DeviceAllow, a drop-in of systemd.

`python -m probewatch.tools.development.manual` writes them.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

from probewatch.drivers.descriptor import Driver, Option
from probewatch.drivers.registry import drivers
from probewatch.tools.development.markdown import table
from probewatch.tools.development.page_blocks import PageBlocks

_ROOT = Path(__file__).parents[2]
PAGES = tuple(_ROOT / "docs" / name for name in ("trackers.md", "devices.md", "connect.md"))
DROP_IN = _ROOT / "systemd" / "probewatch.service.d" / "10-devices.conf"


def _made(name: str) -> str:
    what, _, scheme = name.partition(" ")
    lines = _TABLES[name]() if name in _TABLES else {"options": _options}[what](drivers()[scheme])
    return "\n".join(lines)


def _of(kind: str) -> Iterator[tuple[str, Driver]]:
    """Yields (URL, driver) in the order of the registry."""
    return ((driver.examples[kind], driver) for driver in drivers().values() if kind in driver.kinds)


def _trackers() -> list[str]:
    rows = [(f"`{url}`", driver.device, f"{driver.line}{_see(driver)}") for url, driver in _of("tracker")]
    return table(("URL", "device", "line"), rows)


def _video() -> list[str]:
    rows = [
        (f"`{url}`", driver.device, _see(driver).removeprefix("; ") or _inline(driver)) for url, driver in _of("video")
    ]
    return table(("URL", "for", "options"), rows)


def _outputs() -> list[str]:
    head = ("URL", "options", "read back", "when the process dies", "when the cart hangs")
    rows = [
        (f"`{url}`", _inline(driver), driver.contact.read_back, driver.contact.process_dies, driver.contact.cart_hangs)
        for url, driver in _of("output")
        if driver.contact is not None
    ]
    return table(head, rows)


_TABLES: dict[str, Callable[[], list[str]]] = {"trackers": _trackers, "video": _video, "outputs": _outputs}


def _see(driver: Driver) -> str:
    return f"; see [{driver.page}]({driver.page})" if driver.page else ""


def _cell(text: str) -> str:
    """Returns code for a cell of a table, where a bar would end it."""
    return f"`{text}`".replace("|", "\\|")


def _inline(driver: Driver) -> str:
    return " ".join(_cell(f"{option.name}={option.values}") for option in driver.options) or "none"


def _options(driver: Driver) -> list[str]:
    rows = [(_cell(one.name), _values(one), _default(one), one.help) for one in driver.options]
    return table(("option", "values", "default", "meaning"), rows)


def _default(option: Option) -> str:
    if option.required:
        return "must be given"
    return _cell(option.default) if option.default in option.words else option.default


def _values(option: Option) -> str:
    if option.bounds is not None:
        low, high = option.bounds
        return f"{low:g} … {high:g} {option.unit}".strip()
    return ", ".join(map(_cell, option.words or option.form.split("|")))


def drop_in() -> str:
    """Returns the drop-in with the classes of device nodes that the unit must permit, in the order of the drivers."""
    targets = dict.fromkeys(target for driver in drivers().values() for target in driver.targets)
    allowed = dict.fromkeys(name for target in targets for name in target.allow)
    lines = (f"DeviceAllow={name} rw" for name in allowed)
    return "\n".join(("# Written by `make docs` from what the drivers say of themselves.", "[Service]", *lines, ""))


BLOCKS = PageBlocks("drivers", _made)


def written() -> dict[Path, str]:
    """Returns path and content of every file that is generated, in part or whole."""
    return {**{file: BLOCKS.page(file.read_text(encoding="utf-8")) for file in PAGES}, DROP_IN: drop_in()}
