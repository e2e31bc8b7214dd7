"""Which users may do what, and what one who may not use a file has to do; docs/cart.md says it as well."""

import getpass
import grp
import pwd
from collections.abc import Iterable
from pathlib import Path

_USUAL = "probewatch"


def join_group(path: Path) -> str:
    """The command that adds this user to the group of the nearest file above that can be looked at."""
    return f"An administrator adds you: sudo usermod -aG {_group(path)} {_user()}; then log in again"


def user_ids(names: Iterable[str]) -> frozenset[int]:
    """Of those users that exist; nobody is logged in as one that does not."""
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
