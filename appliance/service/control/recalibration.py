"""Decides which calibration is the reference during a recalibration, and which one follows if it is given up."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from probewatch.appliance.core.quality.calibration_difference import Difference, difference
from probewatch.appliance.limits import Limits
from probewatch.appliance.service.control.deadline_worker import DeadlineWorker
from probewatch.appliance.service.control.references import References
from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.service.estimator.process_host import EstimatorHost
from probewatch.appliance.storage.calibration_file import calibration_bytes
from probewatch.appliance.storage.reference import Candidate, Reference
from probewatch.appliance.storage.reference_store import FROM_FILE, RECALIBRATED
from probewatch.appliance.supervision.supervisor import Request, Supervisor
from probewatch.appliance.types import PARAMETERS, State

Ask = Callable[[Request], object]
"""Passes a request to the supervisor. Raises ControlRefused."""

_EVERYTHING = ("polarity", *PARAMETERS)
_COMPARED = (
    "rotation_deg", "scale_percent", "offset_mm", "offset_along_mm", "same_polarity", "same_image_size",
)  # fmt: skip
"""Fields of a proposal that need a reference to compare with."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """Names what a person wants as the reference: a file, or the number of an earlier one. confirm: the difference from
    the one in force, as the proposal states it; empty where the person did not accept it. sha256: that of the proposed
    file; empty accepts whatever the file holds now. who: the person who asks. scanned: a scan in this recalibration has
    made the file; False for a file that existed before.
    """

    file: Path | None = None
    number: int | None = None
    confirm: str = ""
    sha256: str = ""
    who: str = ""
    scanned: bool = True


class Recalibration:
    """Carries out what the supervisor grants. took: called with every reference that comes into force."""

    def __init__(
        self,
        supervisor: Supervisor,
        estimator: EstimatorHost,
        references: References,
        ask: Ask,
        worker: DeadlineWorker,
        limits: Callable[[], Limits],
        took: Callable[[Reference], None],
    ) -> None:
        self._supervisor, self._estimator, self._references = supervisor, estimator, references
        self._ask, self._worker, self._limits, self._took = ask, worker, limits, took
        self._before: Reference | None = None
        self._doubted = False

    def begin(self) -> None:
        """Begins a recalibration. Raises ControlRefused."""
        self._ask(Request.BEGIN_RECALIBRATION)

    def propose(self, wanted: Wanted) -> dict[str, Any]:
        """Returns how the wanted calibration differs from the reference. Raises ControlRefused, ConfigurationError."""
        candidate = self._candidate(wanted)
        change = self._change(candidate)
        if change is None:
            text = "the first calibration, with none before to compare it with"
            return {**dict.fromkeys(_COMPARED), "text": text, "confirm": False, "sha256": candidate.sha256}
        asked = self._must_confirm(wanted, change)
        return {**change.fields(), "text": change.text, "confirm": asked, "sha256": candidate.sha256}

    def end(self, wanted: Wanted) -> None:
        """Takes the wanted calibration as the reference. Raises ControlRefused, also for a difference that no person
        has confirmed, and ConfigurationError for the file.
        """
        refusal = self._supervisor.refusal(Request.END_RECALIBRATION)
        if refusal:
            raise ControlRefused(refusal)
        candidate = self._candidate(wanted)
        if wanted.sha256 and wanted.sha256 != candidate.sha256:
            raise ControlRefused(
                "is not the file that was proposed", candidate.file, "Compare it anew, and accept that"
            )
        change = self._change(candidate)
        if change is not None and self._must_confirm(wanted, change) and wanted.confirm != change.text:
            what = f"differs from the reference in force: {change.text}"
            raise ControlRefused(what, candidate.file, "To accept that, repeat the difference: field confirm, or --yes")
        self._ask(Request.END_RECALIBRATION)
        self._take(candidate, self._origin(wanted, candidate), wanted.who, change)

    def abort(self) -> None:
        """Goes back to the reference that was in force before. Raises ControlRefused."""
        self._ask(Request.ABORT_RECALIBRATION)

    def follow(self, before: State, after: State) -> None:
        """Keeps a reference that monitoring confirmed; any other end of a recalibration returns to the one before."""
        if after is State.MONITORING:
            self._references.note_verified()
            self._before, self._doubted = self._references.current, False
        elif before is State.RECALIBRATING and after is not State.RECALIBRATING:
            self._return()
        self._take_up()

    def _take_up(self) -> None:
        """Puts the first reference into force in the estimator, once it has been read from the disk."""
        current = self._references.current
        if current is not None and self._estimator.reference is None:
            self._before = current
            entry = current.entry
            self._doubted = entry.verified_utc is None and (entry.number > 1 or bool(entry.to_show))
            self._refer(current)

    def _candidate(self, wanted: Wanted) -> Candidate:
        """Returns the wanted calibration. Only the reading waits for the disk."""
        file, number = wanted.file, wanted.number
        if number is not None:
            return self._worker.run(f"reference {number}", lambda: self._references.from_history(number))
        assert file is not None
        content = self._worker.run(str(file), lambda: calibration_bytes(file))
        return self._worker.run(str(file), lambda: self._references.from_content(content, str(file)))

    def _change(self, candidate: Candidate) -> Difference | None:
        current = self._references.current
        return None if current is None else difference(current.calibration, candidate.calibration)

    def _must_confirm(self, wanted: Wanted, change: Difference) -> bool:
        return wanted.number is not None or change.beyond(self._limits())

    def _take(
        self,
        candidate: Candidate,
        origin: str,
        who: str,
        change: Difference | None,
        relative_pose: tuple[float, ...] | None = None,
    ) -> None:
        far = change is None or change.beyond(self._limits()) or self._far_from_before(candidate)
        text = "" if change is None else change.text
        to_show = _EVERYTHING if far else ()
        self._refer(self._references.take(candidate, origin, who, text, to_show, relative_pose))

    def _origin(self, wanted: Wanted, candidate: Candidate) -> str:
        """Returns where the candidate came from, as the history states it."""
        if wanted.number is not None:
            return f"went back to {wanted.number}"
        if wanted.scanned:
            return RECALIBRATED
        same = [one.number for one in self._references.history.entries if one.sha256 == candidate.sha256]
        return f"{FROM_FILE} of reference {same[-1]}" if same else FROM_FILE

    def _far_from_before(self, candidate: Candidate) -> bool:
        """Returns whether the candidate is far from the reference that was verified last: several near ones in a row,
        none of which was verified, add up to a large difference. When none was verified yet, or the service started
        with an unverified one, it counts as far.
        """
        before = self._before
        if before is None or self._doubted:
            return True
        return difference(before.calibration, candidate.calibration).beyond(self._limits())

    def _refer(self, reference: Reference) -> None:
        self._estimator.set_reference(reference.calibration, reference.relative_pose)
        self._took(reference)

    def _return(self) -> None:
        """Goes back to the previous reference. The relative pose of a second marker body stays known, so that a slip in
        the meantime is reported, as after a restart.
        """
        before, current = self._before, self._references.current
        if before is not None and (current is None or before.entry.number != current.entry.number):
            number, change = before.entry.number, self._change(before.candidate)
            known = self._references.history.entry(number).relative_pose
            self._take(before.candidate, f"went back to {number}", "", change, known)
            self._before = self._references.current
