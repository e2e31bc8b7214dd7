"""Every number that somebody chose says why: its unit, what it trades, and where it comes from or was measured."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("appliance", "drivers", "tools")
_PLAIN = {0, 1, -1}
"""Numbers that count or begin something; nobody chose them."""


def numbers(value: ast.expr) -> bool:
    """Whether the expression holds a number that somebody may have chosen; text and names of other constants do not."""
    constants = [node.value for node in ast.walk(value) if isinstance(node, ast.Constant)]
    return any(isinstance(one, int | float) and not isinstance(one, bool) and one not in _PLAIN for one in constants)


def is_constant(statement: ast.stmt) -> bool:
    if isinstance(statement, ast.AnnAssign) and statement.value is not None:
        targets: list[ast.expr] = [statement.target]
    elif isinstance(statement, ast.Assign):
        targets = statement.targets
    else:
        return False
    names = [node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)]
    assert statement.value is not None
    if any(isinstance(node, ast.Name) and node.id == "__file__" for node in ast.walk(statement.value)):
        return False  # a place in the checkout, counted in folders
    return bool(names) and all(name.isupper() for name in names) and numbers(statement.value)


def has_reason(statements: list[ast.stmt], index: int, lines: list[str]) -> bool:
    """A comment on it or right above, or a docstring right below it or below the unbroken block it stands in."""
    statement = statements[index]
    assert statement.end_lineno is not None
    above = lines[statement.lineno - 2].strip() if statement.lineno > 1 else ""
    if above.startswith("#") or any("  # " in line for line in lines[statement.lineno - 1 : statement.end_lineno]):
        return True
    for before, after in zip(statements[index:], statements[index + 1 :], strict=False):
        if after.lineno != (before.end_lineno or 0) + 1:
            return False
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and isinstance(after.value.value, str):
            return True
    return False


def without_reason(path: Path) -> list[str]:
    text = path.read_text()
    lines, tree = text.splitlines(), ast.parse(text)
    bodies = [tree.body, *(node.body for node in ast.walk(tree) if isinstance(node, ast.ClassDef))]
    return [
        f"{path.relative_to(ROOT)}:{statement.lineno}: {lines[statement.lineno - 1].strip()}"
        for body in bodies
        for index, statement in enumerate(body)
        if is_constant(statement) and not has_reason(body, index, lines)
    ]


@pytest.mark.parametrize("package", PACKAGES)
def test_every_constant_says_why(package: str) -> None:
    assert [found for path in sorted((ROOT / package).rglob("*.py")) for found in without_reason(path)] == []


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("_LIMIT_S = 3.0\n", 1),
        ('_LIMIT_S = 3.0\n"""Longer waits for nobody."""\n', 0),
        ("_LIMIT_S = 3.0  # as the sheet says\n", 0),
        ("# As the sheet says.\n_LIMIT_S = 3.0\n", 0),
        ('_A, _B = 3, 4\n_C = 5\n"""Offsets of the reply, section 7."""\n', 0),
        ('_A = 3\n\n_C = 5\n"""Of the last only."""\n', 1),
        ('class Room:\n    SIZE_PX = 640\n    NAME = "room"\n', 1),
        ("_FIRST = 0\n_TEXT = 'x' * 1\n", 0),
    ],
)
def test_the_counter_sees_what_it_is_to_see(text: str, found: int, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("tests.rules.test_constants.ROOT", tmp_path)
    (tmp_path / "room.py").write_text(text)
    assert len(without_reason(tmp_path / "room.py")) == found
