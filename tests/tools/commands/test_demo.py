"""`probewatch demo`: what its command line refuses; a real run is in tests/live/test_demo.py."""

import pytest

from probewatch.tools.demo.script import FAULT_CLASS
from tests.support.answers import answered


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--fault", "flip@20"], 2, "'flip' is not a known fault. Did you mean 'flip-lateral' or 'flip-vertical'?"),
        (["--fault", "depth"], 2, "such as depth@25"),
        (["--fault", "depth@nan"], 2, "needs a time in seconds"),
        (["--fault", "depth@20", "--duration", "30"], 78, "the last fault may need until 58 s"),
        (["--tissue", "jelly"], 78, "no part 'jelly'. Use rigid"),
        (["--tissue", "deep"], 78, "Leave out deep and tracker"),
        (["--json", "report.json"], 2, "unexpected extra argument (report.json)"),
    ],
)
def test_a_bad_command_line_is_refused_before_anything_starts(arguments: list[str], code: int, said: str) -> None:
    refused = answered("demo", *arguments)
    assert (refused.returncode, refused.stdout) == (code, "")
    assert said in refused.stderr


def test_the_help_names_every_fault() -> None:
    text = answered("demo", "--help").stdout
    assert all(fault in text and fault_class in text for fault, fault_class in FAULT_CLASS.items())
