"""What is refused as healthy scanning, from the verdicts alone."""

from pathlib import Path

import pytest

from probewatch.appliance.types import Fault, Verdict, VerdictKind
from probewatch.drivers.errors import RecordingError
from probewatch.tools.shared.healthy_scanning import Heard

SECOND_NS = 1_000_000_000


def heard(fault: Fault, seconds: int) -> None:
    told = Heard(Path("box.mcap"))
    for second in range(seconds):
        told.take((Verdict(second * SECOND_NS, VerdictKind.FAULT, (), fault, "why"),), None)


@pytest.mark.parametrize("fault", [Fault.ROTATION, Fault.FIELD_DISTORTION])
def test_a_fault_that_lasts_and_spoils_the_noise_is_refused_by_name(fault: Fault) -> None:
    """Poses that are bent teach a noise that hides the next bend."""
    heard(fault, 1)
    with pytest.raises(RecordingError, match=f"is not healthy scanning: {fault}, why"):
        heard(fault, 3)


def test_a_frozen_picture_teaches_nothing_and_is_no_reason_to_leave_all_out() -> None:
    heard(Fault.FROZEN_VIDEO, 10)
