"""Every option that takes one of a few words lists them, in its help or in that of its command."""

import click
import pytest

from drivers.twins.faults import CART_FAULTS
from drivers.twins.scene.trajectory import PROGRAMS
from drivers.video.crop import FLIPS
from tests.support.commands import commands

WORDS = {"--inject": CART_FAULTS, "--orientation": FLIPS, "--program": PROGRAMS}
"""Options of free text behind which stands a list; a choice of click's lists its words by itself."""


@pytest.mark.parametrize("name", WORDS)
def test_help_lists_the_words(name: str) -> None:
    found = [
        (path, one.help or "")
        for path, command in commands()
        for one in command.params
        if isinstance(one, click.Option) and name in one.opts and not isinstance(one.type, click.Choice)
    ]
    assert found
    for path, told in found:
        assert all(word in told for word in WORDS[name]), path
