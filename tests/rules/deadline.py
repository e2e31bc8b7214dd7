"""No test begins after the time that PROBEWATCH_TESTS_UNTIL names, in seconds since 1970: it is skipped as left out.

A machine that is much slower than others would not finish `.ci/run` at all, and then nothing it found would be told.
"""

import os
import time

import pytest

UNTIL = "PROBEWATCH_TESTS_UNTIL"


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """Before any fixture."""
    if time.time() > float(os.environ.get(UNTIL, "inf")):
        pytest.skip("left out, as this machine is too slow for all tests")
