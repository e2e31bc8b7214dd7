"""Writes how late the tracker is as text, the same in every output."""

from probewatch.tools.german.translation import told

_LATE, _EARLY = "tracker late by {late} ± {sigma} ms", "tracker early by {late} ± {sigma} ms"


def lateness(latency_ms: float, sigma_ms: float, language: str = "en") -> str:
    """Returns the text. latency_ms: positive where the tracker is late."""
    text = _EARLY if round(latency_ms, 1) < 0 else _LATE
    return told(text, language, late=f"{abs(latency_ms):.1f}", sigma=f"{sigma_ms:.1f}")
