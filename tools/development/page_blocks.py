"""Generates blocks of a page, each between two marks: <!-- KIND: NAME --> and <!-- /KIND -->."""

import re
from collections.abc import Callable


class PageBlocks:
    """Represents the blocks of one kind. make: the text of a block by its name, with a line break at the end; raises
    KeyError for a name that has none.
    """

    def __init__(self, kind: str, make: Callable[[str], str]) -> None:
        self._make = make
        marks = rf"(?P<begin><!-- {kind}: (?P<name>[a-z0-9+ ]+) -->\n).*?(?P<end><!-- /{kind} -->)"
        self._pattern = re.compile(marks, re.S)

    def page(self, text: str) -> str:
        """Returns the page with each of its blocks generated anew. Raises KeyError as `make` does."""
        return self._pattern.sub(lambda found: f"{found['begin']}{self._make(found['name'])}{found['end']}", text)

    def names(self, text: str) -> list[str]:
        """Returns the names of the blocks of a page."""
        return [found["name"] for found in self._pattern.finditer(text)]
