"""What the process that drives the contact loads: nothing that solves, registers or decodes a picture.

A crash or a lock in such a library would take the watchdog of the contact with it.
"""

import subprocess
import sys

import pytest

_NOT_LOADED = (
    "probewatch.appliance.core.line",
    "probewatch.appliance.core.path",
    "probewatch.appliance.core.registration",
    "probewatch.appliance.core.detectors",
    "probewatch.appliance.core.handeye",
    "scipy",
    "cv2",
)


@pytest.fixture(scope="module")
def loaded() -> frozenset[str]:
    """Names of all modules that a new interpreter has once it has loaded the service's main module."""
    code = "import sys, probewatch.appliance.service.daemon; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return frozenset(done.stdout.split())


@pytest.mark.parametrize("name", _NOT_LOADED)
def test_the_hardware_process_does_not_load(name: str, loaded: frozenset[str]) -> None:
    assert "probewatch.appliance.service.daemon" in loaded
    assert not {module for module in loaded if module == name or module.startswith(f"{name}.")}
