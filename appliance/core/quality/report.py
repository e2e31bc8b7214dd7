"""Builds the report on one recording, and its JSON form, which docs/replay-report.md promises to others."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

import numpy as np

from probewatch.appliance.core.handeye.observability import observability
from probewatch.appliance.core.handeye.second_opinion import SecondOpinion
from probewatch.appliance.core.path.solver import Follow
from probewatch.appliance.core.quality.check_fields import (
    check_fields,
    limits_fields,
    number_or_none,
    point_fields,
    rival_fields,
)
from probewatch.appliance.core.quality.proposal import Proposal, proposal_fields
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import PARAMETERS, Calibration, Check, Fault, State, Verdict, VerdictKind
from probewatch.drivers.rigid import vector_from_rotation

VERSION = 1

_ROTATION, _SCALE, _OFFSET = slice(0, 3), slice(3, 5), slice(5, 8)
"""Slices of PARAMETERS."""
_FEWEST = 10
"""Number of pictures with a pose, a third of a second of a scanner. No calibration was verified on fewer. More calls
recordings of slow devices unusable, fewer reports as not verified what could not have been.
"""


@dataclass(frozen=True, slots=True, eq=False)
class LineReport:
    """Holds what the line concludes from everything it was shown.

    unpaired: reason → number of frames without a pose. unusable: reason given by the reader → number of poses without a
    number, where they were counted. latency: Check in ms, None where never estimated. estimate: X as solved, None where
    nothing was observed. motions: registered pairs that went into it. second_opinion: by closed forms, without the
    reference. required: names of the checks that the contact asked for. proposal: what the wrong parameters have
    become, None where nothing is shown to be wrong. follow: that of the tissue on which the estimate rests. limits:
    those that were applied.
    """

    frames: int
    poses: int
    paired: int
    unpaired: dict[str, int]
    latency: Check | None
    estimate: Calibration | None
    motions: int
    checks: tuple[Check, ...]
    verdict: Verdict
    second_opinion: SecondOpinion | None = None
    required: tuple[str, ...] = ()
    proposal: Proposal | None = None
    unusable: dict[str, int] = field(default_factory=dict)
    follow: Follow | None = None
    limits: Limits = field(default_factory=Limits)

    @property
    def unusable_because(self) -> str:
        """Returns why nothing at all can be judged; empty where something can. A FAULT and an OK were judged."""
        if self.verdict.kind is not VerdictKind.NOT_VERIFIED or self.paired >= _FEWEST:
            return ""
        return self.verdict.reason if not self.paired else f"only {self.paired} pictures have a pose"

    @property
    def missing(self) -> tuple[str, ...]:
        """Returns the required parameters that nothing in the recording showed."""
        shown = {one.name for one in self.checks if one.verdict is VerdictKind.OK and isfinite(one.value)}
        return tuple(name for name in self.required if name not in shown)


@dataclass(frozen=True, slots=True)
class Change:
    """Represents a change to this state at t_s (seconds since the first sample of the recording)."""

    t_s: float
    state: State
    fault: Fault | None
    reason: str


def spells(changes: Sequence[Change], end_s: float) -> Iterator[tuple[Change, float]]:
    """Returns each change with the time, s, until which its state lasted; nothing where there was no change."""
    ends_s = [*(change.t_s for change in changes[1:]), end_s]
    return zip(changes, ends_s[: len(changes)], strict=True)


def report_json(report: LineReport, timeline: Sequence[Change]) -> dict[str, Any]:
    """Returns the public contract, version 1. What is not known is None; there is no NaN in it."""
    return {
        "version": VERSION,
        "frames": report.frames,
        "poses": report.poses,
        "paired": report.paired,
        "unpaired": dict(report.unpaired),
        "unusable_poses": dict(report.unusable),
        "latency": _latency(report.latency),
        "calibration": {**_calibration(report.estimate), "motions": report.motions},
        "tissue": _tissue(report.follow),
        "second_opinion": _second_opinion(report.second_opinion),
        "checks": [check_fields(report.verdict.t_ns, check) for check in report.checks],
        "verdict": report.verdict.kind.value,
        "fault": report.verdict.fault,
        "proposal": None if report.proposal is None else proposal_fields(report.proposal),
        "limits": limits_fields(report.limits),
        "point": point_fields(report.verdict.t_ns, report.verdict.point, report.limits.region),
        "rivals": rival_fields(report.verdict.t_ns, report.verdict.rivals),
        "timeline": [{"t_s": change.t_s, "state": change.state.value, "reason": change.reason} for change in timeline],
    }


def _numbers(values: Sequence[float]) -> list[float | None]:
    return [number_or_none(value) for value in values]


def _latency(check: Check | None) -> dict[str, Any]:
    if check is None:
        return {"value_ms": None, "sigma_ms": None, "verdict": VerdictKind.NOT_VERIFIED.value}
    return {
        "value_ms": number_or_none(check.value),
        "sigma_ms": number_or_none(check.sigma),
        "verdict": check.verdict.value,
    }


def _calibration(estimate: Calibration | None) -> dict[str, Any]:
    observed = (False,) * len(PARAMETERS) if estimate is None else estimate.observed
    return {
        "rotation_vector_rad": None if estimate is None else _numbers(list(vector_from_rotation(estimate.rotation))),
        "polarity": None if estimate is None else list(estimate.polarity),
        "scale_mm_per_px": None if estimate is None else _numbers(list(estimate.scale_mm_per_px)),
        "offset_mm": None if estimate is None else _numbers(list(estimate.offset_mm)),
        "sigma": _sigma(estimate),
        "singular_values": _singular_values(estimate),
        "observed": {
            "rotation_vector_rad": [bool(seen) for seen in observed[_ROTATION]],
            "scale_mm_per_px": [bool(seen) for seen in observed[_SCALE]],
            "offset_mm": [bool(seen) for seen in observed[_OFFSET]],
        },
    }


def _tissue(follow: Follow | None) -> dict[str, float | None] | None:
    if follow is None:
        return None
    return {"follows": number_or_none(follow.share), "sigma": number_or_none(follow.sigma)}


def _singular_values(estimate: Calibration | None) -> list[float | None] | None:
    if estimate is None or estimate.covariance is None:
        return None
    return _numbers(list(observability(np.asarray(np.linalg.inv(estimate.covariance), dtype=np.float64)).singular))


def _second_opinion(opinion: SecondOpinion | None) -> dict[str, Any] | None:
    if opinion is None:
        return None
    sigma = opinion.sigma.copy()
    sigma[3:] *= opinion.scale_mm_per_px
    return {
        "form": opinion.form,
        "rotation_vector_rad": _numbers(list(vector_from_rotation(opinion.rotation))),
        "polarity": list(opinion.polarity),
        "scale_mm_per_px": _numbers(list(opinion.scale_mm_per_px)),
        "sigma": {"rotation_vector_rad": _numbers(list(sigma[:3])), "scale_mm_per_px": _numbers(list(sigma[3:]))},
        "pairs": opinion.pairs,
    }


def _sigma(estimate: Calibration | None) -> dict[str, list[float | None]]:
    """Returns standard deviations in the unit of the value beside them; null where a parameter was not observed."""
    sigma = np.full(len(PARAMETERS), np.nan)
    if estimate is not None and estimate.covariance is not None:
        sigma = np.where(estimate.observed, np.sqrt(np.diag(estimate.covariance)), np.nan)
        sigma[_SCALE] *= estimate.scale_mm_per_px
    return {
        "rotation_vector_rad": _numbers(list(sigma[_ROTATION])),
        "scale_mm_per_px": _numbers(list(sigma[_SCALE])),
        "offset_mm": _numbers(list(sigma[_OFFSET])),
    }
