"""Finds the line of a TOML text in which each key is. tomllib returns what a file contains, but not where."""

import tomllib
from collections.abc import Iterator
from typing import Any

Place = tuple[str | int, ...]
"""Keys from the root down; entries of an array of tables are counted from 0."""

_LONGEST_STATEMENT = 200
"""Lines of one value. A value is parsed again with each of its lines; longer ones, and all after them, get no line."""

_LEAST_PARSED, _MOST_PARSED = 100_000, 4
"""Characters parsed for one text, as a number and as a multiple of its length, whichever is more. This limits the work
on a hostile text to 0.9 s (measured on 221 kB of long values, 8.8 s without). Fewer would leave long but honest values
without a line.
"""


def key_lines(text: str) -> dict[Place, int]:
    """Returns place → line, from 1, of every section and key of a text that is valid TOML."""
    lines: dict[Place, int] = {}
    tables: dict[Place, int] = {}
    section: Place = ()
    for number, source, statement in _statements(text):
        places = list(_places(statement))
        if source.lstrip().startswith("["):
            section = _entered(places, statement, tables)
            places = [section[:depth] for depth in range(1, len(section) + 1)]
        else:
            places = [section + place for place in places]
        for place in places:
            lines.setdefault(place, number)
    return lines


def line_of(place: Place, lines: dict[Place, int]) -> int | None:
    """Returns the line of the place, or of the nearest section around it that is in the file."""
    return next((lines[place[:depth]] for depth in range(len(place), 0, -1) if place[:depth] in lines), None)


def _statements(text: str) -> Iterator[tuple[int, str, dict[str, Any]]]:
    """Yields (first line, source, parsed value) of each header and each key with its value."""
    begun, source = 0, ""
    left = max(_LEAST_PARSED, _MOST_PARSED * len(text))
    for number, line in enumerate(text.splitlines(keepends=True), 1):
        begun, source = (begun, source + line) if source else (number, line)
        left -= len(source)
        try:
            statement = tomllib.loads(source)
        except ValueError:
            if number - begun >= _LONGEST_STATEMENT or left <= 0:
                return
            continue
        if statement:
            yield begun, source, statement
        source = ""


def _places(values: dict[str, Any] | list[Any], above: Place = ()) -> Iterator[Place]:
    named = enumerate(values) if isinstance(values, list) else values.items()
    for name, value in named:
        yield (*above, name)
        if isinstance(value, dict | list):
            yield from _places(value, (*above, name))


def _entered(places: list[Place], statement: dict[str, Any], tables: dict[Place, int]) -> Place:
    """Returns the place that a header opens. tables: arrays of tables so far, with the number of the latest entry."""
    named = tuple(part for part in max(places, key=len) if isinstance(part, str))
    opened: Any = statement
    for part in named:
        opened = opened[part]
    if isinstance(opened, list):
        tables[named] = tables.get(named, -1) + 1
    place: Place = ()
    for depth, part in enumerate(named, 1):
        place = (*place, part)
        if named[:depth] in tables:
            place = (*place, tables[named[:depth]])
    return place
