"""Parses a client's request, one line of JSON, into its fields, for the control socket and the feed."""

import json
from collections.abc import Iterable
from itertools import islice
from typing import Any

from probewatch.drivers.printable import printable

_LONGEST_NAME, _MOST_NAMES = 40, 8
"""Characters of a field's name in a reply, and names in it: a client with more sends arbitrary text. Not measured."""


def request_fields(line: bytes, version: int) -> dict[str, Any]:
    """Returns the fields of {"v": version, …}. Raises ValueError with a message for the client."""
    try:
        fields = json.loads(line, object_pairs_hook=_once, parse_constant=_no_number)
    except (RecursionError, UnicodeDecodeError, json.JSONDecodeError):
        raise ValueError("the line is not JSON") from None
    if not isinstance(fields, dict) or "v" not in fields:
        raise ValueError(f"a request is a JSON object with v = {version}")
    said = fields["v"]
    if isinstance(said, bool) or said != version:
        raise ValueError(
            f"version {version} is spoken here, and the request says v = {printable(repr(said))[:_LONGEST_NAME]}"
        )
    return fields


def unknown_fields(fields: Iterable[str], known: Iterable[str]) -> tuple[str, ...]:
    """Returns the names of a request's fields that have no meaning, for the reply; `v` and `do` always have one.

    Fields may be added within a version, so a newer client still gets its reply, and a misspelt field is reported to
    the client.
    """
    unknown = (printable(name)[:_LONGEST_NAME] for name in fields if name not in {"v", "do", *known})
    return tuple(islice(unknown, _MOST_NAMES))


def _once(pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Returns the fields. Raises ValueError for one that is given twice, because readers interpret it differently."""
    fields: dict[str, Any] = {}
    for key, value in pairs:
        if key in fields:
            raise ValueError(f"the field '{printable(key)[:_LONGEST_NAME]}' is given twice")
        fields[key] = value
    return fields


def _no_number(name: str) -> float:
    raise ValueError(f"the line is not JSON: it has no {name}")
