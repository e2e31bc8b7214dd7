"""Keeps the records of self-tests: one JSON file each, chained, so that one that was edited shows.

Each carries the SHA-256 of its own content, which includes that of the record before it, as the entries of the alarm
log do (appliance.storage.alarm_chain). It shows accidents and careless edits: whoever may write to the folder and knows
this can make a new chain, and the newest record can be removed unnoticed, as nothing follows it.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from probewatch.appliance.storage.alarm_chain import GENESIS, digest_of
from probewatch.drivers.files.regular_file import read_bounded
from probewatch.drivers.printable import printable

_MOST_BYTES = 1_000_000
"""Bytes of the record of a self-test at most; one has some kB."""


@dataclass(frozen=True)
class Records:
    """Holds the records of a folder. kept: readable ones, oldest first. faults: what is wrong with it, in words."""

    kept: list[dict[str, Any]]
    faults: list[str]


def sealed(record: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Returns the record with its place in the chain of the folder, which need not exist yet."""
    kept = read_self_tests(folder).kept
    followed = {one.get("previous") for one in kept}
    ends = [str(one["digest"]) for one in kept if "digest" in one and one["digest"] not in followed]
    chained = {**record, "previous": ends[-1] if ends else GENESIS}
    return {**chained, "digest": digest_of(chained)}


def read_self_tests(folder: Path) -> Records:
    """Reads everything in the folder; one that is missing counts as empty."""
    kept, faults = [], []
    for file in sorted(folder.glob("*.json")):
        try:
            kept.append((file.name, _parsed(json.loads(read_bounded(file, _MOST_BYTES)))))
        except (OSError, ValueError, KeyError, TypeError, RecursionError, OverflowError):
            faults.append(f"{printable(file.name)} cannot be read")
    kept.sort(key=lambda named: str(named[1]["utc"]))
    faults += _broken(kept)
    return Records([record for _, record in kept], faults)


def _parsed(record: dict[str, Any]) -> dict[str, Any]:
    """Returns the record in the form that is kept. Raises what `read_self_tests` takes for a record that cannot be
    read: any member of the group may have put it there.
    """
    datetime.fromisoformat(str(record["utc"])).astimezone(UTC)
    items = [dict(item) for item in record["items"]]
    for item in items:
        float(item.get("figure") or 0.0)
    if not all(isinstance(record.get(name, ""), str) for name in ("digest", "previous")):
        raise TypeError("a digest is text")
    return {**record, "items": items}


def _broken(kept: list[tuple[str, dict[str, Any]]]) -> Iterator[str]:
    """Yields where the chain is broken, by the links and not by the times: the clock may have been set. Of records
    without a digest, as an earlier version kept them, nothing shows whether they were changed.
    """
    digests = {record.get("digest") for _, record in kept} | {GENESIS}
    chained = False
    for file, record in kept:
        name = printable(file)
        if "digest" not in record:
            if chained:
                yield f"{name} has no digest, though one before it has: it was put in or changed"
            continue
        chained = True
        if digest_of({key: value for key, value in record.items() if key != "digest"}) != record["digest"]:
            yield f"{name} was changed after it was kept"
        elif record.get("previous") not in digests:
            yield f"{name} follows a record that is missing or was changed"
