"""What every table of translations keeps to."""

import re
from collections.abc import Mapping


def other_fields(table: Mapping[str, str]) -> list[str]:
    """Returns the English texts whose translation has other fields than they."""
    return [english for english, german in table.items() if _fields(english) != _fields(german)]


def _fields(text: str) -> list[str]:
    return sorted(re.findall(r"{\w+}", text))
