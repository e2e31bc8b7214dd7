"""Finds which reference the alarm log remembers."""

from pathlib import Path

from probewatch.appliance.storage.alarm_chain import read_log


def last_reference(folder: Path) -> str | None:
    """Returns the reference that the log named last, in words; None when it names none or cannot be read."""
    try:
        entries = read_log(folder).entries
    except OSError:
        return None
    for entry in reversed(entries):
        named = entry.data.get("reference")
        if isinstance(named, dict) and named.get("number"):
            return f"reference {named['number']} ({named.get('origin')}, SHA-256 {str(named.get('sha256'))[:12]}…)"
    return None
