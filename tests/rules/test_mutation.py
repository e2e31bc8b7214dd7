"""Which tests a mutant is given to, and in which order: those that run what was changed, and no other."""

import ast
import textwrap
from pathlib import Path

import pytest

from tests.rules.mutation import Mutant, Reaches, file_of, mutants, ordered
from tests.rules.reached import Reach
from tests.rules.test_ci_rules import run

SOURCE = textwrap.dedent(
    """\
    LIMIT = 3
    class Table:
        row: bool = False
        def first(self, most=2):
            if self.low and (
                self.high
            ):
                return 7
            elif self.high < 5:
                self.low = 8
            match self.low:
                case 9 if not self.high:
                    self.high = 10
    """
)


@pytest.mark.parametrize(
    ("what", "lines"),
    [
        *(("line 1: 3 made 4", None), ("line 3: False made True", None), ("line 4: 2 made 3", None)),
        *(("line 5: operator turned", range(5, 8)), ("line 5: condition never true", range(5, 8))),
        *(("line 8: 7 made 8", range(8, 9)), ("line 9: comparison turned", range(9, 10))),
        *(("line 12: not left out", range(11, 14)), ("line 0: statement 0 left out", range(13, 14))),
    ],
)
def test_a_change_lies_in_the_lines_of_its_statement_and_in_every_test_where_it_runs_at_import(
    what: str, lines: range | None
) -> None:
    found = [mutant.lines for mutant in mutants("policy", ast.parse(SOURCE)) if mutant.what == what]
    assert found == [lines]


def test_a_change_is_made_in_place_and_alone() -> None:
    tree = ast.parse(SOURCE)
    (mutant,) = [mutant for mutant in mutants("policy", tree) if mutant.what == "line 9: comparison turned"]
    assert ast.unparse(tree) == ast.unparse(ast.parse(SOURCE)), "none before it is asked for"
    mutant.change()
    assert ast.unparse(tree) == ast.unparse(ast.parse(SOURCE.replace("self.high < 5", "self.high <= 5")))


def given(lines: range | None, at_import: frozenset[int] = frozenset()) -> set[str]:
    file = file_of("policy")
    by_test = {"runs": Reach({(file, 5), (file, 6)}), "runs another": Reach({(file, 4), (file_of("ledger"), 5)})}
    reaches = Reaches(by_test, frozenset((file, line) for line in at_import))
    return {*Mutant("policy", "", ast.Module([], []), lambda: None, lines).reached_by(reaches)}


def test_a_mutant_is_given_to_the_tests_that_run_one_of_its_lines() -> None:
    assert given(range(5, 8)) == {"runs"}
    assert given(range(1, 4)) == set()
    assert given(None) == given(range(9, 10), frozenset({9})) == {"runs", "runs another"}, "import serves every test"


def test_those_that_noticed_come_first_then_one_of_each_kind_and_what_takes_long_last() -> None:
    took_s = {"a[1]": 0.01, "a[2]": 0.02, "b[1]": 0.03, "b[2]": 0.04, "many": 3.0, "more": 4.0, "c": 0.05}
    expected = ["c", "b[2]", "a[1]", "b[1]", "a[2]", "more", "many"]
    assert ordered(took_s, ["elsewhere", "more", "c", "b[2]"]) == expected


NOTING = """
import sys
sys.path.insert(0, ".")
import pytest
from tests.rules.reached import Reached
plugin = Reached([sys.argv[1]], int(sys.argv[2]), 2)
assert pytest.main(["-q", "test_it.py"], plugins=[plugin]) == 0
told = {name.partition("::")[2]: sorted(line for _, line in one.lines) for name, one in plugin.by_test.items()}
print("told", told, sorted(line for _, line in plugin.at_import))
"""


def test_what_a_test_runs_is_noted_with_its_fixtures_and_what_runs_at_import_apart(tmp_path: Path) -> None:
    """Every second test, as each of two processes takes them."""
    module = tmp_path / "judged.py"
    module.write_text("def one():\n    return 1\ndef two():\n    return 2\ndef early():\n    return 3\nearly()\n")
    tests = "import judged, pytest\n@pytest.fixture\ndef had(): return judged.two()\n"
    tests += "def test_one(): judged.one()\ndef test_none(): pass\ndef test_two(had): pass\n"
    (tmp_path / "test_it.py").write_text(tests)
    for share, told in ((0, {"test_one": [2], "test_two": [4]}), (1, {"test_none": []})):
        code, text = run(tmp_path, NOTING, str(module), str(share), how=("-c",))
        assert code == 0, text
        assert f"told {told} [1, 3, 5, 6, 7]" in text, text
