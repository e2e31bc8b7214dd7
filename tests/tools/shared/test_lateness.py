"""A tracker that is early is not told as late by a negative time."""

import pytest

from probewatch.tools.recalibration.terminal import latency_text
from probewatch.tools.shared.lateness import lateness


@pytest.mark.parametrize(
    ("latency_ms", "english", "german"),
    [
        (62.04, "tracker late by 62.0 ± 3.0 ms", "Tracker verspätet um 62.0 ± 3.0 ms"),
        (-62.04, "tracker early by 62.0 ± 3.0 ms", "Tracker verfrüht um 62.0 ± 3.0 ms"),
        (-0.04, "tracker late by 0.0 ± 3.0 ms", "Tracker verspätet um 0.0 ± 3.0 ms"),
    ],
)
def test_the_sign_is_told_as_a_word(latency_ms: float, english: str, german: str) -> None:
    assert lateness(latency_ms, 3.0) == english
    assert lateness(latency_ms, 3.0, "de") == german
    measured = {"seen": 5, "pictures": 9, "latency_ms": latency_ms, "sigma_ms": 3.0, "full": False}
    assert latency_text(measured).endswith(english)
