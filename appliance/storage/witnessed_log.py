"""Checks the alarm log against the references that were in force: each must be named by an entry.

The chain and its memory are stored side by side, so a hand that deletes both, or restores an older copy of both, leaves
nothing that contradicts itself, and what was latched is forgotten. The store of references is written by another
thread, into another folder, and is a witness to what the log must contain. Where both are gone, or no reference came
into force since the copy, nothing is detected (docs/known-anomalies.md).
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from probewatch.appliance.storage.alarm_chain import Damage, Entry, Event, Reading, read_log
from probewatch.appliance.storage.reference_store import FOLDER, HISTORY, read_history
from probewatch.appliance.storage.reference_store import Entry as Stored
from probewatch.appliance.types import Fault
from probewatch.drivers.errors import ConfigurationError

REPORTS_FAULTS = (Fault.LOG_DAMAGED,)

Named = tuple[int, str]
"""Number and SHA-256 of a reference."""


def read_witnessed_log(folder: Path) -> Reading:
    """Reads and verifies everything in the folder, including the references. The store is read first: what it holds has
    been logged by then. A store that cannot be read is ignored here; the service does not start on it. Raises OSError.
    """
    try:
        history = read_history(folder)
    except ConfigurationError:
        history = None
    reading = read_log(folder)
    stored = () if history is None else history.entries
    missing = _missing(reading.entries, stored)
    if missing is None:
        return reading
    what = f"reference {missing} was in force, but no entry of the log names it: entries are missing"
    found = Damage(Fault.LOG_DAMAGED, f"{FOLDER}/{HISTORY}", what)
    return replace(reading, damages=(*reading.damages, found))


def named_reference(entry: Entry) -> Named | None:
    """Returns the reference that the entry brings into force; None for other entries."""
    said = entry.data.get("reference") if entry.event in (Event.STARTED, Event.REFERENCE) else None
    if not isinstance(said, dict) or not isinstance(said.get("sha256"), str) or not isinstance(said.get("number"), int):
        return None
    return said["number"], said["sha256"]


def _missing(entries: Sequence[Entry], stored: Sequence[Stored]) -> int | None:
    """Returns the number of the last reference that an entry should name and none does; None where all are named.

    Only the present chain counts: what was missing before it began was reported then. It need not name references from
    before the first one it names, because its oldest entries may have been removed. The last reference may reach the
    disk before its entry, so a power cut explains that it is missing; until motion has verified it no contact closes on
    it.
    """
    chain = _present_chain(entries)
    named = {one for entry in chain if (one := named_reference(entry)) is not None}
    known = [one.number for one in stored if (one.number, one.sha256) in named]
    if not known and chain and not _is_of_new_log(chain):
        return None
    first = min(known, default=1)
    last = stored[-1].number if stored and stored[-1].verified_utc is None else None
    missing = [
        one.number
        for one in stored
        if one.number >= first and one.number != last and (one.number, one.sha256) not in named
    ]
    return missing[-1] if missing else None


def _present_chain(entries: Sequence[Entry]) -> Sequence[Entry]:
    begins = [place for place, entry in enumerate(entries) if entry.event == Event.CHAIN_BEGUN]
    return entries[begins[-1] :] if begins else entries


def _is_of_new_log(chain: Sequence[Entry]) -> bool:
    """Returns whether the chain begins with the first start of a cart, by a version that names references. A log that
    was removed from under a running service begins with the events of that time.
    """
    begun = chain[0]
    is_first = begun.event == Event.CHAIN_BEGUN and begun.number == 1 and not begun.data.get("found")
    return is_first and len(chain) > 1 and chain[1].event == Event.STARTED and "reference" in chain[1].data
