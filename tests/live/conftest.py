"""Whatever is in this folder needs real time, so the quick suite leaves it out."""

import signal
from pathlib import Path

import pytest

# A shell that starts the tests in the background has them ignore it, and whatever they start would, too.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark it."""
    for item in items:
        if item.path.parent == Path(__file__).parent:
            item.add_marker(pytest.mark.live)
