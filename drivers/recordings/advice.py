"""Adapts how the readers' errors name options, so that they are true in every command that reads recordings and in a
device's URL.
"""

import re

POSES_APART = "replay and latency take poses of another file with --poses"
"""Advice on poses in another file; no other command takes them."""
_OPTION = re.compile(r"--(orientation|poses|probe|reference)(?: ([A-Z]\w*))?")


def in_url(advice: str) -> str:
    """Returns the advice with the options of a `replay:` URL instead of a command's."""
    said = advice.replace(POSES_APART, "name the poses of another file with poses=")
    return _OPTION.sub(lambda option: f"{option[1]}={option[2] or ''}", said)
