"""Which calibration is the reference while a person recalibrates, and what it returns to when he gives up."""

from collections.abc import Callable
from pathlib import Path

from appliance.calibration_file import read_calibration
from appliance.service.control import ControlRefused
from appliance.service.estimator_host import EstimatorHost
from appliance.supervision.supervisor import Request, Supervisor
from appliance.types import State

Ask = Callable[[Request], None]
"""Puts a request to the supervisor. Raises ControlRefused."""


class Recalibration:
    """Carries out what the supervisor grants."""

    def __init__(self, supervisor: Supervisor, estimator: EstimatorHost, ask: Ask) -> None:
        self._supervisor, self._estimator, self._ask = supervisor, estimator, ask
        self._before = estimator.reference

    def begin(self) -> None:
        """Raises ControlRefused."""
        self._ask(Request.BEGIN_RECALIBRATION)

    def end(self, file: Path) -> None:
        """Take the file as the reference. Raises ControlRefused, ConfigurationError for the file."""
        refusal = self._supervisor.refusal(Request.END_RECALIBRATION)
        if refusal:
            raise ControlRefused(refusal)
        reference = read_calibration(file)
        self._ask(Request.END_RECALIBRATION)
        self._estimator.refer(reference)

    def abort(self) -> None:
        """Back to the reference in force before. Raises ControlRefused."""
        self._ask(Request.ABORT_RECALIBRATION)
        self._return()

    def follow(self, before: State, after: State) -> None:
        """A reference that monitoring confirmed stays; one that a lost device kept from being confirmed does not."""
        if after is State.MONITORING:
            self._before = self._estimator.reference
        elif before is State.RECALIBRATING and after is State.DEVICE_LOST:
            self._return()

    def _return(self) -> None:
        if self._estimator.reference is not self._before:
            self._estimator.refer(self._before)
