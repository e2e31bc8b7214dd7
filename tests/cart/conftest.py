"""The machines as fixtures; each names what the host lacks when its tests are skipped."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.cart.container import Container
from tests.cart.guest import Guest
from tests.cart.image import Image, build
from tests.cart.requirements import CONTAINER, GUEST, IMAGE, missing

BUILD_S: list[float] = []
"""Seconds that building the image took, once there is one."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.parent == Path(__file__).parent:
            item.add_marker(pytest.mark.cart)


def _require(programs: tuple[str, ...]) -> None:
    if why := missing(programs):
        pytest.skip(why)


@pytest.fixture(scope="session")
def image() -> Image:
    """Built anew where its sources have changed: minutes, else a second."""
    _require(IMAGE)
    began_s = time.monotonic()
    found = build()
    BUILD_S.append(time.monotonic() - began_s)
    return found


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """What the machine's image took is told apart from what the tests took."""
    for seconds in BUILD_S:
        terminalreporter.write_line(f"cart image: {seconds:.0f} s of the time below")


@pytest.fixture
def container(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Container]:
    """A machine as delivered, booted under systemd-nspawn."""
    _require(CONTAINER)
    with Container(request.getfixturevalue("image"), tmp_path) as machine:
        yield machine


@pytest.fixture
def guest(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Guest]:
    """A machine as delivered under QEMU, switched off."""
    _require(GUEST)
    with Guest(request.getfixturevalue("image"), tmp_path) as machine:
        yield machine
