"""In CI a test that is skipped proves nothing, so it fails, unless tests/rules/skips-in-ci.toml says why it may be."""

import os
import tomllib
from collections.abc import Generator
from functools import cache
from pathlib import Path

import pytest

LIST = Path(__file__).with_name("skips-in-ci.toml")
Report = pytest.TestReport | pytest.CollectReport


@cache
def allowed() -> tuple[str, ...]:
    """How the reasons begin that are accepted. Raises KeyError for an entry that does not say why."""
    entries = tomllib.loads(LIST.read_text())["skip"]
    assert all(entry["why"] for entry in entries)
    return tuple(entry["reason"] for entry in entries)


def judge(report: Report) -> None:
    """Makes a failure of a skip that is not on the list. A test that is expected to fail is no skip."""
    if os.environ.get("CI") != "true" or not report.skipped or hasattr(report, "wasxfail"):
        return
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    reason = reason.removeprefix("Skipped: ")
    if not reason.startswith(allowed()):
        report.outcome = "failed"
        report.longrepr = f"skipped in CI: {reason}\nInstall what it needs in .ci/run, or say in {LIST.name} why not."


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    judge(report)
    return report


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """A whole file may be skipped while it is read."""
    report = yield
    judge(report)
    return report
