"""Suggests which known names a misspelt one may stand for, and words the question, by one rule for keys, options, URLs,
commands, faults and files.
"""

from collections.abc import Iterable
from difflib import get_close_matches

_ALIKE = 0.6
"""Least similarity (difflib's ratio, 0 to 1). Lower suggests names that have nothing to do with what was typed; higher
misses letters exchanged in a short name. Measured on 12 unrelated words against the 30 commands: 17 pairs are alike at
0.5, 3 at 0.6, none at 0.7; but 'ulr' for 'url' and 'hto' for 'hot' have 0.67.
"""

_MOST_BEGUN = 3
"""Names in one question. More cannot be read at a glance; fewer would hide 'relay' from a user who typed 're'. Chosen,
not measured.
"""


def suggested(typed: str, known: Iterable[str]) -> list[str]:
    """Returns the known names that `typed` may stand for: those that it begins, else the most similar one, else the
    longest one that `typed` itself begins with. Case makes no difference. Empty where nothing is close.
    """
    names = list(known)
    by_case = {name.lower(): name for name in reversed(names)}
    lower = typed.lower()
    begun = [name for name in names if lower and name.lower().startswith(lower)]
    if 0 < len(begun) <= _MOST_BEGUN:
        return begun
    if close := get_close_matches(lower, by_case, n=1, cutoff=_ALIKE):
        return [by_case[close[0]]]
    shortened = [name for name in names if name and lower.startswith(name.lower())]
    return [max(shortened, key=len)] if shortened else []


def did_you_mean(meant: Iterable[str]) -> str:
    """Returns the question "Did you mean 'x' or 'y'?"; empty where there is nothing to suggest."""
    names = " or ".join(f"'{name}'" for name in meant)
    return f"Did you mean {names}?" if names else ""
