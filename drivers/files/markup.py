"""Parses TOML and XML from files that anyone may have written: what would take memory or time out of proportion is
refused before it is built.
"""

import re
import tomllib
import xml.etree.ElementTree as ET
from typing import Any

from probewatch.drivers.printable import printable

_MOST_PARTS = 8
"""Parts of a dotted key. tomllib keeps every prefix of a key, so 8000 parts, which are 16 kB, took 300 MB."""

_MOST_NESTED = 16
"""Depth of nested brackets; a matrix of a calibration needs two."""

_MOST_BITS = 63
"""Bits of a whole number, as TOML has them. A longer one in hexadecimal cannot even be quoted in the refusal of a
value, as Python prints 4300 digits at most: the service ended because of that.
"""

_STRING = (
    r'"""(?:\\.|[^\\])*?"{3,5}',
    r"'''.*?'{3,5}",
    r'"(?:\\.|[^"\\\n])*"',
    r"'[^'\n]*'",
)
_TWICE = re.compile(r"Cannot overwrite a value \(at line ([0-9]+), column [0-9]+\)")
_STRING_OR_COMMENT = re.compile("|".join((*_STRING, r"#[^\n]*")), re.DOTALL)
_LONG_KEY = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{_MOST_PARTS}}}")
_ENCODING = re.compile(rb"\xff\xfe|\xfe\xff|\s*<\?xml[^>]{0,200}encoding")
"""Matches the start of a document that states its encoding; any other document is UTF-8 by the rules of XML."""
_BRACKET = re.compile(r"[\[\]{}]")

_MOST_ELEMENTS, _DEEPEST_ELEMENT = 10_000, 32
"""Elements, and their depth. A device set of PLUS has 60 or so, five deep; 10,000 elements take a few MB."""


SAVE_AS_UTF_8 = "Save it as UTF-8"
"""Remedy for a file that is not UTF-8."""


class NotUtf8Error(ValueError):
    """Reports bytes that are no UTF-8 text, and where they are, in words for a person."""


def text_of(data: bytes) -> str:
    """Decodes UTF-8 and drops the byte order mark that Windows editors write. Raises NotUtf8Error."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in data[:2]:
        raise NotUtf8Error("is UTF-16 text, not UTF-8")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise NotUtf8Error(f"is not UTF-8 text: line {line} has the byte 0x{data[error.start]:02x}") from None


def number_of(text: str) -> float:
    """Returns the number that a text holds. Raises ValueError, also for what only Python takes for one: digits of other
    scripts, and underscores between digits, as of two numbers between which the blank was lost.
    """
    if not text.isascii() or "_" in text:
        raise ValueError("not a number as others write it")
    return float(text)


def numbers_of(text: str) -> list[float]:
    """Returns the numbers that a text holds, separated by blanks. Raises ValueError as `number_of` does."""
    return [number_of(word) for word in text.split()]


def toml_of(data: bytes, most_bytes: int) -> dict[str, Any]:
    """Returns the table of a TOML file. Raises ValueError: NotUtf8Error, or for a file that is no TOML, or is larger,
    deeper or with longer numbers than a configuration ever is.
    """
    if len(data) > most_bytes:
        raise ValueError(f"too large (over {most_bytes // 1000} kB)")
    text = text_of(data)
    _check_nesting(_STRING_OR_COMMENT.sub(lambda found: "" if found[0].startswith("#") else "_", text))
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(_with_key(str(error), text)) from None
    _check_numbers(table)
    return table


def _with_key(message: str, text: str) -> str:
    """Returns tomllib's message; of a key that is there twice, which tomllib does not name, one that names it."""
    found = _TWICE.fullmatch(message)
    if found is None:
        return message
    key = text.splitlines()[int(found[1]) - 1].partition("=")[0].strip()
    return f"the key {printable(key)} is there twice (at line {found[1]})"


def xml_of(data: bytes) -> ET.Element:
    """Returns the root of an XML document.

    Raises ValueError: NotUtf8Error where it names no other encoding, or for a document that is not well-formed, has
    more or deeper elements than a device set has, or has a document type. The parser reports a document type, so it is
    found in any encoding; with it all entities are refused.
    """
    if not _ENCODING.match(data) and b"\0" not in data[:2]:  # the parser recognises UTF-16 by its zeros
        text_of(data)
    parser = ET.XMLParser(target=_Builder())
    try:
        parser.feed(data)
        root = parser.close()
    except (ET.ParseError, LookupError) as error:
        raise ValueError(f"not well-formed ({error})") from None
    assert isinstance(root, ET.Element)
    return root


def _check_nesting(text: str) -> None:
    """Raises ValueError for tables that are nested too deep. text: without strings and comments, in which dots and
    brackets mean nothing.
    """
    if _LONG_KEY.search(text):
        raise ValueError(f"a key of more than {_MOST_PARTS} parts")
    depth = 0
    for bracket in _BRACKET.findall(text):
        depth = depth + 1 if bracket in "[{" else max(depth - 1, 0)
        if depth > _MOST_NESTED:
            raise ValueError(f"more than {_MOST_NESTED} brackets in each other")


def _check_numbers(value: object) -> None:
    """Raises ValueError for a whole number that is too long. value: that of a table that is not nested deeper than
    `_check_nesting` allows.
    """
    if isinstance(value, int) and value.bit_length() > _MOST_BITS:
        raise ValueError(f"a whole number of more than {_MOST_BITS} bits")
    if isinstance(value, dict | list):
        for one in value.values() if isinstance(value, dict) else value:
            _check_numbers(one)


class _Builder(ET.TreeBuilder):
    def __init__(self) -> None:
        super().__init__()
        self._elements = self._depth = 0

    def start(self, tag: str, attrs: dict[str, str], /) -> ET.Element:
        self._elements += 1
        self._depth += 1
        if self._elements > _MOST_ELEMENTS:
            raise ValueError(f"more than {_MOST_ELEMENTS} elements")
        if self._depth > _DEEPEST_ELEMENT:
            raise ValueError(f"more than {_DEEPEST_ELEMENT} elements in each other")
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ET.Element:
        self._depth -= 1
        return super().end(tag)

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        """Raises ValueError. The parser calls it before it reads what a document type declares."""
        raise ValueError("it has a DOCTYPE, which PLUS never writes")
