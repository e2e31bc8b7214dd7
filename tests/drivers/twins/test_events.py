"""A simulated device prints to the standard output that was in place when it was made."""

from contextlib import ExitStack, redirect_stdout
from io import StringIO

import pytest

from tests.support.simulated_optotrak import bench


def test_a_command_of_the_same_process_does_not_get_its_lines(capsys: pytest.CaptureFixture[str]) -> None:
    with ExitStack() as device:
        cart = device.enter_context(bench())
        with redirect_stdout(StringIO()) as command:
            cart.open().close()
            device.close()
    assert '"clients": 1' in capsys.readouterr().out
    assert command.getvalue() == ""
