"""Determines which faults a simulated device shows now: from its command line, and from a file that may change
meanwhile.

The control file is a JSON list. An entry is the name of a fault, which is then on as long as it is listed, or {"fault":
NAME, "from_s": a, "to_s": b} in seconds of the world. The file may be absent or empty; it adds to the command line.
"""

import json
import re
from collections.abc import Collection, Iterator
from pathlib import Path

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.twins.faults import Episode, Schedule, episode_of, refuse_unknown_fault

_LOOK_EVERY_S = 0.05
"""World seconds between two checks of the file. Less asks the file system more often, more shows a fault later."""
_REMEDY = 'Give a list such as ["lose-tracker"]'
_GAP = re.compile(r"[ \t\r\n]*")
"""White space as JSON defines it."""


class FaultControl:
    """Tracks which faults are on, and checks the control file twenty times a second of the world.

    names: faults that the device knows. given: those from the command line. file: the control file. refusal: why the
    present content of the file is not in force; empty when it is. A refused file changes nothing.
    """

    def __init__(self, names: Collection[str], given: Schedule | None = None, file: Path | None = None) -> None:
        self.refusal = ""
        self._names, self._given, self._file = names, given or Schedule(), file
        self._listed = Schedule()
        self._seen: tuple[int, int, int] | None = None
        self._look_s = -1.0
        self._reported = ""

    def new_refusal(self) -> str | None:
        """Returns the refusal once after each change of it; None otherwise."""
        if self.refusal == self._reported:
            return None
        self._reported = self.refusal
        return self.refusal

    def active(self, t_s: float) -> frozenset[str]:
        """Returns the names of the faults that are on at world time t_s."""
        if self._file is not None and not self._look_s <= t_s < self._look_s + _LOOK_EVERY_S:
            self._look_s = t_s
            self._look(self._file)
        return self._given.active(t_s) | self._listed.active(t_s)

    def _look(self, file: Path) -> None:
        try:
            found = file.stat()
            seen = (found.st_mtime_ns, found.st_size, found.st_ino)
            if seen == self._seen:
                return
            self._listed, self.refusal = parse_faults(file.read_text(), self._names, str(file)), ""
            self._seen = seen
        except FileNotFoundError:
            self._seen, self._listed, self.refusal = None, Schedule(), ""
        except ConfigurationError as error:
            self._seen, self.refusal = seen, str(error)
        except (OSError, UnicodeDecodeError) as error:
            why = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
            self._seen, self.refusal = None, f"{file}: cannot be read ({why}). {_REMEDY}"


def parse_faults(text: str, names: Collection[str], where: str = "faults") -> Schedule:
    """Parses the JSON list of a control file. Raises ConfigurationError naming the file, the line and what is wrong
    there.
    """
    try:
        entries = json.loads(text) if text.strip() else []
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(f"not JSON ({error})", where, _REMEDY) from None
    if not isinstance(entries, list):
        raise ConfigurationError("not a list", where, _REMEDY)
    lines = _lines(text)
    return Schedule(tuple(_entry(one, names, f"{where}, line {next(lines)}") for one in entries))


def _lines(text: str) -> Iterator[int]:
    """Yields the line in which each entry of a JSON list begins, counted from 1. text: such a list, whole."""
    decoder, at = json.JSONDecoder(), text.find("[")
    while True:
        gap = _GAP.match(text, at + 1)
        begin = at + 1 if gap is None else gap.end()
        yield text.count("\n", 0, begin) + 1
        _, end = decoder.raw_decode(text, begin)
        at = text.find(",", end)


def _entry(entry: object, names: Collection[str], where: str) -> Episode:
    return _listed(entry, names, where) if isinstance(entry, str) else episode_of(entry, names, where)


def parse_fault(text: str, names: Collection[str]) -> Episode:
    """Parses `NAME`, `NAME@FROM` or `NAME@FROM..TO` in seconds of the world. Raises ConfigurationError."""
    name, at, times = text.partition("@")
    episode = _listed(name, names, "--fault")
    if not at:
        return episode
    begin, dots, end = times.partition("..")
    try:
        entry = {"fault": name, "from_s": float(begin)} | ({"to_s": float(end)} if dots else {})
    except ValueError:
        raise ConfigurationError(f"'{times}' is not FROM or FROM..TO in seconds", f"fault {name}", "") from None
    return Schedule.parse(json.dumps([entry]), names).episodes[0]


def _listed(name: str, names: Collection[str], where: str) -> Episode:
    refuse_unknown_fault(name, names, where)
    return Episode(name, 0.0)
