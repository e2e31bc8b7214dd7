"""One BLAS thread for each test process and for what it starts: on busy cores more of them only wait for each other.

Hypothesis tries the same examples in every run, as slowly as the machine may be.
"""

import os

import pytest
from hypothesis import settings

from tests import skips

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")
settings.load_profile("ci")

LIVE = (
    "test_failures",
    "test_alarm_path",
    "test_daemon",
    "test_demo",
    "test_evidence_age_live",
    "test_exhaustion",
    "test_ndi_faults",
    "test_network_video",
    "test_overloaded_cart",
    "test_public_clients",
    "test_recalibrate",
    "test_simulate_cart",
    "test_source_contract",
    "test_tracker_alarm",
    "test_tracker_loss",
)
"""Rooms whose tests run whole carts and devices in real time: `make live`."""


def pytest_configure(config: pytest.Config) -> None:
    """Not by pytest_plugins, which only the topmost conftest may have."""
    config.pluginmanager.register(skips, "tests.skips")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what needs minutes of real time, so that the quick suite can leave it out."""
    for item in items:
        if item.path.stem in LIVE:
            item.add_marker(pytest.mark.live)
