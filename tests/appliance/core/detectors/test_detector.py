"""Every detector is a part of the line."""

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from probewatch.appliance.core import detectors
from probewatch.appliance.core.detectors.detector import Detector
from probewatch.appliance.core.line import Line
from probewatch.appliance.limits import Limits
from tests.support.motions import TRUTH

FOLDER = Path(detectors.__file__).parent


def kinds() -> Iterator[type[Detector]]:
    """Every subclass of Detector in the core that is no base of others."""
    for file in sorted(FOLDER.glob("*.py")):
        import_module(f"{detectors.__name__}.{file.stem}")
    left = [Detector]
    while left:
        one = left.pop()
        below = [kind for kind in one.__subclasses__() if kind.__module__.startswith("probewatch.appliance.")]
        left += below
        if not below:
            yield one


def test_every_detector_is_a_part_of_the_line() -> None:
    watching = {type(one) for one in Line(TRUTH, Limits())._detectors}
    assert len(watching) > 10
    lacking = [f"{one.__module__}.{one.__name__}" for one in kinds() if one not in watching]
    assert not lacking, f"no row in the tuple of detectors in appliance/core/line.py: {', '.join(lacking)}"
