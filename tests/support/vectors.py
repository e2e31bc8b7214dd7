"""Bytes of the trackers' protocols and what they mean, checked by others than this project: tests/data/README.md."""

import json
from pathlib import Path
from typing import Any

import pytest

_FILE = Path(__file__).parents[1] / "data" / "protocol-vectors.json"


def vectors(*kinds: str) -> list[Any]:
    """The vectors of these kinds as parameters of a test, at least one."""
    every = json.loads(_FILE.read_text())["vectors"]
    found = [pytest.param(vector, id=vector["name"]) for vector in every if vector["kind"] in kinds]
    assert found, f"{_FILE.name} has no vector of {' or '.join(kinds)}"
    return found
