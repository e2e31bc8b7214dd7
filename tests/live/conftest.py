"""Whatever is in this folder needs real time, so the quick suite leaves it out.

The tests of a worker share a simulated cart, whose start takes seconds. One that fails may leave it in any state, so
the next one gets another: one failure is one failure.
"""

import signal
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest

from tests.support.demo_cart import Cart

# A shell that starts the tests in the background has them ignore it, and whatever they start would, too.
signal.signal(signal.SIGINT, signal.default_int_handler)

_failed = pytest.StashKey[bool]()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark it."""
    for item in items:
        if item.path.parent == Path(__file__).parent:
            item.add_marker(pytest.mark.live)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Fixtures are told whether their test has failed."""
    report = yield
    item.stash[_failed] = report.failed or item.stash.get(_failed, False)
    return report


class SharedCart:
    """The cart of one worker."""

    def __init__(self, factory: pytest.TempPathFactory) -> None:
        self._factory = factory
        self._cart: Cart | None = None

    def running(self) -> Cart:
        """The one that runs; a new one, on a line that trusts every picture, where none does."""
        if self._cart is None:
            cart = Cart(self._factory.mktemp("cart"), trusting=True)
            self._cart = cart.__enter__()
        return self._cart

    def end(self) -> None:
        """Its service and its devices."""
        cart, self._cart = self._cart, None
        if cart is not None:
            cart.close()


@pytest.fixture(scope="session")
def shared_cart(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SharedCart]:
    shared = SharedCart(tmp_path_factory)
    yield shared
    shared.end()


@pytest.fixture
def cart(shared_cart: SharedCart, request: pytest.FixtureRequest) -> Iterator[Cart]:
    """The worker's cart, for the next test as well unless this one fails."""
    yield shared_cart.running()
    if request.node.stash.get(_failed, False):
        shared_cart.end()


@pytest.fixture(autouse=True)
def _nothing_beside(shared_cart: SharedCart, request: pytest.FixtureRequest) -> None:
    """A test that is to be alone, and has a cart of its own, waits for no other cart: one takes half a processor."""
    if request.node.get_closest_marker("alone") and "cart" not in request.fixturenames:
        shared_cart.end()
