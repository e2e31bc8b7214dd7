"""Collects the results of the sequential test over healthy scanning, block by block; refuses any other scanning."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from probewatch.appliance.core.line import Line
from probewatch.appliance.limits import MOST_NAMED_NATS, Limits
from probewatch.appliance.storage.black_box import Series
from probewatch.appliance.storage.black_box_fields import State as LiveState
from probewatch.appliance.storage.calibration_file import read_calibration
from probewatch.appliance.types import Calibration, Fault, Kind, State, Verdict
from probewatch.drivers.errors import RecordingError
from probewatch.drivers.recordings.replay import open_recording
from probewatch.drivers.samples import Frame, Pose, Sample
from probewatch.tools.shared.left_out import tell_left_out
from probewatch.tools.shared.noise_tail import BLOCK_NS
from probewatch.tools.shared.rerun import Rerun

Watched = Callable[[Iterable[Sample]], Iterator[Sample]]
_LASTING_NS = 1_000_000_000
"""ns for which a FAULT must last to count as one: the supervisor halts after that time."""
_ONE_LOOK_NS = 1_000_000_000
"""ns that one verdict counts as scanning time at most: a gap in the recording is not scanning. Not measured."""
_NOT_HEALTHY = "Leave it out, or find out what was wrong; only healthy scanning teaches the noise"


_HALTED = (State.HALT.value, State.RECALIBRATION_REQUESTED.value)


def _is_wrong(fault: object) -> bool:
    """Returns whether the name is that of a fault of the calibration, or of metal that looks like one."""
    known = next((one for one in Fault if one == fault), None)
    return known is not None and (known.kind is Kind.CALIBRATION or known is Fault.FIELD_DISTORTION)


@dataclass(frozen=True, slots=True)
class Named:
    """Names the tools and the orientation of sequences whose files do not state them, as open_recording takes them."""

    probe: str | None = None
    reference: str | None = None
    orientation: str | None = None


class Heard:
    """Collects the peaks of the sequential test in one recording. peaks: block → largest log likelihood ratio, of every
    block in which there was something to test. tested_ns: for how long there was. Raises RecordingError where the
    scanning was not healthy, or is not what the model describes.
    """

    def __init__(self, path: Path) -> None:
        self.peaks = defaultdict[int, float](float)
        self.tested_ns = 0
        self._path = path
        self._last_ns: int | None = None
        self._faulty: tuple[Fault, int] | None = None

    def take(self, verdicts: tuple[Verdict, ...], nats: float | None) -> None:
        """Takes the line's verdicts on the next sample, and its log likelihood ratio, nats; None where nothing was
        tested.
        """
        for verdict in verdicts:
            self._refuse_faults(verdict)
            since_ns = 0 if self._last_ns is None else verdict.t_ns - self._last_ns
            self._last_ns = verdict.t_ns
            if nats is not None:
                self.tested_ns += min(max(since_ns, 0), _ONE_LOOK_NS)
                block = verdict.t_ns // BLOCK_NS
                self.peaks[block] = max(self.peaks[block], nats)
        if nats is not None and nats > MOST_NAMED_NATS:
            what = f"picture and tracker disagree by {nats:.0f} nats, more than {MOST_NAMED_NATS:.0f}"
            raise RecordingError(f"is not healthy scanning: {what}", str(self._path), _NOT_HEALTHY)

    def refuse_halt(self, status: Mapping[str, Any]) -> None:
        """Raises RecordingError where a fault of the calibration had halted the service. status: that of the service
        when the box was recorded. Verdicts alone would miss a fault that the file holds only in part, because the
        recorder was too slow for the rest: it lasts less than a second there.
        """
        if status.get("state") not in _HALTED or not _is_wrong(status.get("fault")):
            return
        what = f"is not healthy scanning: the service said {status['state']}, {status['fault']}"
        raise RecordingError(f"{what}, {status.get('reason')}", str(self._path), _NOT_HEALTHY)

    def _refuse_faults(self, verdict: Verdict) -> None:
        fault = verdict.fault
        if fault is None or not _is_wrong(fault):
            self._faulty = None
            return
        before, since_ns = self._faulty or (fault, verdict.t_ns)
        self._faulty = fault, since_ns if before is fault else verdict.t_ns
        if verdict.t_ns - self._faulty[1] >= _LASTING_NS:
            what = f"is not healthy scanning: {fault}, {verdict.reason}"
            raise RecordingError(what, str(self._path), _NOT_HEALTHY)


def heard_in_sequence(
    path: Path, calibration: Path, limits: Limits, stale_ns: int, watched: Watched, named: Named
) -> tuple[Heard, bool]:
    """Returns the peaks in a sequence, and whether its calibration is simulated. stale_ns: see EstimatorSettings.
    Raises RecordingError, ConfigurationError.
    """
    recording = open_recording(path, probe=named.probe, reference=named.reference, orientation=named.orientation)
    if recording.size_px is None:
        raise RecordingError("holds no pictures, so nothing was judged", str(path), _NOT_HEALTHY)
    tell_left_out(recording)
    nominal = read_calibration(calibration, recording.size_px, named.probe or "Probe")
    line, heard = _line(nominal, limits, stale_ns), Heard(path)
    for sample in watched(recording.samples()):
        heard.take(line.step(sample), line.nats)
    return heard, nominal.simulated


def heard_in_series(series: Series, limits: Limits, stale_ns: int) -> tuple[Heard, bool]:
    """Returns the peaks in a black box under the references then in force, and whether any of it is simulated.
    stale_ns: see EstimatorSettings. Raises RecordingError.
    """
    path = series.boxes[0].path
    if series.first_settings() is None:
        raise RecordingError("holds no reference that was in force, so nothing was judged", str(path), _NOT_HEALTHY)
    heard = Heard(path)
    rerun = Rerun(series, lambda reference, _limits, _stale_ns, _relative_pose: _line(reference, limits, stale_ns))
    for step in rerun.steps():
        if isinstance(step.item, LiveState):
            heard.refuse_halt(step.item.status)
        if isinstance(step.item, Frame | Pose) and isinstance(rerun.line, Line):
            heard.take(step.verdicts, rerun.line.nats)
    simulated = any(box.begun.simulated for box in series.boxes)
    return heard, simulated or any(settings.reference.simulated for settings in rerun.settings)


def _line(reference: Calibration, limits: Limits, stale_ns: int) -> Line:
    """Creates a pipeline with the highest threshold for naming, so that peaks are recorded in full."""
    return Line(reference, limits.model_copy(update={"named_nats": MOST_NAMED_NATS}), stale_ns)
