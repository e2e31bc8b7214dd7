"""Refuses what contradicts another section of the configuration, and says in which line."""

from collections.abc import Callable, Sequence
from os.path import normpath
from typing import NamedTuple

from pydantic_core import PydanticCustomError

from probewatch.appliance.configuration.toml_lines import Place
from probewatch.appliance.limits import Limits, check_name
from probewatch.drivers.descriptor import SERIAL_PORT
from probewatch.drivers.registry import drivers, split_url

_SHARED = frozenset({"relay"})
"""Schemes of which several devices may name one port: the channels of a relay board."""


def refused(what: str, place: Place = ()) -> PydanticCustomError:
    """Returns an error for a validator to raise. place: of the key at fault, where it is not the one validated."""
    return PydanticCustomError("refused", "{what}", {"what": what, "place": place})


class Named(NamedTuple):
    """Names a URL. key: as a person reads it."""

    key: str
    place: Place
    url: str


def named_urls(tracker: str, outputs: Sequence[str]) -> tuple[Named, ...]:
    """Returns the URLs of the devices that may be on serial ports."""
    rows = [Named("[tracker] url", ("tracker", "url"), tracker)]
    rows += [Named(f"[output] entry {at + 1} url", ("output", at, "url"), url) for at, url in enumerate(outputs)]
    return tuple(rows)


def shared_port(named: Sequence[Named], path_of: Callable[[str], str] = normpath) -> tuple[Named, str] | None:
    """Returns the first device whose serial port belongs to another one before it, and what to say of it; None where
    each has its own. path_of: makes equal paths of equal ports.
    """
    known: dict[str, Named] = {}
    for one in named:
        scheme, target, _ = split_url(one.url)
        if SERIAL_PORT not in drivers()[scheme].targets or not target.startswith("/"):
            continue
        other = known.setdefault(path_of(target), one)
        if other is not one and not {scheme, other.url.partition(":")[0]} <= _SHARED:
            what = f"{one.key} = '{one.url}' is on the serial port of {other.key} = '{other.url}'"
            return one, f"{what}. Give each its own port"
    return None


def refuse_shared_port(tracker: str, outputs: Sequence[str]) -> None:
    """Raises PydanticCustomError where two devices name one serial port, by the same path: what another name of a port
    leads to may change with each plug.
    """
    found = shared_port(named_urls(tracker, outputs))
    if found is not None:
        raise refused(found[1], found[0].place)


def refuse_unbounded_ages(limits: Limits, most_s: float) -> None:
    """Raises PydanticCustomError for an age, or a rest, longer than the supervisor grants to any parameter; a default
    gives way.
    """
    required = limits.required_age_s
    stated = {check_name(field) for field in required.model_fields_set}
    ages_s: dict[Place, float | None] = {
        ("limits", "required_age_s", name): age_s for name, age_s in required.ages_s.items() if name in stated
    }
    if "at_rest_s" in limits.model_fields_set:
        ages_s["limits", "at_rest_s"] = limits.at_rest_s
    for place, age_s in ages_s.items():
        if age_s is not None and age_s > most_s:
            key = f"[{'.'.join(map(str, place[:-1]))}] {place[-1]}"
            what = f"{key} = {age_s:g} is longer than [supervisor] max_verification_age_s"
            raise refused(f"{what} = {most_s:g}, which bounds them all. Raise that one, or shorten this", place)


def refuse_by_hand(limits: Limits) -> None:
    """Raises PydanticCustomError for a threshold that is learned alone."""
    if "named_nats" in limits.model_fields_set:
        what = "[limits] named_nats is not set by hand. Learn it, probewatch noise, and name the file in [noise]"
        raise refused(what, ("limits", "named_nats"))
