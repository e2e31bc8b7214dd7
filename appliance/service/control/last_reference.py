"""Which reference the alarm log remembers."""

from pathlib import Path

from probewatch.appliance.storage.alarm_chain import read_log


def last_reference(folder: Path) -> str | None:
    """The last entry that names one, in words; None where none does, or the log cannot be read."""
    try:
        entries = read_log(folder).entries
    except OSError:
        return None
    for entry in reversed(entries):
        named = entry.data.get("reference")
        if isinstance(named, dict) and named.get("number"):
            return f"reference {named['number']} ({named.get('origin')}, SHA-256 {str(named.get('sha256'))[:12]}…)"
    return None
