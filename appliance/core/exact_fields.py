"""Converts what a line takes and returns to JSON and back, bit for bit, for the feed and the black box.

Integers stay as they are, floats have the shortest digits that give the same double; a number that is not finite is a
string, "nan", "inf" or "-inf". Functions that read raise ValueError, KeyError, TypeError or AttributeError for anything
else.
"""

import math
from typing import Any

import numpy as np

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration, Check, Fault, PointError, Rival, Verdict, VerdictKind
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp

Header = dict[str, Any]


def settings_fields(settings: EstimatorSettings) -> Header:
    """Returns the fields of the settings that a line is made from."""
    return {
        "generation": settings.generation,
        "stale_ns": settings.stale_ns,
        "limits": settings.limits.model_dump(by_alias=True),
        "reference": calibration_fields(settings.reference),
        "relative_pose": None if settings.relative_pose is None else _numbers(settings.relative_pose),
    }


def calibration_fields(calibration: Calibration) -> Header:
    """Returns all fields of a calibration, the covariance row by row."""
    covariance = calibration.covariance
    return {
        "rotation": _numbers(calibration.rotation),
        "polarity": list(calibration.polarity),
        "scale_mm_per_px": _numbers(calibration.scale_mm_per_px),
        "offset_mm": _numbers(calibration.offset_mm),
        "image_size_px": list(calibration.image_size_px),
        "covariance": None if covariance is None else _numbers(covariance),
        "observed": list(calibration.observed),
        "simulated": calibration.simulated,
        "face_radius_mm": calibration.face_radius_mm,
    }


def verdict_fields(verdict: Verdict) -> Header:
    """Returns all fields of a verdict, with every check and rival."""
    return {
        "t_ns": verdict.t_ns,
        "verdict": verdict.kind.value,
        "fault": None if verdict.fault is None else verdict.fault.value,
        "reason": verdict.reason,
        "verified_ns": verdict.verified_ns,
        "expires_ns": verdict.expires_ns,
        "checks": [_check_fields(check) for check in verdict.checks],
        "rivals": [_rival_fields(rival) for rival in verdict.rivals],
        "point": None if verdict.point is None else _point_fields(verdict.point),
    }


def stamp_fields(sample: Frame | Pose) -> Header:
    """Returns when a sample was true, with the bound of its error, and the device's counter."""
    return {"t_ns": sample.stamp.t_ns, "err_ns": sample.stamp.err_ns, "sequence": sample.sequence}


def pose_fields(pose: Pose) -> Header:
    """Returns all fields of a pose."""
    return {
        **stamp_fields(pose),
        "status": pose.status.name,
        "matrix": None if pose.matrix is None else _numbers(pose.matrix),
        "rms_mm": _number(pose.rms_mm),
        "reason": pose.reason,
        "witness": None if pose.witness is None else _numbers(pose.witness),
    }


def settings_of(fields: Header) -> EstimatorSettings:
    """Reads settings; the inverse of settings_fields."""
    limits, relative_pose = Limits.model_validate(fields["limits"]), fields.get("relative_pose")
    return EstimatorSettings(
        integer(fields["generation"]),
        calibration_of(fields["reference"]),
        limits,
        integer(fields["stale_ns"]),
        None if relative_pose is None else _array(relative_pose, (4, 4)),
    )


def calibration_of(fields: Header) -> Calibration:
    """Reads a calibration; the inverse of calibration_fields."""
    covariance = fields["covariance"]
    lateral, axial = map(integer, fields["polarity"])
    width, height = map(integer, fields["image_size_px"])
    return Calibration(
        rotation=_array(fields["rotation"], (3, 3)),
        polarity=(lateral, axial),
        scale_mm_per_px=_array(fields["scale_mm_per_px"], (2,)),
        offset_mm=_array(fields["offset_mm"], (3,)),
        image_size_px=(width, height),
        covariance=None if covariance is None else _array(covariance, (8, 8)),
        observed=tuple(bool(one) for one in fields["observed"]),
        simulated=bool(fields["simulated"]),
        face_radius_mm=_number_or_none(fields.get("face_radius_mm")),
    )


