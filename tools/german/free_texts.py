"""Defines a table of texts whose fields stand for anything, such as names that people and devices give."""

import re
from collections.abc import Mapping
from functools import cached_property

_TEXTS, _NAMES = ("said", "then"), {"meant", "list"}
"""Fields that stand for a text of the table, and for names."""


class FreeTexts:
    """Represents a table of one language, from the English text or its template. A field stands for any text; `said`
    and `then` for another text of the table, `meant` and `list` for names with "or" between the last two. words: the
    translations of fields that are one of them. shapes: regular expressions of fields that stand for less than any
    text.
    """

    def __init__(
        self, table: Mapping[str, str], words: Mapping[str, str], shapes: Mapping[str, str] | None = None
    ) -> None:
        self._table, self._words, self._shapes = table, words, shapes or {}

    def told(self, text: str, language: str) -> str:
        """Returns the text in the language; the whole in English where the table does not have the whole of it."""
        said = None if language == "en" else self.translated(text)
        return text if said is None else said

    @cached_property
    def _patterns(self) -> list[tuple[re.Pattern[str], str]]:
        """Compiles the patterns when the first text is looked for: a cart whose language is English needs none."""
        return [
            (re.compile(re.sub(r"\\{(\w+)\\}", self._field, re.escape(english))), german)
            for english, german in self._table.items()
            if "{" in english
        ]

    def _field(self, found: re.Match[str]) -> str:
        return f"(?P<{found[1]}>{self._shapes.get(found[1], '.+?')})"

    def translated(self, text: str) -> str | None:
        """Returns the text in the language; None where the table does not have the whole of it."""
        if text in self._table:
            return self._table[text]
        for pattern, german in self._patterns:
            found = pattern.fullmatch(text)
            fields = None if found is None else self._told(found.groupdict())
            if fields is not None:
                return german.format(**fields)
        return None

    def _told(self, fields: Mapping[str, str]) -> dict[str, str] | None:
        """Returns the fields in the language; None where one has to be a text of the table and is not."""
        said = {
            name: self.translated(text) if name in _TEXTS else self._word(name, text) for name, text in fields.items()
        }
        known = {name: text for name, text in said.items() if text is not None}
        for name in _NAMES & known.keys():
            known[name] = known[name].replace(" or ", " oder ")
        return known if len(known) == len(fields) else None

    def _word(self, name: str, text: str) -> str:
        """Returns a word of this program in the language; what a person has typed in a list of names stays."""
        return text if name == "names" else self._words.get(text, text)
