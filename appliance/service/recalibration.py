"""Which calibration is the reference while a person recalibrates, and what it returns to when he gives up."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from appliance.calibration_file import read_calibration
from appliance.service.control import ControlRefused
from appliance.service.errands import Errands
from appliance.service.estimator_host import EstimatorHost
from appliance.supervision.supervisor import Request, Supervisor
from appliance.types import Calibration, State

Ask = Callable[[Request], None]
"""Puts a request to the supervisor. Raises ControlRefused."""


class Recalibration:
    """Carries out what the supervisor grants."""

    def __init__(self, supervisor: Supervisor, estimator: EstimatorHost, ask: Ask, errands: Errands) -> None:
        self._supervisor, self._estimator, self._ask, self._errands = supervisor, estimator, ask, errands
        self._before = estimator.reference

    def begin(self) -> None:
        """Raises ControlRefused."""
        self._ask(Request.BEGIN_RECALIBRATION)

    def end(self, file: Path) -> None:
        """Take the file as the reference. Raises ControlRefused, ConfigurationError for the file."""
        refusal = self._supervisor.refusal(Request.END_RECALIBRATION)
        if refusal:
            raise ControlRefused(refusal)
        reference = self._read(file)
        self._ask(Request.END_RECALIBRATION)
        self._estimator.refer(reference)

    def propose(self, file: Path) -> dict[str, Any]:
        """How the calibration in the file differs from the reference; nothing changes. Raises ControlRefused,
        ConfigurationError for the file.
        """
        return difference(self._estimator.reference, self._read(file))

    def abort(self) -> None:
        """Back to the reference in force before. Raises ControlRefused."""
        self._ask(Request.ABORT_RECALIBRATION)

    def follow(self, before: State, after: State) -> None:
        """A reference that monitoring confirmed stays; whatever else ends a recalibration returns to the one before."""
        if after is State.MONITORING:
            self._before = self._estimator.reference
        elif before is State.RECALIBRATING and after is not State.RECALIBRATING:
            self._return()

    def _read(self, file: Path) -> Calibration:
        return self._errands.run(str(file), lambda: read_calibration(file))

    def _return(self) -> None:
        if self._estimator.reference is not self._before:
            self._estimator.refer(self._before)


def difference(reference: Calibration, proposed: Calibration) -> dict[str, Any]:
    """rotation_deg: angle between the two; scale_percent: (lateral, axial); offset_mm: distance; same_polarity."""
    turn = reference.rotation @ proposed.rotation.T
    cosine = (float(np.trace(turn)) - 1) / 2
    scale = proposed.scale_mm_per_px / reference.scale_mm_per_px - 1
    return {
        "rotation_deg": math.degrees(math.acos(min(max(cosine, -1.0), 1.0))),
        "scale_percent": [float(100 * change) for change in scale],
        "offset_mm": float(np.linalg.norm(proposed.offset_mm - reference.offset_mm)),
        "same_polarity": reference.polarity == proposed.polarity,
        "same_image_size": reference.image_size_px == proposed.image_size_px,
    }
