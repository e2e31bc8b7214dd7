"""`python -m tests.rules.mutation`: changes the supervisor place by place; the tests must notice each change.

Written here because the libraries seen (mutmut 3) leave out decorated functions and class bodies, which is where the
guards and the table of the supervisor are. Each mutant runs in a fork of this process, in which the changed module is
imported in place of the real one; as many run beside each other as there are processors.

The unchanged modules are run once, and it is noted which test runs which of their lines. A mutant is given to the tests
that run the changed statement; a change of what runs at import is given to all. So a test that is left out by mistake
makes the score worse, never better. The tests that noticed the changes before come first: what lies close together in
a module is mostly noticed by the same ones.
"""

import ast
import copy
import gc
import os
import pickle
import resource
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import NoReturn

import hypothesis.stateful  # noqa: F401
import numpy  # noqa: F401  imported once, before the forks
import pytest
import statemachine  # noqa: F401
from hypothesis import Phase, settings

import probewatch.appliance.limits  # noqa: F401
from tests.rules.reached import Line, Reach, Reached

ROOT = Path(__file__).parents[2]
TESTS = [
    "tests/appliance/supervision/test_policy.py",
    "tests/appliance/supervision/test_condition.py",
    "tests/appliance/supervision/test_supervisor.py",
    "tests/appliance/supervision/test_supervisor_devices.py",
    "tests/appliance/supervision/test_supervisor_latched.py",
    "tests/appliance/supervision/test_supervisor_recalibration.py",
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
_TIMEOUT_FACTOR = 8
"""A mutant that takes so many times as long as the unchanged module hangs, and so has been noticed."""
_UNCHANGED_S = 600
"""Limit in processor seconds of the run that notes which lines the tests reach. Measured: 12 s on each processor."""
_LONG_S = 0.5
"""Processor seconds of a test, traced, from which it counts as long: tests of many examples take 1 to 12 s, no other
takes as much."""
_FIRST = 8
"""Tests that a mutant is given to before the files of the others are collected: most mutants get no further."""
_QUICKLY = [
    *("-x", "-q", "-m", "not slow and not thorough", "-W", "ignore", "--tb=no", "--assert=plain"),
    *("-p", "no:cacheprovider", "-p", "no:unraisableexception", "-p", "no:threadexception"),
]
"""Only whether a test fails is asked: without what pytest does to explain it, a mutant takes half the time."""
settings.register_profile("mutation", settings.get_profile("ci"), phases=[Phase.explicit, Phase.generate])

Change = Callable[[ast.AST], None]


@dataclass(frozen=True)
class Reaches:
    """Lines that each test runs, and lines that run before any test."""

    by_test: Mapping[str, Reach]
    at_import: frozenset[Line]


@dataclass(frozen=True)
class Mutant:
    """A change of a module. change: makes it, in this process for good. lines: of the changed statement; None where it
    runs at import, so for every test.
    """

    module: str
    what: str
    tree: ast.Module
    change: Callable[[], None]
    lines: range | None

    @property
    def name(self) -> str:
        return f"probewatch.appliance.supervision.{self.module}"

    def reached_by(self, reaches: Reaches) -> dict[str, float]:
        """Test → how much of the processor it takes, in s."""
        changed = {(file_of(self.module), number) for number in self.lines or ()}
        whole = self.lines is None or reaches.at_import & changed
        return {test: reach.took_s for test, reach in reaches.by_test.items() if whole or reach.lines & changed}


def file_of(module: str) -> str:
    return str(ROOT / "appliance" / "supervision" / f"{module}.py")


def mutants(module: str, tree: ast.Module) -> Iterator[Mutant]:
    """One change each."""
    nodes = list(ast.walk(tree))
    of_dataclasses = {id(one) for node in nodes if isinstance(node, ast.ClassDef) for one in _decorations(node)}
    lines = dict(_lines(tree, None))
    for node in nodes:
        if id(node) in of_dataclasses:
            continue
        for what, changed, change in _changes(node):
            told = f"line {getattr(node, 'lineno', 0)}: {what}"
            yield Mutant(module, told, tree, partial(change, node), lines[id(changed)])


def _lines(node: ast.AST, within: range | None, in_function: bool = False) -> Iterator[tuple[int, range | None]]:
    """(id of a node, lines of the statement of a function that it belongs to) of it and all below it."""
    if isinstance(node, ast.stmt) and in_function:
        body = getattr(node, "body", None)
        end = body[0].lineno - 1 if body else node.end_lineno or node.lineno
        within = range(node.lineno, max(node.lineno, end) + 1)
    yield id(node), within
    function = isinstance(node, ast.FunctionDef)
    for child in ast.iter_child_nodes(node):
        in_body = function and child in node.body
        yield from _lines(child, within, in_function or in_body)


def _decorations(node: ast.ClassDef) -> Iterator[ast.AST]:
    """Frozen and slotted or not: no test can tell."""
    for decorator in node.decorator_list:
        yield from ast.walk(decorator)


def _changes(node: ast.AST) -> Iterator[tuple[str, ast.AST, Change]]:
    """(what is changed, the node that is, how)."""
    if isinstance(node, ast.FunctionDef | ast.match_case):
        yield from _statement_changes(node)
    else:
        yield from ((what, node, change) for what, change in _own_changes(node))


def _own_changes(node: ast.AST) -> Iterator[tuple[str, Change]]:
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


def _statement_changes(node: ast.FunctionDef | ast.match_case) -> Iterator[tuple[str, ast.AST, Change]]:
    for index, statement in enumerate(node.body):
        docstring = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
        if isinstance(statement, ast.Assign | ast.AugAssign | ast.Expr) and not docstring:
            yield (
                f"statement {index} left out",
                statement,
                lambda one, index=index: one.body.__setitem__(index, ast.Pass()),
            )


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


class Chosen:
    """Plugin: the tests that a mutant is given to, in the order of the first that can notice it, and no time for making
    an example smaller. The name of a test that fails is written to the descriptor `told`.
    """

    def __init__(self, order: Sequence[str], told: int) -> None:
        self._order = {name: place for place, name in enumerate(order)}
        self._told = told

    @pytest.hookimpl(trylast=True)
    def pytest_configure(self, config: pytest.Config) -> None:
        settings.load_profile("mutation")

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = [item for item in items if item.nodeid in self._order]
        items.sort(key=lambda item: self._order[item.nodeid])

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            os.write(self._told, report.nodeid.encode())


class Fork:
    """A process of its own, which runs `work` with the descriptor into which it says what is to be heard of it. The
    exit code is what `work` returns; 0 where it ends in any other way, such as a hang.
    """

    def __init__(self, work: Callable[[int], int], limit_s: int) -> None:
        hears, told = os.pipe()
        self.pid = os.fork()
        if self.pid == 0:
            _run(work, told, limit_s)
        os.close(told)
        self._hears = hears

    def heard(self) -> bytes:
        """All that it said; waits until it has ended."""
        with os.fdopen(self._hears, "rb") as said:
            return said.read()


def _run(work: Callable[[int], int], told: int, limit_s: int) -> NoReturn:
    """limit_s: of the processor's time, so that other programs make no hang of a mutant."""
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, 1)
    os.dup2(sink, 2)
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))
    code = _KILLED
    try:
        code = work(told)
    finally:
        os._exit(code)


