"""A client's request, one line of JSON, to its fields; control socket and feed read the same way."""

import json
from collections.abc import Iterable
from typing import Any

from drivers.printable import printable


def request_fields(line: bytes, version: int) -> dict[str, Any]:
    """The fields of {"v": version, …}. Raises ValueError, in words for the client."""
    try:
        fields = json.loads(line, object_pairs_hook=_once, parse_constant=_no_number)
    except (RecursionError, UnicodeDecodeError, json.JSONDecodeError):
        raise ValueError("the line is not JSON") from None
    if not isinstance(fields, dict) or "v" not in fields:
        raise ValueError(f"a request is a JSON object with v = {version}")
    said = fields["v"]
    if isinstance(said, bool) or said != version:
        raise ValueError(f"version {version} is spoken here, and the request says v = {printable(repr(said))[:40]}")
    return fields


def _once(pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """A field that comes twice means something else to every reader."""
    fields: dict[str, Any] = {}
    for key, value in pairs:
        if key in fields:
            raise ValueError(f"the field '{printable(key)[:40]}' is given twice")
        fields[key] = value
    return fields


def _no_number(name: str) -> float:
    raise ValueError(f"the line is not JSON: it has no {name}")
