"""Writes text for every terminal: characters that its encoding lacks are written in ASCII, so that no output ends in a
traceback.
"""

import codecs
import io
import os
import sys
import unicodedata

_ASCII = {
    "°": "deg",
    "±": "+/-",
    "·": "-",
    "×": "x",
    "→": "->",
    "−": "-",
    "–": "-",
    "…": "...",
    "ζ": "zeta",
    "σ": "sigma",
    "λ": "lambda",
    "Λ": "Lambda",
    "µ": "u",
    "≤": "<=",
    "≥": ">=",
    "ä": "ae",
    "ö": "oe",
    "ü": "ue",
    "Ä": "Ae",
    "Ö": "Oe",
    "Ü": "Ue",
    "ß": "ss",
    "✓": "+",
    "✗": "X",
    "━": "=",
    "─": "-",
    "┃": "|",
    "│": "|",
    "▁": "_",
    "▂": ".",
    "▃": ":",
    "▄": "-",
    "▅": "=",
    "▆": "+",
    "▇": "*",
    "█": "#",
}
"""Replacement of each character. Those of tables and bars keep their width."""

_HANDLER = "ascii-words"
_CODEC = "plain-text"
"""Name of the codec for ASCII with that handler. It has a name of its own because click regards any stream called ASCII
as a mistake, and writes UTF-8 to it."""


def speak_plainly() -> None:
    """Makes standard output and error replace characters that the terminal cannot show by ASCII; in the C and POSIX
    locales those are all beyond ASCII, unless PYTHONUTF8 or PYTHONIOENCODING is set.
    """
    codecs.register_error(_HANDLER, _in_ascii)
    codecs.register(lambda name: _codec() if name.replace("_", "-") == _CODEC else None)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            plain = codecs.lookup(stream.encoding).name == "ascii" or _locale_is_plain()
            stream.reconfigure(encoding=_CODEC if plain else None, errors=_HANDLER)


def shown(text: str) -> str:
    """Returns the text as standard output will show it, so that tables are laid out for what is visible."""
    encoding = sys.stdout.encoding or "utf-8"
    try:
        return text.encode(encoding, _HANDLER).decode(encoding)
    except LookupError:
        return text  # speak_plainly was not called: this is a test, or it is used as a library


def _locale_is_plain() -> bool:
    """Returns whether the user's locale is C or POSIX. Python itself overrides that with LC_CTYPE=C.UTF-8 when it
    starts.
    """
    if os.environ.get("PYTHONUTF8") or os.environ.get("PYTHONIOENCODING"):
        return False
    ctype = os.environ.get("LC_CTYPE", "")
    asked = os.environ.get("LC_ALL") or ("" if ctype == "C.UTF-8" else ctype) or os.environ.get("LANG") or "C"
    return asked in ("C", "POSIX")


def _in_ascii(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)
    return "".join(map(_word, error.object[error.start : error.end])), error.end


def _word(sign: str) -> str:
    plain = _ASCII.get(sign) or unicodedata.normalize("NFKD", sign).encode("ascii", "ignore").decode()
    return plain or "?"


def _encode(text: str, _errors: str = "strict") -> tuple[bytes, int]:
    return text.encode("ascii", _HANDLER), len(text)


class _Encoder(codecs.IncrementalEncoder):
    def encode(self, text: str, final: bool = False) -> bytes:
        return _encode(text)[0]


def _codec() -> codecs.CodecInfo:
    return codecs.CodecInfo(
        _encode,
        codecs.lookup("ascii").decode,
        incrementalencoder=_Encoder,
        incrementaldecoder=codecs.getincrementaldecoder("ascii"),
        name=_CODEC,
    )