def unchanged(modules: Sequence[str]) -> Reaches:
    """Notes which lines of these modules the tests run. Raises SystemExit where a test fails."""
    files, shares = [file_of(module) for module in modules], os.cpu_count() or 1
    forks = [Fork(partial(_noted, Reached(files, share, shares)), _UNCHANGED_S) for share in range(shares)]
    heard = [fork.heard() for fork in forks]
    if any(os.waitstatus_to_exitcode(os.waitpid(fork.pid, 0)[1]) != _SURVIVED for fork in forks):
        sys.exit("the tests fail without any change: run them first")
    noted: list[Reaches] = [pickle.loads(one) for one in heard]
    by_test = {test: reach for one in noted for test, reach in one.by_test.items()}
    return Reaches(by_test, frozenset().union(*(one.at_import for one in noted)))


def _noted(plugin: Reached, told: int) -> int:
    """In a process of its own."""
    settings.load_profile("mutation")
    code = pytest.main([*_QUICKLY, *TESTS], plugins=[plugin])
    with os.fdopen(told, "wb") as stream:
        pickle.dump(Reaches(plugin.by_test, frozenset(plugin.at_import)), stream)
    return _SURVIVED if code == 0 else _KILLED


def survives(mutant: Mutant, order: Sequence[str], told: int) -> int:
    """In a process of its own: whether these tests pass on the mutant."""
    mutant.change()
    sys.meta_path.insert(0, Changed(mutant.name, ast.fix_missing_locations(mutant.tree)))
    parts = [part for part in (order[:_FIRST], order[_FIRST:]) if part]
    return _SURVIVED if all(_pass(part, told) for part in parts) else _KILLED


