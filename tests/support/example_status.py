"""The status of a verified cart, of this moment, and of one whose contact is open."""

import time
from typing import Any

MATRIX = [[0.08, 0.0, 0.0, -25.0], [0.0, 0.07, 0.0, -17.0], [0.0, 0.0, 1.0, 3.5], [0.0, 0.0, 0.0, 1.0]]


def example_status(**changes: Any) -> dict[str, Any]:
    """Of a verified cart, with changes."""
    check = {"name": "scale-axial", "fault": "scale", "value": 0.4, "sigma": 0.1, "unit": "%", "limit": 5.0,
             "ratio": 0.08, "verdict": "OK", "shown_age_s": 2.5}  # fmt: skip
    reference = {"number": 3, "origin": "recalibration", "sha256": "ab" * 32, "image_size_px": [640, 480],
                 "image_to_probe": MATRIX, "polarity": [1, 1]}  # fmt: skip
    return {
        "t_ns": time.monotonic_ns(), "state": "monitoring", "text": "Calibration verified", "remedy": "", "fault": None,
        "reason": "Calibration verified", "energised": True, "latched": None, "acknowledged": False, "notices": [],
        "since_s": 4.0, "verification_age_s": 2.5, "simulated": [], "fps": {"video": 30.0, "tracker": 60.0},
        "reference": reference, "checks": [check], "devices": [], "outputs": [
            {"url": "relay:/dev/x", "signal": "contact", "energised": True},
            {"url": "relay:/dev/y", "signal": "red", "energised": False},
        ],
    } | changes  # fmt: skip


OPEN = {"state": "halt", "text": "Do not use the navigation", "reason": "polarity +1 axes", "fault": "polarity",
        "energised": False, "verification_age_s": None}  # fmt: skip
