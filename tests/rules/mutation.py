"""`python -m tests.rules.mutation`: changes the supervisor place by place; the tests must notice each change.

Written here because the libraries seen (mutmut 3) leave out decorated functions and class bodies, which is where the
guards and the table of the supervisor are. Each mutant runs in a fork of this process, in which the changed module is
imported in place of the real one; as many run beside each other as there are processors. The tests that noticed the
changes before come first: what lies close together in a module is mostly noticed by the same ones.
"""

import ast
import copy
import gc
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import NoReturn

import hypothesis.stateful
import numpy  # noqa: F401  imported once, before the forks
import pytest
import statemachine  # noqa: F401
from hypothesis import Phase, settings

ROOT = Path(__file__).parents[2]
TESTS = [
    "tests/appliance/supervision/test_policy.py",
    "tests/appliance/supervision/test_supervisor.py",
    "tests/appliance/supervision/test_alarms.py",
    "tests/appliance/supervision/test_overload.py",
    "tests/appliance/supervision/test_supervisor_model.py",
]
MODULES = ("policy", "condition", "ledger", "supervisor", "audio", "annunciator")
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
LEAST_PERCENT = 97.0
"""Of the mutants that must be noticed. The rest no test can see, such as a default that nobody leaves out."""
_PATIENCE = 8
"""A mutant that takes so many times as long as the unchanged module hangs, and so has been noticed."""
_QUICKLY = [
    *("-x", "-q", "-m", "not slow", "-W", "ignore", "--tb=no", "--assert=plain"),
    *("-p", "no:cacheprovider", "-p", "no:unraisableexception", "-p", "no:threadexception"),
]
"""Only whether a test fails is asked: without what pytest does to explain it, a mutant takes half the time."""
settings.register_profile("mutation", settings.get_profile("ci"), phases=[Phase.explicit, Phase.generate])

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


class Quickest:
    """Plugin: no time goes into making an example smaller, and the tests of many examples come last. Before them come
    those of `first`, in its order. The name of a test that fails is written to the descriptor `told`.
    """

    def __init__(self, first: Sequence[str], told: int) -> None:
        self._order = {name: place for place, name in enumerate(first)}
        self._told = told

    @pytest.hookimpl(trylast=True)
    def pytest_configure(self, config: pytest.Config) -> None:
        settings.load_profile("mutation")

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items.sort(key=lambda item: (_tries(item), self._order.get(item.nodeid, len(self._order))))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            os.write(self._told, report.nodeid.encode())


def _ordered(name: str) -> list[str]:
    """Where a change of this module shows soonest comes first."""
    return sorted(TESTS, key=lambda file: name.endswith((".audio", ".annunciator")) and "alarms" not in file)


def _tries(item: pytest.Item) -> int:
    body = getattr(item, "function", None)
    if hypothesis.is_hypothesis_test(body):
        return 1
    return 2 if item.path.stem.endswith("_model") else 0


class Mutant:
    """A process in which the tests run on the changed module, those of `first` before the others."""

    def __init__(self, name: str, tree: ast.Module, limit_s: int, first: Sequence[str]) -> None:
        hears, told = os.pipe()
        self._hears = hears
        self.pid = os.fork()
        if self.pid == 0:
            _run(name, tree, limit_s, Quickest(first, told))
        os.close(told)

    def noticed_by(self) -> str:
        """The test that failed, once the process has ended; empty where none did, or none could even be run."""
        with os.fdopen(self._hears) as said:
            return said.read()


def _run(name: str, tree: ast.Module, limit_s: int, plugin: Quickest) -> NoReturn:
    """The exit code says whether all tests passed."""
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, 1)
    os.dup2(sink, 2)
    signal.alarm(limit_s)
    sys.meta_path.insert(0, Changed(name, tree))
    code = _KILLED
    try:
        code = _SURVIVED if pytest.main([*_QUICKLY, *_ordered(name)], plugins=[plugin]) == 0 else _KILLED
    finally:
        os._exit(code)


def survivors(work: Sequence[tuple[str, str, ast.Module]], limit_s: int) -> Iterator[tuple[str, str]]:
    """(module, what was changed) of each mutant on which every test passes."""
    waiting = list(reversed(work))
    running: dict[int, tuple[str, str, Mutant]] = {}
    noticing: list[str] = []
    while waiting or running:
        while waiting and len(running) < (os.cpu_count() or 1):
            module, what, tree = waiting.pop()
            mutant = Mutant(f"appliance.supervision.{module}", tree, limit_s, noticing)
            running[mutant.pid] = module, what, mutant
        child, status = os.wait()
        module, what, mutant = running.pop(child)
        if noticed := mutant.noticed_by():
            noticing = [noticed, *(one for one in noticing if one != noticed)]
        if os.waitstatus_to_exitcode(status) == _SURVIVED:
            yield module, what


def main() -> None:
    os.chdir(ROOT)
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    gc.freeze()
    began_s = time.monotonic()
    unchanged = ast.parse((ROOT / "appliance" / "supervision" / "ledger.py").read_text())
    alive = list(survivors([("ledger", "nothing", unchanged)], limit_s=600))
    assert alive, "the tests fail without any change"
    limit_s = max(10, round(_PATIENCE * (time.monotonic() - began_s)))
    work = []
    for module in sys.argv[1:] or MODULES:
        file = ROOT / "appliance" / "supervision" / f"{module}.py"
        work += [(module, what, tree) for what, tree in mutants(ast.parse(file.read_text()))]
    alive = []
    for module, what in survivors(work, limit_s):
        alive.append(what)
        print(f"survived: {module}.py {what}", flush=True)
    killed_percent = 100 * (1 - len(alive) / len(work))
    print(f"killed {len(work) - len(alive)} of {len(work)} mutants, {killed_percent:.1f} %", end=" ")
    print(f"(at least {LEAST_PERCENT:g} % are asked for) in {time.monotonic() - began_s:.0f} s")
    sys.exit(killed_percent < LEAST_PERCENT)


if __name__ == "__main__":
    main()
