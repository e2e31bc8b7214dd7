"""One test that fails and leaves its cart dead takes no other test with it."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
SUITE = """
def test_shares(cart): cart.known = True
def test_breaks(cart):
    cart.daemon.end(kill=True)
    assert not cart.known
def test_comes_after(cart):
    assert not hasattr(cart, "known")
    cart.wait_for("monitoring")
"""


def test_after_a_failure_there_is_another_cart(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(SUITE)
    command = [sys.executable, "-m", "pytest", "-p", "tests.live.conftest", "-p", "no:cacheprovider", "-rA"]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, env=environment)
    assert "1 failed, 2 passed" in done.stdout, done.stdout + done.stderr
    assert "FAILED test_it.py::test_breaks" in done.stdout
