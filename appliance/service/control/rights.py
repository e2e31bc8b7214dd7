"""Which users may do what, and what one who may not use a file has to do; docs/security.md says it as well."""

import getpass
import grp
import pwd
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from probewatch.appliance.configuration.config import Config, Control, Feed

_USUAL = "probewatch"
_OF_UNITS = (*Control().viewers, *Feed().viewers)
"""Users of our own units that only look on, as shipped. The recorder's has the group, for the files that it writes."""


@dataclass(frozen=True, slots=True)
class Onlookers:
    """Users, by id, who may read status and feed and request nothing, whatever group they are in.

    of_units: who requests nothing either, also where the configuration names others in their place.
    """

    without_pictures: frozenset[int]
    with_pictures: frozenset[int]
    of_units: frozenset[int]

    @classmethod
    def of(cls, config: Config) -> Self:
        """Who is named in both lists is shown pictures."""
        shown = user_ids(config.feed.viewers)
        return cls(user_ids(config.control.viewers) - shown, shown, user_ids(_OF_UNITS))

    @property
    def all(self) -> frozenset[int]:
        """Who is let in."""
        return self.without_pictures | self.with_pictures

    @property
    def refused(self) -> frozenset[int]:
        """Users whose requests are refused."""
        return self.all | self.of_units


def join_group(path: Path) -> str:
    """The command that adds this user to the group of the nearest file above that can be looked at."""
    return f"An administrator adds you: sudo usermod -aG {_group(path)} {_user()}; then log in again"


def user_ids(names: Iterable[str]) -> frozenset[int]:
    """Ids of those users that exist; no process runs as one that does not."""
    return frozenset(uid for name in names if (uid := _user_id(name)) is not None)


def _user_id(name: str) -> int | None:
    try:
        return pwd.getpwnam(name).pw_uid
    except KeyError:
        return None


def _group(path: Path) -> str:
    for place in (path, *path.parents):
        try:
            name = grp.getgrgid(place.stat().st_gid).gr_name
        except (OSError, KeyError):
            continue
        return _USUAL if name == "root" else name
    return _USUAL


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):
        return "USER"
