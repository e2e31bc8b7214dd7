"""Real EM-tracked freehand recordings of PLUS through the whole line, against their published calibration."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from probewatch.appliance.core.line import Line
from probewatch.appliance.core.quality.report import LineReport
from probewatch.appliance.limits import Limits
from probewatch.appliance.storage.calibration_file import read_calibration
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.appliance.types import Calibration, Fault, VerdictKind
from probewatch.drivers.recordings.replay import open_recording
from probewatch.drivers.rigid import vector_from_rotation
from tests.support.recordings import NWIRE_IMAGE_TO_PROBE, plus_file, with_late_poses

pytestmark = pytest.mark.thorough
FCAL = "fCal_Test_Validation_3NWires_fCal2.0.igs.mha"
NWIRE = "NwirePhantomFreehand.igs.mha"


@dataclass(frozen=True)
class Run:
    """named: every fault that a verdict named while the recording ran."""

    report: LineReport
    nominal: Calibration
    named: frozenset[Fault | None]

    @property
    def scale_percent(self) -> np.ndarray:
        assert self.report.estimate is not None
        return 100 * (self.report.estimate.scale_mm_per_px / self.nominal.scale_mm_per_px - 1)

    @property
    def turn_deg(self) -> float:
        assert self.report.estimate is not None
        return float(
            np.degrees(np.linalg.norm(vector_from_rotation(self.report.estimate.rotation @ self.nominal.rotation.T)))
        )


@cache
def run(name: str, late_s: float = 0.0) -> Run:
    """late_s: added to the stamps of the poses."""
    recording = open_recording(plus_file(name))
    if name == NWIRE:
        nominal = calibration_from_image_to_probe(NWIRE_IMAGE_TO_PROBE, recording.size_px)
    else:
        device_set = plus_file("PlusDeviceSet_fCal_Sim_VolumeReconstruction.xml")
        nominal = read_calibration(device_set, recording.size_px, "Probe")
    line = Line(nominal, Limits())
    named = {verdict.fault for sample in with_late_poses(recording.samples(), late_s) for verdict in line.step(sample)}
    return Run(line.report(), nominal, frozenset(named))


@pytest.mark.parametrize("name", [FCAL, NWIRE])
def test_the_estimate_covers_the_published_calibration(name: str) -> None:
    """Wires in water wander as the plane leaves them: seven seconds of that leave sigmas of 5 to 13 %."""
    found = run(name)
    assert found.report.motions >= 40
    assert found.report.estimate is not None
    assert found.report.estimate.covariance is not None
    sigma_percent = 100 * np.sqrt(np.diag(found.report.estimate.covariance)[3:5])
    assert np.all(sigma_percent < 15), sigma_percent
    assert np.all(np.abs(found.scale_percent) < 3 * sigma_percent), (found.scale_percent, sigma_percent)
    assert found.turn_deg < 9.0


@pytest.mark.parametrize(("name", "latency_ms"), [(FCAL, 20.0), (NWIRE, 75.0)])
def test_latency_is_found_before_anything_else_is_judged(name: str, latency_ms: float) -> None:
    latency = run(name).report.latency
    assert latency is not None
    assert latency.value == pytest.approx(latency_ms, abs=30.0)


@pytest.mark.parametrize("name", [FCAL, NWIRE])
def test_seven_seconds_of_mostly_elevational_motion_show_neither_scale(name: str) -> None:
    """Their sigma cannot show a limit of 5 %: of the scales neither OK nor FAULT may be said."""
    report = run(name).report
    verdicts = {check.name: check.verdict for check in report.checks}
    assert verdicts["scale-lateral"] is verdicts["scale-axial"] is VerdictKind.NOT_VERIFIED
    assert verdicts["polarity"] is VerdictKind.OK


def test_a_recording_without_a_fault_is_not_verified_and_says_why() -> None:
    verdict = run(FCAL).report.verdict
    assert verdict.kind is VerdictKind.NOT_VERIFIED
    assert "scale-lateral" in verdict.reason


def test_a_tracker_that_is_later_than_the_limit_is_a_fault_and_the_only_one() -> None:
    """By the two paths alone it is about 75 ms late; the limit is 60."""
    found = run(NWIRE)
    failed = {check.name for check in found.report.checks if check.verdict is VerdictKind.FAULT}
    assert (found.named, failed) == ({None, Fault.LATENCY}, {"latency"})


@pytest.mark.parametrize("late_s", [-0.45, 0.45])
def test_a_tracker_that_is_half_a_second_late_is_told_though_nothing_else_is_shown(late_s: float) -> None:
    """The line alone says nothing of it: it goes by the latest motion, which is mostly out of the plane."""
    usual, late = run(FCAL).report.latency, run(FCAL, late_s).report
    assert usual is not None
    assert late.latency is not None
    assert late.latency.verdict is VerdictKind.FAULT
    assert late.latency.value - usual.value == pytest.approx(1e3 * late_s, abs=10.0)
    assert late.latency.sigma < 40.0
    assert (late.verdict.kind, late.verdict.fault) == (VerdictKind.FAULT, Fault.LATENCY)
    assert "by all of the recording" in late.verdict.reason
