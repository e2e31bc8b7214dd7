"""`probewatch self-test` without a service; that of a cart is in tests/live/test_feed.py."""

import pytest

from tests.support.answers import answered


@pytest.mark.parametrize("arguments", [("--socket", "/nowhere/control"), ("--config", "/nowhere.toml")])
def test_without_a_service_it_says_so(arguments: tuple[str, str]) -> None:
    shown = answered("self-test", *arguments, "--yes")
    assert shown.returncode in (69, 78)
    assert shown.stderr.count("\n") == 1
