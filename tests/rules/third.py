"""Which third of the thorough tests the gate runs. Pytest's part of it: PROBEWATCH_THIRD=1, 2 or 3 chooses, by hash of
each test's name; tests of files that differ from what landed last (changed.py) in more than what they import run in any
case.

`python -m tests.rules.third` prints the third of the commit that is checked out, and nothing, which chooses all, where
it cannot be known: three commits in a row run every test.
"""

import ast
import os
import sys
from hashlib import sha256
from pathlib import Path

import pytest

from tests.rules.changed import ROOT, UnknownCommitError, differing, git, landed

CHOSEN = "PROBEWATCH_THIRD"


def third_of(test: str) -> str:
    """The third to which a test belongs, by its name: "1", "2" or "3"."""
    return str(int.from_bytes(sha256(test.encode()).digest()[:4]) % 3 + 1)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    chosen = os.environ.get(CHOSEN, "")
    if not chosen:
        return
    if chosen not in ("1", "2", "3"):
        raise pytest.UsageError(f"{CHOSEN} is {chosen!r}: give 1, 2 or 3, or nothing for all tests")
    new = _differing_files(config.rootpath, {item.path for item in items})
    runs = [third_of(item.nodeid) == chosen or item.path in new for item in items]
    config.hook.pytest_deselected(items=[item for item, one in zip(items, runs, strict=True) if not one])
    items[:] = [item for item, one in zip(items, runs, strict=True) if one]


def _differing_files(folder: Path, files: set[Path]) -> set[Path]:
    try:
        base = landed(folder)
    except UnknownCommitError as error:
        raise pytest.UsageError(str(error)) from error
    differ = {folder / name for name in (base and differing(folder, base)) or ()} & files
    return {file for file in differ if not _imports_alone(folder, base, file)}


def _imports_alone(folder: Path, base: str, file: Path) -> bool:
    """Whether the module differs from that of a commit in what it imports alone, as where a name has moved."""
    before = git(folder, "show", f"{base}:{file.relative_to(folder).as_posix()}")
    try:
        return before is not None and _without_imports(before) == _without_imports(file.read_text(encoding="utf-8"))
    except (OSError, SyntaxError, ValueError):
        return False


class _Imports(ast.NodeTransformer):
    """Takes them out."""

    def visit_Import(self, node: ast.Import) -> None:
        return None

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        return None


def _without_imports(module: str) -> str:
    return ast.dump(_Imports().visit(ast.parse(module)))


def commits(folder: Path) -> int | None:
    """How many lie behind the one that is checked out; None where a clone without all of them does not tell."""
    shallow = git(folder, "rev-parse", "--is-shallow-repository")
    count = git(folder, "rev-list", "--count", "--first-parent", "HEAD")
    return int(count) if shallow == "false" and count else None


def third_of_commit(folder: Path) -> str:
    """The next one with each commit; empty where that is not known."""
    count = commits(folder)
    return "" if count is None else str(count % 3 + 1)


if __name__ == "__main__":
    third = third_of_commit(ROOT)
    why = f"third {third}, by the number of commits" if third else "all, as this clone does not tell how many commits"
    print(f"\nthorough tests: {why}", file=sys.stderr)
    print(third)
