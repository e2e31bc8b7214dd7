"""Which faults a simulated device shows now: from its command line, and from a file that may change while it runs.

The control file is a JSON list. An entry is the name of a fault, which is then on as long as it is listed, or
{"fault": NAME, "from_s": a, "to_s": b} in seconds of the world. The file may be absent; it adds to the command line.
"""

import json
from collections.abc import Collection
from pathlib import Path

from drivers.errors import ConfigurationError
from drivers.twins.faults import Episode, Schedule

_LOOK_EVERY_S = 0.05
"""World seconds between two looks at the file. Less asks the file system more often, more shows a fault later."""


class FaultControl:
    """names: faults the device knows. given: from the command line. file: looked at twenty times a second.

    refusal: why the present content of the file is not in force; empty when it is. A refused file changes nothing.
    """

    def __init__(self, names: Collection[str], given: Schedule | None = None, file: Path | None = None) -> None:
        self.refusal = ""
        self._names, self._given, self._file = names, given or Schedule(), file
        self._listed = Schedule()
        self._seen: tuple[int, int, int] | None = None
        self._look_s = -1.0

    def active(self, t_s: float) -> frozenset[str]:
        """Names of the faults that are on at world time t_s."""
        if self._file is not None and not self._look_s <= t_s < self._look_s + _LOOK_EVERY_S:
            self._look_s = t_s
            self._look(self._file)
        return self._given.active(t_s) | self._listed.active(t_s)

    def _look(self, file: Path) -> None:
        try:
            found = file.stat()
            seen = (found.st_mtime_ns, found.st_size, found.st_ino)
            text = file.read_text() if seen != self._seen else ""
        except (OSError, UnicodeDecodeError):
            self._seen, self._listed, self.refusal = None, Schedule(), ""
            return
        if seen == self._seen:
            return
        self._seen = seen
        try:
            self._listed, self.refusal = parse_faults(text, self._names), ""
        except ConfigurationError as error:
            self.refusal = str(error)


def parse_faults(text: str, names: Collection[str]) -> Schedule:
    """The JSON list of a control file. Raises ConfigurationError naming the entry that is wrong."""
    try:
        entries = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(f"not JSON ({error})", "faults", 'Give a list such as ["bump"]') from None
    if not isinstance(entries, list):
        raise ConfigurationError("not a list", "faults", 'Give a list such as ["bump"]')
    bare = [entry for entry in entries if isinstance(entry, str)]
    timed = Schedule.parse(json.dumps([entry for entry in entries if not isinstance(entry, str)]), names)
    return Schedule((*(_listed(name, names) for name in bare), *timed.episodes))


def parse_fault(text: str, names: Collection[str]) -> Episode:
    """`NAME`, `NAME@FROM` or `NAME@FROM..TO` in seconds of the world. Raises ConfigurationError."""
    name, at, times = text.partition("@")
    episode = _listed(name, names)
    if not at:
        return episode
    begin, dots, end = times.partition("..")
    try:
        entry = {"fault": name, "from_s": float(begin)} | ({"to_s": float(end)} if dots else {})
    except ValueError:
        raise ConfigurationError(f"'{times}' is not FROM or FROM..TO in seconds", f"fault {name}", "") from None
    return Schedule.parse(json.dumps([entry]), names).episodes[0]


def _listed(name: str, names: Collection[str]) -> Episode:
    if name not in names:
        raise ConfigurationError(f"'{name}' is not a known fault", "faults", f"Use {', '.join(sorted(names))}")
    return Episode(name, 0.0)
