"""Edits a configuration key by key and keeps every other line and comment."""

import json
import re
import tomllib
from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

from probewatch.appliance.configuration.toml_lines import Place, key_lines
from probewatch.drivers.errors import ConfigurationError

Value = str | bool | None
Answers = Mapping[Place, Value]
"""Maps the place of a key to its new value; None leaves the key out. An index beyond the last entry of an array adds a
new entry."""

_TEMPLATE = Path(__file__).with_name("probewatch.toml")
"""In the source tree this is a link to config/probewatch.toml; an installed package has its content."""
_HEADER = re.compile(r"\s*\[")


def template() -> str:
    """Returns the commented configuration that the package ships."""
    return changed(_TEMPLATE.read_text(encoding="utf-8"), {("configured",): False}, _TEMPLATE)


def changed(text: str, answers: Answers, file: Path) -> str:
    """Returns the text with these answers. Raises ConfigurationError where the result would not state them, as where
    the old value spans several lines; `file` is named in that error.
    """
    lines = text.splitlines()
    for place, value in answers.items():
        _change(lines, place, value)
    new = "\n".join(lines) + "\n"
    try:
        said = tomllib.loads(new)
    except ValueError:
        said = None
    if said is None or _filled(said) != _filled(_expected(text, answers)):
        what = "has a layout that cannot be edited line by line"
        raise ConfigurationError(what, str(file), "Start over with --fresh, or change it in an editor")
    return new


def _expected(text: str, answers: Answers) -> dict[str, Any]:
    said = deepcopy(tomllib.loads(text))
    for place, value in answers.items():
        _put(said, place, value)
    return said


def _filled(table: dict[str, Any]) -> dict[str, Any]:
    """Returns the table without the empty tables in it."""
    below = {name: _filled(value) if isinstance(value, dict) else value for name, value in table.items()}
    return {name: value for name, value in below.items() if value != {}}


def _put(within: Any, place: Place, value: Value) -> None:
    name, *rest = place
    if isinstance(within, list) and isinstance(name, int) and name == len(within):
        within.append({})
    if rest:
        if isinstance(within, dict):
            within.setdefault(name, [] if isinstance(rest[0], int) else {})
        below = within[name]
        _put(below, tuple(rest), value)
    elif value is None:
        within.pop(name, None)
    else:
        within[name] = value


def _change(lines: list[str], place: Place, value: Value) -> None:
    known = key_lines("\n".join(lines))
    section, name = place[:-1], str(place[-1])
    if place in known:
        number = known[place] - 1
        lines[number] = f"# {lines[number]}" if value is None else _replaced(lines[number], value)
    elif value is not None:
        _add(lines, section, name, value, known)


def _add(lines: list[str], section: Place, name: str, value: str | bool, known: Mapping[Place, int]) -> None:
    """Adds the key at its commented line, or else as the first of its section."""
    if section and section not in known:
        _open_section(lines, section, known)
        known = key_lines("\n".join(lines))
    first = known.get(section) if section else 0
    if first is None:  # the text around the header hides it, so `changed` refuses the text as a whole
        return
    end = _next_header(lines, first)
    shown = re.compile(rf"#\s*{re.escape(name)}\s*=")
    for number in range(first, end):
        if shown.match(lines[number]):
            lines[number] = _replaced(re.sub(r"^#\s*", "", lines[number]), value)
            return
    lines.insert(first, f"{name} = {_toml(value)}")


def _open_section(lines: list[str], section: Place, known: Mapping[Place, int]) -> None:
    """Adds the section's header: an array after its last entry, a table at the end."""
    *names, last = section
    if isinstance(last, int):
        before = known.get((*names, last - 1))
        end = len(lines) if before is None else _behind(lines, before)
        header = f"[[{'.'.join(map(str, names))}]]"
    else:
        end, header = len(lines), f"[{'.'.join(map(str, section))}]"
    lines[end:end] = ["", header]


def _next_header(lines: list[str], first: int) -> int:
    """Returns the number of the line that opens the next section, counted from 0."""
    return next((number for number in range(first, len(lines)) if _HEADER.match(lines[number])), len(lines))


def _behind(lines: list[str], first: int) -> int:
    """Returns the number of the line after the section, before comments and blank lines that introduce the next one."""
    header = end = _next_header(lines, first)
    while end > first and lines[end - 1].startswith("#"):
        end -= 1
    blank = end
    while end > first and not lines[end - 1].strip():
        end -= 1
    return end if end < blank else header


def _replaced(line: str, value: str | bool) -> str:
    """Returns the line with that value; the comment after it stays in its column, or as near as possible."""
    key, _, rest = line.partition("=")
    told = f"{key.rstrip()} = {_toml(value)}"
    for found in re.finditer("#", rest):
        if _is_value(rest[: found.start()]):
            column = len(key) + 1 + found.start()
            return f"{told:<{max(column, len(told) + 2)}}{rest[found.start() :]}"
    return told


def _is_value(text: str) -> bool:
    try:
        tomllib.loads(f"x = {text}")
    except ValueError:
        return False
    return True


def _toml(value: str | bool) -> str:
    """Writes strings as JSON does, with the same escapes."""
    return json.dumps(value, ensure_ascii=False)
