"""Without the compiled core a command says what to run, in one line."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import probewatch

PROJECT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def without_core(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sources as they are imported, before anything was compiled."""
    folder = tmp_path_factory.mktemp("sources")
    for room in ("appliance", "drivers", "tools"):
        shutil.copytree(
            PROJECT / room, folder / "probewatch" / room, ignore=shutil.ignore_patterns("*.so", "__pycache__")
        )
    shutil.copy(probewatch.__file__, folder / "probewatch")
    return folder


@pytest.mark.parametrize(
    "arguments", [["replay", "a.mha", "--calibration", "b.xml"], ["latency", "a.mha", "--calibration", "b.xml"]]
)
def test_a_command_that_needs_it_says_what_to_run(without_core: Path, arguments: list[str]) -> None:
    program = f"import sys; sys.argv = ['probewatch', *{arguments!r}]; from probewatch.tools.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=without_core, capture_output=True, text=True, check=False, timeout=60
    )
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (70, "", 1)
    assert done.stderr.startswith("probewatch: the compiled core ")
    assert "make -B .venv/dev" in done.stderr
