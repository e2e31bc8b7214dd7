"""The programs under tests/ that `python -m` starts print their help and do nothing else."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("package", ["tests.paper", "tests.crosswire", "tests.invariant"])
def test_help_is_printed_and_nothing_else_is_done(package: str) -> None:
    asked = [sys.executable, "-m", package, "--help"]
    answer = subprocess.run(asked, check=False, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert (answer.returncode, answer.stderr) == (0, "")
    assert answer.stdout.lower().startswith("usage: ")
