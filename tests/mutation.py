"""`python -m tests.mutation`: changes the supervisor in one place after the other; the tests must notice each change.

Written here because the libraries seen (mutmut 3) leave out decorated functions and class bodies, which is where the
guards and the table of the supervisor are. Each mutant runs in a fork of this process, in which the changed module is
imported in place of the real one.
"""

import ast
import copy
import os
import sys
from collections.abc import Callable, Iterator
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType

import pytest
import statemachine  # noqa: F401  imported once, before the forks
from hypothesis import Phase, settings
from rich.progress import track

ROOT = Path(__file__).parent.parent
TESTS = ["tests/test_supervisor.py", "tests/test_alarms.py", "tests/test_supervisor_model.py"]
MODULES = ("condition", "ledger", "supervisor", "audio", "annunciator")
_SWAPS = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.And: ast.Or,
    ast.Or: ast.And,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
}
_KILLED, _SURVIVED = 0, 1
settings.register_profile("mutation", phases=[Phase.explicit, Phase.generate], database=None)

Change = Callable[[ast.AST], None]


def mutants(tree: ast.Module) -> Iterator[tuple[str, ast.Module]]:
    """(what was changed and where, changed module), one change each."""
    nodes = list(ast.walk(tree))
    of_dataclasses = {id(one) for node in nodes if isinstance(node, ast.ClassDef) for one in _decorations(node)}
    for at, node in enumerate(nodes):
        if id(node) in of_dataclasses:
            continue
        for what, change in _changes(node):
            changed = copy.deepcopy(tree)
            change(list(ast.walk(changed))[at])
            yield f"line {getattr(node, 'lineno', 0)}: {what}", ast.fix_missing_locations(changed)


def _decorations(node: ast.ClassDef) -> Iterator[ast.AST]:
    """Frozen and slotted or not: no test can tell."""
    for decorator in node.decorator_list:
        yield from ast.walk(decorator)


def _changes(node: ast.AST) -> Iterator[tuple[str, Change]]:
    if isinstance(node, ast.Compare) and type(node.ops[0]) in _SWAPS:
        yield "comparison turned", lambda one: one.ops.__setitem__(0, _SWAPS[type(one.ops[0])]())
    elif isinstance(node, ast.BoolOp | ast.BinOp) and type(node.op) in _SWAPS:
        yield "operator turned", lambda one: setattr(one, "op", _SWAPS[type(one.op)]())
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitOr) and isinstance(node.right, ast.Call):
        yield f"{ast.unparse(node.right)} left out", _left_only
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield "not left out", lambda one: setattr(one, "op", ast.UAdd())
    elif isinstance(node, ast.If | ast.IfExp):
        yield "condition always true", lambda one: setattr(one, "test", ast.Constant(True))
        yield "condition never true", lambda one: setattr(one, "test", ast.Constant(False))
    elif isinstance(node, ast.keyword) and node.arg in ("cond", "unless"):
        yield from _guard_changes(node)
    elif isinstance(node, ast.Constant) and type(node.value) is int:
        yield f"{node.value} made {node.value + 1}", lambda one: setattr(one, "value", one.value + 1)
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield f"{node.value} made {not node.value}", lambda one: setattr(one, "value", not one.value)
    elif isinstance(node, ast.FunctionDef | ast.match_case):
        yield from _statement_changes(node)


def _left_only(node: ast.AST) -> None:
    """`a | b` becomes `a`, in place."""
    assert isinstance(node, ast.BinOp)
    node.right = copy.deepcopy(node.left)


def _guard_changes(node: ast.keyword) -> Iterator[tuple[str, Change]]:
    assert isinstance(node.value, ast.Constant)
    guard = str(node.value.value)
    turned = {"cond": "unless", "unless": "cond"}[str(node.arg)]
    if " " not in guard:
        yield f"guard {guard} turned", lambda one: setattr(one, "arg", turned)
    parts = guard.replace("(", "").replace(")", "").split(" ")
    for part in [part for part in parts if part not in ("and", "or")] if len(parts) > 1 else []:
        yield f"only {part} of the guard", lambda one, part=part: setattr(one.value, "value", part)


def _statement_changes(node: ast.FunctionDef | ast.match_case) -> Iterator[tuple[str, Change]]:
    for index, statement in enumerate(node.body):
        docstring = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
        if isinstance(statement, ast.Assign | ast.AugAssign | ast.Expr) and not docstring:
            yield f"statement {index} left out", lambda one, index=index: one.body.__setitem__(index, ast.Pass())


class Changed(MetaPathFinder, Loader):
    """Imports one module from a changed tree."""

    def __init__(self, name: str, tree: ast.Module) -> None:
        self._name, self._tree = name, tree

    def find_spec(self, name: str, path: object, target: object = None) -> ModuleSpec | None:
        if name != self._name:
            return None
        spec = PathFinder.find_spec(name, path)  # type: ignore[arg-type]
        assert spec is not None
        spec.loader = self
        return spec

    def exec_module(self, module: ModuleType) -> None:
        exec(compile(self._tree, self._name, "exec"), module.__dict__)


def survives(name: str, tree: ast.Module) -> bool:
    """Whether every test passes on the changed module."""
    child = os.fork()
    if child == 0:
        sink = os.open(os.devnull, os.O_WRONLY)
        os.dup2(sink, 1)
        os.dup2(sink, 2)
        sys.meta_path.insert(0, Changed(name, tree))
        code = _KILLED
        try:
            settings.load_profile("mutation")
            arguments = ["-x", "-q", "-p", "no:cacheprovider", "-W", "ignore", "-m", "not slow", *TESTS]
            code = _SURVIVED if pytest.main(arguments) == 0 else _KILLED
        finally:
            os._exit(code)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status) == _SURVIVED


def main() -> None:
    os.chdir(ROOT)
    work = []
    for module in sys.argv[1:] or MODULES:
        file = ROOT / "appliance" / "supervision" / f"{module}.py"
        work += [(module, what, tree) for what, tree in mutants(ast.parse(file.read_text()))]
    unchanged = ast.parse((ROOT / "appliance" / "supervision" / "ledger.py").read_text())
    assert survives("appliance.supervision.ledger", unchanged), "the tests fail without any change"
    alive = []
    for module, what, tree in track(work, description=f"{len(work)} mutants"):
        if survives(f"appliance.supervision.{module}", tree):
            alive.append(what)
            print(f"survived: {module}.py {what}", flush=True)
    killed = len(work) - len(alive)
    print(f"killed {killed} of {len(work)} mutants, {100 * killed / len(work):.1f} %")
    sys.exit(killed < 0.95 * len(work))


if __name__ == "__main__":
    main()
