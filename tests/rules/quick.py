"""A quick test takes little of the processor, and so does what is set up for it; what needs more is thorough.

PROBEWATCH_MOST_CPU_S, which `make quick` sets, is how many seconds of processor time, that of ended child processes
included, on a processor that does the peer below in PEER_S. Where a test took more, the peer runs right after it, and
the limit is longer by as much as the peer took longer: a processor that is slow, or shared with other virtual
machines, fails no test. More is a failure in CI alone.
"""

import os
from collections.abc import Generator

import numpy as np
import pytest

MOST = "PROBEWATCH_MOST_CPU_S"
PEER_S = 0.05
"""What the peer takes of the processor for which the limit was chosen, an idle core of an AMD EPYC at Python 3.11; .09
while others used that machine."""


def _used_s() -> float:
    return sum(os.times()[:4])


def peer_s() -> float:
    """The time that half interpreter, half numpy takes of this processor now."""
    began_s, total = _used_s(), 0
    for number in range(500_000):
        total += number * number
    picture = np.zeros((256, 256))
    for _ in range(30):
        picture = np.fft.irfft2(np.fft.rfft2(picture))
    return _used_s() - began_s


def _judged(what: str) -> Generator[None, object, object]:
    most_s, began_s = float(os.environ.get(MOST, "inf")), _used_s()
    result = yield
    used_s = _used_s() - began_s
    if os.environ.get("CI") == "true" and used_s > most_s and used_s > (here_s := most_s * max(1, peer_s() / PEER_S)):
        most = f"a quick test {here_s:.2g} s at most: mark it thorough"
        pytest.fail(f"{what} took {used_s:.1f} s of the processor, {most}")
    return result


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup() -> Generator[None, object, object]:
    return (yield from _judged("what is set up for it"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call() -> Generator[None, object, object]:
    return (yield from _judged("it"))