def verdict_of(fields: Header) -> Verdict:
    """Reads a verdict; the inverse of verdict_fields."""
    return Verdict(
        t_ns=integer(fields["t_ns"]),
        kind=VerdictKind(fields["verdict"]),
        checks=tuple(_check(check) for check in fields["checks"]),
        fault=None if fields["fault"] is None else Fault(fields["fault"]),
        reason=str(fields["reason"]),
        verified_ns=_integer_or_none(fields["verified_ns"]),
        expires_ns=_integer_or_none(fields["expires_ns"]),
        rivals=tuple(Rival(_check(rival["check"]), float(rival["behind_nats"])) for rival in fields.get("rivals", ())),
        point=None if fields.get("point") is None else _point(fields["point"]),
    )


def stamp_of(fields: Header) -> Stamp:
    """Reads a stamp; the inverse of stamp_fields."""
    return Stamp(integer(fields["t_ns"]), integer(fields["err_ns"]))


def pose_of(fields: Header) -> Pose:
    """Reads a pose; the inverse of pose_fields."""
    matrix, witness = fields["matrix"], fields.get("witness")
    return Pose(
        stamp_of(fields),
        integer(fields["sequence"]),
        None if matrix is None else _array(matrix, (4, 4)),
        float(fields["rms_mm"]),
        PoseStatus[fields["status"]],
        str(fields["reason"]),
        None if witness is None else _array(witness, (4, 4)),
    )


def integer(value: Any) -> int:
    """Returns the same number. Raises ValueError where it is not a whole number; a flag is none."""
    if not isinstance(value, int) or isinstance(value, bool):
        raise ValueError(f"{value!r} is not a whole number")
    return value


def _check_fields(check: Check) -> Header:
    return {
        "name": check.name,
        "fault": check.fault.value,
        "value": _number(check.value),
        "sigma": _number(check.sigma),
        "unit": check.unit,
        "limit": _number(check.limit),
        "verdict": check.verdict.value,
        "shown_ns": check.shown_ns,
        "rested_ns": check.rested_ns,
    }


def _rival_fields(rival: Rival) -> Header:
    return {"check": _check_fields(rival.check), "behind_nats": _number(rival.behind_nats)}


def _point_fields(point: PointError) -> Header:
    deep = point.at_depth_mm
    return {
        "worst_mm": _numbers(point.worst_mm),
        "median_mm": _numbers(point.median_mm),
        "depth_mm": None if point.depth_mm is None else _number(point.depth_mm),
        "at_depth_mm": None if deep is None else _numbers(deep),
        "shown_ns": point.shown_ns,
        "region_mm": _numbers(point.region_mm),
    }


def _point(fields: Header) -> PointError:
    depth, deep = fields["depth_mm"], fields["at_depth_mm"]
    return PointError(
        worst_mm=_pair(fields["worst_mm"]),
        median_mm=_pair(fields["median_mm"]),
        depth_mm=None if depth is None else float(depth),
        at_depth_mm=None if deep is None else _pair(deep),
        shown_ns=integer(fields["shown_ns"]),
        region_mm=tuple(float(bound) for bound in fields.get("region_mm", ())),
    )


def _pair(values: list[Any]) -> tuple[float, float]:
    narrow, wide = map(float, values)
    return narrow, wide


def _check(fields: Header) -> Check:
    return Check(
        name=str(fields["name"]),
        fault=Fault(fields["fault"]),
        value=float(fields["value"]),
        sigma=float(fields["sigma"]),
        unit=str(fields["unit"]),
        limit=float(fields["limit"]),
        verdict=VerdictKind(fields["verdict"]),
        shown_ns=_integer_or_none(fields["shown_ns"]),
        rested_ns=integer(fields.get("rested_ns", 0)),
    )


def _number(value: float) -> float | str:
    value = float(value)
    return value if math.isfinite(value) else str(value)


def _numbers(values: Any) -> list[float | str]:
    return [_number(value) for value in np.asarray(values, np.float64).ravel().tolist()]


def _array(values: list[Any], shape: tuple[int, ...]) -> Any:
    return np.array([float(value) for value in values], np.float64).reshape(shape)


def _number_or_none(value: Any) -> float | None:
    return None if value is None else float(value)


def _integer_or_none(value: Any) -> int | None:
    return None if value is None else integer(value)
