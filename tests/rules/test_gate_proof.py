"""`make gate-proof`: each of its defects fits the code as it is, and what no test notices is said."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from tests.rules.gate_proof import DEFECTS, ROOT, Defect, DefectUnfitError, main, put_in

CLOCK, ITS_TESTS = "appliance/service/host/wall_clock.py", ("tests/appliance/service/host/test_wall_clock.py",)


@pytest.mark.parametrize("defect", DEFECTS, ids=lambda defect: defect.what)
def test_each_defect_changes_one_place_of_the_code_as_it_is(defect: Defect, tmp_path: Path) -> None:
    (tmp_path / defect.file).parent.mkdir(parents=True)
    (tmp_path / defect.file).write_text((ROOT / defect.file).read_text())
    assert put_in(defect, tmp_path) == (ROOT / defect.file).read_text() != (tmp_path / defect.file).read_text()
    compile((tmp_path / defect.file).read_text(), defect.file, "exec")


@pytest.mark.parametrize("text", ["another line\n", "the line\nthe line\n", None])
def test_a_defect_that_does_not_fit_the_code_any_more_is_named(tmp_path: Path, text: str | None) -> None:
    if text is not None:
        (tmp_path / "one.py").write_text(text)
    times = 0 if text is None else text.count("the line")
    with pytest.raises(DefectUnfitError, match=rf"lost: one\.py has {times} times, not once: 'the line'\. Change the"):
        put_in(Defect("lost", "one.py", "the line", "another", ()), tmp_path)


@pytest.mark.thorough
def test_what_no_test_notices_is_said_and_fails(capsys: pytest.CaptureFixture[str]) -> None:
    seen = Defect("seen", CLOCK, "_LEAST_NS = 1_000", "_LEAST_NS = 9_000", ITS_TESTS)
    unseen = Defect("unseen", "README.md", "# probewatch\n", "# Probewatch\n", ITS_TESTS)
    code = main([seen, unseen])
    text = capsys.readouterr().out
    assert code == 1, text
    assert re.search(r"^seen: red: tests/appliance/service/host/test_wall_clock.py::", text, re.M), text
    assert "unseen: NOT NOTICED (pytest's exit code 0)" in text
    assert "1 of 2 red" in text
    failing = replace(seen, tests=("no_such_file.py",))
    assert main([failing]) == 2
    assert "nothing is proved" in capsys.readouterr().err
