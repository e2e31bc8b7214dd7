"""What a user who may not use a file of the service has to do; docs/cart.md says it as well."""

import getpass
import grp
from pathlib import Path

_USUAL = "probewatch"


def join_group(path: Path) -> str:
    """The command that adds this user to the group of the nearest file above that can be looked at."""
    return f"An administrator adds you: sudo usermod -aG {_group(path)} {_user()}; then log in again"


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
