"""What the gate leaves out, tried on small repositories: nothing unless what it is about is as it landed."""

import ast
import subprocess
from collections.abc import Iterable
from pathlib import Path

import pytest

from tests.rules.changed import ABOUT, BASE, LEAVE_OUT, ROOT, RUN, UnknownCommitError, judged
from tests.rules.mutation import MODULES, TESTS
from tests.rules.test_ci_rules import run, suite
from tests.rules.third import CHOSEN, third_of, third_of_commit

LEDGER, PAGE = "appliance/supervision/ledger.py", "CONTRIBUTING.md"


def git(folder: Path, *command: str) -> None:
    named = ("-c", "user.name=somebody", "-c", "user.email=somebody@example.org")
    subprocess.run(["git", "-C", folder, *named, *command], check=True, capture_output=True)


def commit(folder: Path, file: str) -> None:
    """A change of one file."""
    (folder / file).parent.mkdir(parents=True, exist_ok=True)
    with (folder / file).open("a") as stream:
        stream.write("one more line\n")
    git(folder, "add", "-A")
    git(folder, "commit", "-m", file)


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A clone of what landed."""
    monkeypatch.delenv(BASE, raising=False)
    landed, here = tmp_path / "landed", tmp_path / "checkout"
    landed.mkdir()
    git(landed, "init", "-b", "main")
    commit(landed, LEDGER)
    git(tmp_path, "clone", str(landed), str(here))
    return here


def test_a_part_runs_where_a_file_that_it_is_about_differs_from_what_landed(checkout: Path) -> None:
    commit(checkout, PAGE)
    why = "LEFT OUT: mutation, as no file that it is about differs from origin/main, which passed"
    assert judged("mutation", checkout) == (LEAVE_OUT, why)
    commit(checkout, LEDGER)
    commit(checkout, PAGE)
    assert judged("mutation", checkout) == (RUN, f"mutation runs: {LEDGER} differs from origin/main")
    assert judged("deb", checkout)[0] == LEAVE_OUT


def test_what_is_not_committed_yet_differs_as_well(checkout: Path) -> None:
    commit(checkout, PAGE)
    (checkout / LEDGER).write_text("another line\n")
    assert judged("mutation", checkout)[0] == RUN


def test_a_part_runs_where_it_is_not_known_what_landed(checkout: Path, tmp_path: Path) -> None:
    """The commit may be origin/main itself, have gone another way than it, have no remote, or be no commit."""
    assert judged("mutation", checkout) == (
        RUN,
        f"mutation runs: what landed last is not known ({BASE} is not set, origin/main is no commit before this)",
    )
    commit(checkout, PAGE)
    commit(tmp_path / "landed", PAGE)
    git(checkout, "fetch")
    assert judged("mutation", checkout)[0] == RUN, "it has gone another way"
    git(checkout, "remote", "remove", "origin")
    assert judged("mutation", checkout)[0] == RUN, "there is no remote"
    (tmp_path / "no repository").mkdir()
    assert judged("mutation", tmp_path / "no repository")[0] == RUN


def test_a_commit_that_passed_can_be_named(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    commit(checkout, LEDGER)
    commit(checkout, PAGE)
    monkeypatch.setenv(BASE, "HEAD~1")
    assert judged("mutation", checkout)[0] == LEAVE_OUT
    monkeypatch.setenv(BASE, "HEAD~2")
    assert judged("mutation", checkout)[0] == RUN
    monkeypatch.setenv(BASE, "0123abc")
    with pytest.raises(UnknownCommitError, match=rf"{BASE} is '0123abc', which is no commit of .*: fetch it"):
        judged("mutation", checkout)


def imported(files: Iterable[str]) -> set[str]:
    """These modules of this repository and all that they import, also inside functions."""
    seen: set[str] = set()
    left = [Path(file) for file in files]
    while left:
        file = left.pop()
        if str(file) in seen or not (ROOT / file).is_file():
            continue
        seen.add(str(file))
        for node in ast.walk(ast.parse((ROOT / file).read_text())):
            names = [one.name for one in getattr(node, "names", ())] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.module:
                names = [node.module, *(f"{node.module}.{one.name}" for one in node.names)]
            for path in (Path(*name.removeprefix("probewatch.").split(".")) for name in names):
                left += [path.with_suffix(".py"), *(part / "__init__.py" for part in (path, *path.parents))]
    return seen


def test_the_mutation_is_about_all_that_its_tests_import() -> None:
    modules = [f"appliance/supervision/{name}.py" for name in MODULES]
    about = [Path(path) for path in ABOUT["mutation"]]
    needed = {Path(file) for file in imported([*TESTS, *modules, "tests/conftest.py"])}
    packages = {file for file in needed if file.name == "__init__.py"}
    assert len(needed) > 20
    assert [file for file in needed - packages if not any(file.is_relative_to(path) for path in about)] == []


def test_every_part_is_about_files_that_there_are() -> None:
    assert [path for paths in ABOUT.values() for path in paths if not (ROOT / path).exists()] == []


def test_three_commits_in_a_row_run_every_thorough_test(checkout: Path, tmp_path: Path) -> None:
    thirds = []
    for _ in range(4):
        thirds.append(third_of_commit(checkout))
        commit(checkout, PAGE)
    assert {*thirds[:3]} == {*thirds[1:]} == {"1", "2", "3"}
    git(tmp_path, "clone", "--depth=1", checkout.as_uri(), "shallow")
    assert third_of_commit(tmp_path / "shallow") == "", "a clone without all commits runs all tests"


def test_the_thirds_are_every_test_once_and_none_is_much_the_largest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = [f"test_one.py::test_{number}" for number in range(300)]
    assert max([third_of(name) for name in names].count(third) for third in "123") < 120
    suite(tmp_path, "@pytest.mark.parametrize('n', range(20))", "def test_one(n): print(f'ran {n} ')")
    monkeypatch.delenv(BASE, raising=False)
    ran: list[str] = []
    for third in ("1", "2", "3"):
        monkeypatch.setenv(CHOSEN, third)
        code, text = run(tmp_path, "pytest", "-p", "tests.rules.third", "-s")
        ran += [word for word, before in zip(text.split()[1:], text.split(), strict=False) if before.endswith("ran")]
        assert (code, " deselected" in text) == (0, True), text
    assert sorted(ran, key=int) == [str(number) for number in range(20)]
    monkeypatch.setenv(CHOSEN, "4")
    code, text = run(tmp_path, "pytest", "-p", "tests.rules.third")
    assert (code, f"{CHOSEN} is '4': give 1, 2 or 3, or nothing for all tests" in text) == (4, True), text


def test_what_has_changed_runs_whichever_third_it_is_in(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Twenty tests, of which some are in any third; so a test that is new is run before it lands."""
    suite(checkout, "@pytest.mark.parametrize('n', range(20))", "def test_one(n): pass")
    git(checkout, "add", "-A")
    git(checkout, "commit", "-m", "a test")
    monkeypatch.setenv(CHOSEN, "1")
    assert "= 20 passed" in run(checkout, "pytest", "-p", "tests.rules.third")[1]
    monkeypatch.setenv(BASE, "HEAD")
    assert " deselected" in run(checkout, "pytest", "-p", "tests.rules.third")[1]
    (module,) = checkout.glob("test_*.py")
    module.write_text(f"import json\n{module.read_text()}")
    assert " deselected" in run(checkout, "pytest", "-p", "tests.rules.third")[1], "a moved name changes no test"
    module.write_text(module.read_text().replace("pass", "assert n < 20"))
    assert "= 20 passed" in run(checkout, "pytest", "-p", "tests.rules.third")[1]
    monkeypatch.setenv(BASE, "0123abc")
    code, text = run(checkout, "pytest", "-p", "tests.rules.third")
    assert (code, f"{BASE} is '0123abc', which is no commit" in text) == (4, True), text
