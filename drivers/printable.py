"""Makes text from outside fit for a terminal, a log and the status.

A device, a server, a file or a client may send anything: escape sequences that rewrite the screen, controls that
reverse the direction of writing, line breaks that forge a second entry, megabytes of text. str.isprintable recognises
all such characters (Unicode categories Cc, Cf, Cs, Co, Cn, Zl, Zp and every space but the ordinary one).
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any

LONGEST_WORDS = 200
"""Characters of a single text from a device; a line of a terminal shows about a hundred."""

LONGEST_TEXT = 4000
"""Characters of one message or field of a log: room for every violation of a configuration, and for a traceback."""

_UNPRINTABLE = "\N{REPLACEMENT CHARACTER}"
_OWN_SEQUENCE = re.compile(
    r"(\x1b\[[0-9;?]{0,16}[A-Za-z]|\r"
    r"|\x1b\]8;(?:id=[0-9]{1,20};file:///[A-Za-z0-9._~%/-]{0,1000}/gesture-[a-z]{1,20}\.svg|;)\x1b\\)"
)
"""Escape sequences of click and rich that pass: colours, cursor movements, and hyperlinks (OSC 8) to the drawings of
the gesture. Sequences that a terminal answers or that set its title or clipboard, and all other hyperlinks, do not
pass.
"""


def printable(text: str, longest: int = LONGEST_WORDS) -> str:
    """Returns the text as one line of at most `longest` characters, with U+FFFD for each that cannot be printed and an
    ellipsis for what was left out.
    """
    if len(text) <= longest and text.isprintable():
        return str(text)
    shown = _replaced(text[:longest], "")
    return shown if len(text) <= longest else f"{shown[: longest - 1]}…"


def first_few(texts: Sequence[str], most: int) -> str:
    """Returns the first `most` texts with commas between them, and how many more there are."""
    more = [f"{len(texts) - most} more"] if len(texts) > most else []
    return ", ".join([*texts[:most], *more])


def printable_bytes(data: bytes, longest: int = LONGEST_WORDS) -> str:
    """Returns UTF-8 bytes as printable text: up to the first NUL, without blanks around it."""
    return printable(data.split(b"\0")[0].decode(errors="replace").strip(), longest)


def printable_lines(text: str) -> str:
    """Returns the first LONGEST_TEXT characters of a text, made printable; line breaks and tabs pass."""
    return _replaced(text[:LONGEST_TEXT], "\n\t")


def printable_value(value: Any) -> Any:
    """Returns a value that JSON can hold with every text in it, keys included, made printable."""
    if value is None or isinstance(value, int | float):  # most of a status, which is requested many times a second
        return value
    if isinstance(value, str):
        return printable(value, LONGEST_TEXT)
    if isinstance(value, (dict, Mapping)):  # dict first: the check against the abstract class is slow
        return {printable(str(key)): printable_value(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [printable_value(one) for one in value]
    return value


def printable_screen(text: str, colours: bool) -> str:
    """Returns the output of a command, made printable: line breaks and tabs pass; with `colours`, the sequences of
    `_OWN_SEQUENCE` pass too.
    """
    if not colours:
        return _replaced(text, "\n\t")
    parts = _OWN_SEQUENCE.split(text)
    return "".join(part if own % 2 else _replaced(part, "\n\t") for own, part in enumerate(parts))


def _replaced(text: str, allowed: str) -> str:
    if text.isprintable():
        return text
    return "".join(sign if sign.isprintable() or sign in allowed else _UNPRINTABLE for sign in text)
