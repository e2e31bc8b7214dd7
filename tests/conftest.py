"""One BLAS thread for each test process and for what it starts: on busy cores more of them only wait for each other.

Hypothesis tries the same examples in every run, as slowly as the machine may be. What was collected is kept from the
garbage collector, which would otherwise walk all of it now and then, 0.3 s in the middle of a test in real time.
"""

import gc
import os
import signal
from collections.abc import Generator

import pytest
from hypothesis import settings

from tests.rules import quick, skips, third

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")
# A container without a locale: programs that the tests start would write ASCII, as they do on such a terminal.
os.environ.setdefault("LANG", "C.UTF-8")
settings.load_profile("ci")


def pytest_configure(config: pytest.Config) -> None:
    """Not by pytest_plugins, which only the topmost conftest may have."""
    config.pluginmanager.register(skips, "tests.rules.skips")
    config.pluginmanager.register(third, "tests.rules.third")
    config.pluginmanager.register(quick, "tests.rules.quick")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call() -> Generator[None]:
    """A command that runs in the test's own process, and takes Ctrl-C for itself, would keep it from the tests after
    it: whether they passed depended on which came before.
    """
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        return (yield)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def pytest_collection_finish() -> None:
    gc.collect()
    gc.freeze()