def _pass(tests: Sequence[str], told: int) -> bool:
    """Whether none fails; nor is a mutant noticed by tests that are no longer there under their names."""
    files = dict.fromkeys(test.partition("::")[0] for test in tests)
    unnoticed = pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED
    return pytest.main([*_QUICKLY, *files], plugins=[Chosen(tests, told)]) in unnoticed


def ordered(took_s: Mapping[str, float], noticing: Sequence[str]) -> list[str]:
    """Returns the tests in the order in which they are tried: first those that noticed an earlier mutant, the latest
    one first; then one case of each parametrized test, as its other cases are likely to notice the same. Long tests
    come last, whatever they noticed.
    """
    recent = {test: place for place, test in enumerate(noticing)}
    of_function = Counter[str]()
    keys: dict[str, tuple[bool, int, int, float, str]] = {}
    for test in sorted(took_s, key=lambda test: (took_s[test], test)):
        function = test.partition("[")[0]
        place = recent.get(test, len(recent))
        keys[test] = took_s[test] > _LONG_S, place, of_function[function], took_s[test], test
        of_function[function] += 1
    return sorted(took_s, key=keys.__getitem__)


def survivors(work: Sequence[Mutant], reaches: Reaches, limit_s: int) -> Iterator[Mutant]:
    """Yields the mutants that no test notices of those that run the changed statement."""
    waiting = list(reversed(work))
    running: dict[int, tuple[Mutant, Fork]] = {}
    noticing: list[str] = []
    while waiting or running:
        while waiting and len(running) < (os.cpu_count() or 1):
            mutant = waiting.pop()
            if not (order := ordered(mutant.reached_by(reaches), noticing)):
                yield mutant
                continue
            fork = Fork(partial(survives, mutant, order), limit_s)
            running[fork.pid] = mutant, fork
        if not running:
            continue
        child, status = os.wait()
        mutant, fork = running.pop(child)
        if noticed := fork.heard().decode():
            noticing = [noticed, *(one for one in noticing if one != noticed)]
        if os.waitstatus_to_exitcode(status) == _SURVIVED:
            yield mutant


def main() -> None:
    os.chdir(ROOT)
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    early = [one for one in MODULES if f"probewatch.appliance.supervision.{one}" in sys.modules]
    assert not early, f"imported before it can be changed: {early}"
    gc.freeze()
    began_s = time.monotonic()
    modules = sys.argv[1:] or MODULES
    reaches = unchanged(modules)
    limit_s = max(10, round(_TIMEOUT_FACTOR * sum(reach.took_s for reach in reaches.by_test.values())))
    work = [one for module in modules for one in mutants(module, ast.parse(Path(file_of(module)).read_text()))]
    alive = 0
    for mutant in survivors(work, reaches, limit_s):
        alive += 1
        print(f"survived: {mutant.module}.py {mutant.what}", flush=True)
    killed_percent = 100 * (1 - alive / len(work))
    print(f"killed {len(work) - alive} of {len(work)} mutants, {killed_percent:.1f} %", end=" ")
    print(f"(at least {LEAST_PERCENT:g} % are asked for) in {time.monotonic() - began_s:.0f} s")
    sys.exit(killed_percent < LEAST_PERCENT)


if __name__ == "__main__":
    main()
