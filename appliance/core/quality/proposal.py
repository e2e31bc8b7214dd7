"""Proposes new calibration values where motion shows that the calibration is wrong. A person decides; nothing is
applied.

As in the paper, registration and tracker recover rotation, in-plane offset and latency without a phantom; a scale or
the offset across the picture (ζ) requires a recalibration.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import Enum
from math import isfinite
from typing import Any

import numpy as np

from probewatch.appliance.core.parameters import MEASURED, PER_UNIT, QUANTITIES
from probewatch.appliance.types import PARAMETERS, Calibration, Check, Fault, VerdictKind

RECOVERED = frozenset({*PARAMETERS[:3], "offset-lateral", "offset-axial"})
"""Parameters of X that motion recovers without a phantom."""
LATENCIES_MS = (0.0, 500.0)
"""Bounds, ms, of latency_ms in the tracker's URL. Beyond them nothing that a URL states makes up for the latency."""
NO_SUCH_LATENCY = (
    f"latency_ms takes {LATENCIES_MS[0]:g} to {LATENCIES_MS[1]:g} ms: "
    "check frame rate, stamps and whose calibration is in force"
)
"""Clause of the proposal's text in place of a step that sets such a latency."""


class Step(Enum):
    """Names the action that follows from a proposal; the value is its name in JSON."""

    SET_LATENCY = "set-latency"
    TAKE_X = "take-x"
    RECALIBRATE = "recalibrate"


@dataclass(frozen=True, slots=True)
class NewValue:
    """Holds the new value of a parameter that is shown to be wrong. `was` and `now` are, for rotations, angles about
    the picture's axes from the reference, deg; for scales mm/px; for offsets mm; for the latency ms, as the tracker's
    URL states it and as it should state it.
    """

    name: str
    was: float
    now: float
    sigma: float
    unit: str

    @property
    def text(self) -> str:
        """Returns the change as one clause."""
        digits = 4 if self.unit == "mm/px" else 1
        now, sigma, was = (f"{number:.{digits}f}" for number in (self.now, self.sigma, self.was))
        return f"{self.name} is now {now} ± {sigma} {self.unit}, was {was} {self.unit}"


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """Holds a proposal. `values` lists what is wrong, `steps` the actions. `calibration` is the reference with every
    part of X that motion recovers; None where X is not the only thing wrong with it.
    """

    values: tuple[NewValue, ...]
    steps: tuple[Step, ...]
    calibration: Calibration | None

    @property
    def about(self) -> tuple[str, ...]:
        """Returns the names of the parameters that are wrong."""
        return tuple(value.name for value in self.values)

    @property
    def text(self) -> str:
        """Returns the proposal as one English sentence of clauses."""
        step_texts = {
            Step.SET_LATENCY: f"set latency_ms={self.values[0].now:.0f} in the tracker's URL and restart the service",
            Step.TAKE_X: "write it with 'probewatch calibration recover' and take it with 'probewatch calibration use'",
            Step.RECALIBRATE: "motion alone does not recover this: recalibrate with 'probewatch recalibrate --live'",
        }
        clauses = [*(value.text for value in self.values), *(step_texts[step] for step in self.steps)]
        return "; ".join([*clauses, NO_SUCH_LATENCY] if self.is_beyond_url else clauses)

    @property
    def is_beyond_url(self) -> bool:
        """Returns whether a latency is wrong that the tracker's URL cannot state."""
        return self.about == (Fault.LATENCY.value,) and not self.steps


def propose(checks: Sequence[Check], reference: Calibration, latency_ms: float) -> Proposal | None:
    """Returns the proposal; None where motion shows no parameter to be wrong, or where the picture is mirrored or the
    tracker's field looks distorted, so that no parameter is known.

    A latency is proposed first and alone, because what a late tracker shows of X is wrong. `latency_ms` is the value
    stated in the tracker's URL.
    """
    wrong = {check.name: check for check in checks if check.name in MEASURED and _shown_wrong(check)}
    mirrored = any(check.fault is Fault.POLARITY and check.verdict is VerdictKind.FAULT for check in checks)
    if not wrong or mirrored or any(check.fault is Fault.FIELD_DISTORTION for check in checks):
        return None
    late = wrong.get(Fault.LATENCY.value)
    if late is not None:
        now_ms = latency_ms + late.value
        steps = (Step.SET_LATENCY,) if LATENCIES_MS[0] <= round(now_ms) <= LATENCIES_MS[1] else ()
        return Proposal((NewValue(late.name, latency_ms, now_ms, late.sigma, late.unit),), steps, None)
    values = tuple(_new_value(check, reference) for check in wrong.values())
    if wrong.keys() <= RECOVERED:
        return Proposal(values, (Step.TAKE_X,), _recovered(checks, reference))
    return Proposal(values, (Step.RECALIBRATE,), None)


def proposal_fields(proposal: Proposal) -> dict[str, Any]:
    """Returns the proposal, in English, ready for JSON."""
    return {
        "text": proposal.text,
        "values": [asdict(value) for value in proposal.values],
        "steps": [step.value for step in proposal.steps],
    }


def _shown_wrong(check: Check) -> bool:
    return check.verdict is VerdictKind.FAULT and isfinite(check.value) and check.sigma > 0


def _new_value(check: Check, reference: Calibration) -> NewValue:
    index = PARAMETERS.index(check.name)
    if check.fault is Fault.SCALE:
        was = float(reference.scale_mm_per_px[index - 3])
        share = QUANTITIES[Fault.SCALE].per_unit
        return NewValue(check.name, was, was * (1 + check.value / share), was * check.sigma / share, "mm/px")
    was = float(reference.offset_mm[index - 5]) if check.fault is Fault.OFFSET else 0.0
    return NewValue(check.name, was, was + check.value, check.sigma, check.unit)


def _recovered(checks: Sequence[Check], reference: Calibration) -> Calibration:
    """Returns the calibration with the recovered values; parameters that were not measured, or that motion does not
    recover, keep those of the reference.
    """
    measured = {check.name: check.value for check in checks if check.name in RECOVERED and isfinite(check.value)}
    change = np.array([measured.get(name, 0.0) for name in PARAMETERS]) / PER_UNIT[: len(PARAMETERS)]
    return reference.changed(change)
