"""Determines which users may do what, and tells a user who may not use a file what to do; see docs/security.md."""

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
"""Users of our own units that only view, as shipped. The recorder's has the group, for the files that it writes."""


@dataclass(frozen=True, slots=True)
class Onlookers:
    """Holds the users, by id, who may read status and feed but send no other request, whatever group they are in.

    of_units: users who may send no other request either, even where the configuration names others in their place.
    """

    without_pictures: frozenset[int]
    with_pictures: frozenset[int]
    of_units: frozenset[int]

    @classmethod
    def of(cls, config: Config) -> Self:
        """Returns the viewers that the configuration names. A user who is in both lists is shown pictures."""
        shown = user_ids(config.feed.viewers)
        return cls(user_ids(config.control.viewers) - shown, shown, user_ids(_OF_UNITS))

    @property
    def all(self) -> frozenset[int]:
        """Returns the users who may connect."""
        return self.without_pictures | self.with_pictures

    @property
    def refused(self) -> frozenset[int]:
        """Returns the users whose requests are refused."""
        return self.all | self.of_units


def join_group(path: Path) -> str:
    """Returns the command that adds this user to the group of `path`, or of the nearest folder that can be examined."""
    return f"An administrator adds you: sudo usermod -aG {_group(path)} {_user()}; then log in again"


def user_ids(names: Iterable[str]) -> frozenset[int]:
    """Returns the ids of those users that exist; no process runs as one that does not."""
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
