"""Describes what is wrong in a TOML file, one mistake at a time: its line, its key, the value, the bound, and what was
meant.
"""

from collections.abc import Callable, Sequence
from datetime import date
from pathlib import Path
from typing import Any, Self, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from probewatch.appliance.configuration.toml_lines import Place, key_lines, line_of
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.suggestion import did_you_mean, suggested

_IN_ONE_LINE = 8
"""Number of mistakes that a refusal in one line lists; `probewatch check` lists them all."""
_LONGEST_VALUE = 80
"""Number of characters of a wrong value that are quoted: a line of a terminal. More hides the key and the bound beside
it."""
_WORDS = {
    "model_type": "must be a section, written {section}",
    "dict_type": "must be a section, written {section}",
    "tuple_type": "must be a list of sections, each written [{section}]",
    "string_type": "must be text in quotes",
    "path_type": "must be the name of a file in quotes",
    "bool_type": "must be true or false",
}
"""Pydantic's type of error → text, where pydantic's own words are about Python."""
_MOST = 100
"""Number of mistakes that are examined: comparing thousands of keys with the known ones would delay a start by
seconds."""
_TOP = ", it belongs in a section of its own"


class Mistakes(ConfigurationError):  # noqa: N818  as people call them
    """Lists all mistakes of one file. each: (line or None, what is wrong), in the order of the file."""

    def __init__(self, path: Path, each: Sequence[tuple[int | None, str]], remedy: str) -> None:
        self.path, self.each = path, tuple(each)
        super().__init__(self.in_one_line("line {number}", "and {more} more"), str(path), remedy)

    @classmethod
    def found(cls, error: ValidationError, model: type[BaseModel], text: str, path: Path, remedy: str) -> Self:
        """Returns the mistakes that a person made, without their consequences. model: that of the whole file. text: the
        content of the file.
        """
        lines = key_lines(text)
        items = _without_consequences(error.errors(include_url=False)[:_MOST], model)
        each = [(line_of(_place(item), lines), _described(item, model)) for item in items]
        return cls(path, sorted(each, key=lambda one: one[0] or 0), remedy)

    def in_one_line(self, of_line: str, of_rest: str, told: Callable[[str], str] = str) -> str:
        """Returns the first mistakes in one line. of_line, of_rest: templates. told: translates each mistake."""
        first = self.each[:_IN_ONE_LINE]
        listed = [f"{of_line.format(number=line)}: {told(what)}" if line else told(what) for line, what in first]
        left = len(self.each) - len(listed)
        return "; ".join([*listed, of_rest.format(more=left)] if left else listed)

    def rows(self, told: Callable[[str], str] = str) -> list[str]:
        """Returns a line for each mistake, in the form that compilers use. told: translates each mistake."""
        each = ((line, told(what)) for line, what in self.each)
        return [f"{self.path}:{line}: {what}" if line else f"{self.path}: {what}" for line, what in each]


def _without_consequences(items: list[ErrorDetails], model: type[BaseModel]) -> list[ErrorDetails]:
    """Returns the mistakes without those that follow from others: a misspelt or misplaced key is missing where it was
    meant, and a list without its bad entries may be too short.
    """
    unknown = [item["loc"] for item in items if item["type"] == "extra_forbidden"]
    meant = {(*place[:-1], name) for place in unknown for name in _meant(place, model)}
    meant |= {(place[-1],) for place in unknown}
    return [
        item
        for item in items
        if not (item["type"] == "missing" and item["loc"] in meant)
        and not (item["type"] == "too_short" and any(_lies_in(other["loc"], item["loc"]) for other in items))
    ]


def _lies_in(place: Place, around: Place) -> bool:
    return len(place) > len(around) and place[: len(around)] == around


def _place(item: ErrorDetails) -> Place:
    """Returns the place of the key; a mistake across two sections has it in its context alone."""
    place: Place = item.get("ctx", {}).get("place", ())
    return place or item["loc"]


def _described(item: ErrorDetails, model: type[BaseModel]) -> str:
    place, kind, message = item["loc"], item["type"], item["msg"]
    if kind == "missing":
        return f"{_key(place)} is missing"
    if kind == "extra_forbidden":
        return f"{_key(place)} is not known{_advice(place, model)}"
    message, value = message.removeprefix("Value error, "), item["input"]
    if kind == "tuple_type" and not _lists_sections(place, model):
        message = f"must be a list, written [{_toml(value)}, …]"
    elif kind in _WORDS:
        message = _WORDS[kind].format(section=_section(place))
    shown = "" if not place or isinstance(value, dict | list) else f" = {_short(value)}"
    return f"{_key(place)}{shown}: {message[0].lower()}{message[1:]}".removeprefix(": ")


def _short(value: Any) -> str:
    dated = isinstance(value, date)
    shown = value.isoformat() if dated else repr(value).lower() if isinstance(value, bool) else repr(value)
    return shown if len(shown) <= _LONGEST_VALUE else f"{shown[:_LONGEST_VALUE]}…"


def _toml(value: Any) -> str:
    """Returns a value of TOML as it may stand in a list."""
    return f'"{value}"' if isinstance(value, str) else _short(value)


def _section(place: Place) -> str:
    """Returns the section's header as it is written in the file."""
    name = ".".join(part for part in place if isinstance(part, str))
    return f"[[{name}]]" if isinstance(place[-1], int) else f"[{name}]"


def _key(place: Place) -> str:
    """Returns [section] and key as they stand in the file; entries of lists count from 1. Empty for the whole file."""
    if not place:
        return ""
    first, *rest = place
    in_section = any(isinstance(part, str) for part in rest)
    names = [f"entry {part + 1}" if isinstance(part, int) else part for part in rest]
    return " ".join([f"[{first}]" if in_section else f"'{first}'", *names])


def _advice(place: Place, model: type[BaseModel]) -> str:
    if close := _meant(place, model):
        return f". {did_you_mean(close)}"
    if place[-1] in model.model_fields:
        return ", it belongs before the first section" if _model_of(model, str(place[-1])) is None else _TOP
    elsewhere = [name for name in model.model_fields if place[-1] in _known((name,), model)]
    if elsewhere:
        return f", it belongs in [{elsewhere[0]}]"
    return f" (known: {', '.join(_known(place[:-1], model))})"


def _meant(place: Place, model: type[BaseModel]) -> list[str]:
    return suggested(str(place[-1]), _known(place[:-1], model))


def _known(section: Place, model: type[BaseModel]) -> list[str]:
    """Returns the keys of a section; empty for what is not a section."""
    here: type[BaseModel] | None = model
    for part in section:
        if isinstance(part, str) and here is not None:
            here = _model_of(here, part)
    return [] if here is None else [field.alias or name for name, field in here.model_fields.items()]


def _lists_sections(place: Place, model: type[BaseModel]) -> bool:
    """Returns whether the entries of the list in that place are sections."""
    here: type[BaseModel] | None = model
    for part in place:
        if isinstance(part, str):
            here = None if here is None else _model_of(here, part)
    return here is not None


def _model_of(model: type[BaseModel], name: str) -> type[BaseModel] | None:
    kind = model.model_fields[name].annotation if name in model.model_fields else None
    kinds = (one for one in (kind, *get_args(kind)) if isinstance(one, type) and issubclass(one, BaseModel))
    return next(kinds, None)
