"""Makes help texts from the drivers' descriptors (drivers/descriptor.py)."""

import textwrap
from collections.abc import Iterable, Iterator, Sequence

from probewatch.drivers.descriptor import Driver, Target
from probewatch.drivers.registry import drivers

_WIDTH = 76
"""Characters in a line of help: with its margin, the 78 that click writes at most. More would be wrapped twice."""
_URL = 32
"""Width in characters of the URLs in a list: a longer URL pushes the text after it to the right."""


def real_drivers(kind: str = "") -> list[Driver]:
    """Returns the drivers of devices, without simulations and recordings; only those of `kind` where one is given."""
    return [one for one in drivers().values() if not one.is_simulated and kind in ("", *one.kinds)]


def examples(kind: str) -> str:
    """Returns example URLs of that kind for a configuration; for outputs, those that can drive the contact."""
    fitting = (one for one in real_drivers(kind) if one.contact is None or one.contact.serves_contact)
    return ", ".join(one.examples[kind] for one in fitting)


def any_url() -> str:
    """Returns an example URL of each kind of device, and one of a server."""
    firsts = [next(one for one in real_drivers() if one.kinds == (kind,)) for kind in ("tracker", "video", "output")]
    servers = [one for one in real_drivers() if len(one.kinds) > 1]
    return listed([next(iter(one.examples.values())) for one in (*firsts, *servers)])


def listed(words: Sequence[str]) -> str:
    """Returns the items joined as in: a, b or c."""
    return " or ".join(part for part in (", ".join(words[:-1]), words[-1]) if part)


def schemes_and_options() -> Iterator[str]:
    """Yields lines of help: the URL of each driver, its purpose, and its options."""
    for driver in drivers().values():
        example = next(iter(driver.examples.values()))
        yield f"  {example if driver.required else example.partition('?')[0]:{_URL}}{driver.device}"
        options = " ".join(f"{one.name}={one.values}" for one in driver.options)
        yield from textwrap.wrap(options, _WIDTH, initial_indent=" " * 6, subsequent_indent=" " * 6)


def before_paths(targets: Iterable[Target]) -> Iterator[str]:
    """Yields lines of help: the schemes for the path of each kind of connected device."""
    for target in targets:
        found = [one for one in real_drivers() if target in one.targets]
        schemes = [f"{one.scheme}:{''.join(f' with ?{name}= after it' for name in one.required)}" for one in found]
        yield f"  {target.name:<14}{listed(schemes)}"
