"""The machines as fixtures; each names what the host lacks when its tests are skipped."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.cart.container import Container, refused
from tests.cart.guest import Guest
from tests.cart.image import Image, NoMirror, build
from tests.cart.requirements import CONTAINER, GUEST, IMAGE, missing

FIRST = ("test_guest_cart", "test_guest_service", "test_kernel_devices")
"""Two processes take these files of tests in this order, then the others: the longest goes to one of them, the next
longest to the other.
"""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.parent == Path(__file__).parent:
            item.add_marker(pytest.mark.cart)
    items.sort(key=lambda item: FIRST.index(item.path.stem) if item.path.stem in FIRST else len(FIRST))


def _require(programs: tuple[str, ...]) -> None:
    if why := missing(programs):
        pytest.skip(why)


@pytest.fixture(scope="session")
def image() -> Image:
    """Built again where its sources have changed: minutes, else a second."""
    _require(IMAGE)
    try:
        return build()
    except NoMirror as error:
        pytest.skip(f"needs a Debian mirror: {error}")


@pytest.fixture(scope="session")
def container_image(request: pytest.FixtureRequest) -> Image:
    """Where containers can be booted from it."""
    _require(CONTAINER)
    image: Image = request.getfixturevalue("image")
    if why := refused(image):
        pytest.skip(f"needs systemd-nspawn to work here: {why}")
    return image


@pytest.fixture(scope="session")
def guest_image(request: pytest.FixtureRequest) -> Image:
    """Where QEMU can run it."""
    _require(GUEST)
    image: Image = request.getfixturevalue("image")
    return image


@pytest.fixture
def container(container_image: Image, tmp_path: Path) -> Iterator[Container]:
    """A machine as delivered, booted under systemd-nspawn."""
    with Container(container_image, tmp_path) as machine:
        yield machine


@pytest.fixture
def guest(guest_image: Image, tmp_path: Path) -> Iterator[Guest]:
    """A machine as delivered under QEMU, switched off."""
    with Guest(guest_image, tmp_path) as machine:
        yield machine
