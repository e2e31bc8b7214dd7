"""A quick test takes little of the processor, and so does what is set up for it; what needs more is thorough.

PROBEWATCH_MOST_CPU_S, which `make quick` sets, is how many seconds of processor time, that of ended child processes
included: other programs that keep the computer busy change little of it. Only in CI is more a failure: a slow computer
is none.
"""

import os
from collections.abc import Generator

import pytest

MOST = "PROBEWATCH_MOST_CPU_S"


def _used_s() -> float:
    return sum(os.times()[:4])


def _judged(what: str) -> Generator[None, object, object]:
    most_s, began_s = float(os.environ.get(MOST, "inf")), _used_s()
    result = yield
    if os.environ.get("CI") == "true" and (used_s := _used_s() - began_s) > most_s:
        pytest.fail(f"{what} took {used_s:.1f} s of the processor, a quick test {most_s:g} s at most: mark it thorough")
    return result


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup() -> Generator[None, object, object]:
    return (yield from _judged("what is set up for it"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call() -> Generator[None, object, object]:
    return (yield from _judged("it"))
