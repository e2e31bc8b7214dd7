"""Provides the one name by which everything here is imported; docs/python.md shows what a program of your own takes
from it.

A wheel carries `appliance`, `drivers` and `tools` beside this file. In a checkout they lie at the top of the
repository. What is named here is loaded when it is first asked for: the service and its commands load what they need.
"""

from importlib import import_module
from pathlib import Path
from typing import Any

_HERE = Path(__file__).resolve().parent
if not (_HERE / "appliance").is_dir():
    __path__ = [str(_HERE.parents[3])]

_MODULES = {
    "Judged": "appliance.api",
    "judge": "appliance.api",
    "reference": "appliance.api",
    "Line": "appliance.core.line",
    "Limits": "appliance.limits",
    "read_calibration": "appliance.storage.calibration_file",
    "ConfigurationError": "drivers.errors",
    "RecordingError": "drivers.errors",
    "Frame": "drivers.samples",
    "Pose": "drivers.samples",
    "PoseStatus": "drivers.samples",
    "Stamp": "drivers.samples",
}
"""Name → the module that has it."""


def __getattr__(name: str) -> Any:
    """Loads a name of the interface. Raises AttributeError for any other name."""
    if name not in _MODULES:
        raise AttributeError(f"probewatch has no '{name}'; it has {', '.join(_MODULES)}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return list(_MODULES)
