"""The machines as fixtures; each names what the host lacks when its tests are skipped."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.cart.container import Container
from tests.cart.guest import Guest
from tests.cart.image import Image, build
from tests.cart.requirements import CONTAINER, GUEST, missing


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
    return build()


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
