"""What the drivers say of themselves (drivers/descriptor.py), in words of a terminal."""

import textwrap
from collections.abc import Iterable, Iterator, Sequence

from drivers.descriptor import Driver, Target
from drivers.registry import drivers

_WIDTH = 76
"""Characters of a line of help, with its margin the 78 that click writes at most. More is wrapped twice."""
_URL = 32
"""Characters that URLs take in a list: longer ones push what follows to the right."""


def real_drivers(kind: str = "") -> list[Driver]:
    """Those of devices, no simulation and no recording; of one kind if it is given."""
    return [one for one in drivers().values() if not one.is_simulated and kind in ("", *one.kinds)]


def examples(kind: str) -> str:
    """URLs of that kind, as somebody who configures a cart may write them; of outputs those that can be the contact."""
    fitting = (one for one in real_drivers(kind) if one.contact is None or one.contact.serves_contact)
    return ", ".join(one.examples[kind] for one in fitting)


def any_url() -> str:
    """A URL of each kind of device, and one of a server."""
    firsts = [next(one for one in real_drivers() if one.kinds == (kind,)) for kind in ("tracker", "video", "output")]
    servers = [one for one in real_drivers() if len(one.kinds) > 1]
    return listed([next(iter(one.examples.values())) for one in (*firsts, *servers)])


def listed(words: Sequence[str]) -> str:
    """a, b or c."""
    return " or ".join(part for part in (", ".join(words[:-1]), words[-1]) if part)


def schemes_and_options() -> Iterator[str]:
    """Lines of help: the URL of each driver, what it is for, and the options that it takes."""
    for driver in drivers().values():
        example = next(iter(driver.examples.values()))
        yield f"  {example if driver.required else example.partition('?')[0]:{_URL}}{driver.device}"
        options = " ".join(f"{one.name}={one.values}" for one in driver.options)
        yield from textwrap.wrap(options, _WIDTH, initial_indent=" " * 6, subsequent_indent=" " * 6)


def before_paths(targets: Iterable[Target]) -> Iterator[str]:
    """Lines of help: which schemes go before the path of each kind of connected device."""
    for target in targets:
        found = [one for one in real_drivers() if target in one.targets]
        schemes = [f"{one.scheme}:{''.join(f' with ?{name}= after it' for name in one.required)}" for one in found]
        yield f"  {target.name:<14}{listed(schemes)}"
