"""Each device watcher at its bound, and the alarm table's totality."""

from dataclasses import replace
from math import isnan
from typing import Any

import pytest

from probewatch.appliance.limits import Limits
from probewatch.appliance.supervision.device_health import DeviceHealth, Replies, Timeouts
from probewatch.appliance.supervision.device_watchers import watch_devices
from probewatch.appliance.types import Fault, Kind, VerdictKind
from probewatch.drivers.samples import MarkerBody, PoseStatus

NOW_NS = 1_000_000_000_000
TIMEOUTS, LIMITS = Timeouts(), Limits()
HEALTHY = DeviceHealth(
    started_ns=0,
    frame_ns=NOW_NS,
    replies=Replies(reply_ns=NOW_NS, fresh_ns=NOW_NS, pose_ns=NOW_NS, status=PoseStatus.OK),
    heartbeat_ns=NOW_NS,
    output_ns=NOW_NS,
)


def failing(health: DeviceHealth) -> dict[str, VerdictKind]:
    checks = watch_devices(NOW_NS, health, TIMEOUTS, LIMITS)
    told = (check for check in checks if not isnan(check.value))
    return {check.fault: check.verdict for check in told if check.verdict is not VerdictKind.OK}


def test_a_healthy_cart_fails_nothing() -> None:
    assert failing(HEALTHY) == {}


def test_a_calibration_whose_date_has_passed_is_a_notice_that_opens_nothing() -> None:
    assert failing(replace(HEALTHY, calibration_overdue=True)) == {"calibration-due": VerdictKind.FAULT}
    assert Fault.CALIBRATION_DUE.kind is Kind.ADVISORY


@pytest.mark.parametrize(
    ("field", "limit_ns", "fault"),
    [
        ("frame_ns", TIMEOUTS.video_ns, "video-lost"),
        ("heartbeat_ns", TIMEOUTS.estimator_ns, "estimator-silent"),
        ("output_ns", TIMEOUTS.output_ns, "output-failed"),
    ],
)
def test_silence_fails_one_nanosecond_past_its_bound(field: str, limit_ns: int, fault: str) -> None:
    at_bound = replace(HEALTHY, **{field: NOW_NS - limit_ns})
    assert failing(at_bound) == {}
    assert failing(replace(HEALTHY, **{field: NOW_NS - limit_ns - 1})) == {fault: VerdictKind.FAULT}
    assert failing(replace(HEALTHY, **{field: None})) == {fault: VerdictKind.FAULT}, "what never came has failed"
    (check,) = [check for check in watch_devices(NOW_NS, at_bound, TIMEOUTS) if check.fault == fault]
    assert check.ratio == 1.0


def replying(**told: Any) -> DeviceHealth:
    """HEALTHY but for what the tracker's replies have told."""
    return replace(HEALTHY, replies=replace(HEALTHY.replies, **told))


def test_a_silent_tracker_fails_one_nanosecond_past_its_bound() -> None:
    at_bound = replying(reply_ns=NOW_NS - TIMEOUTS.tracker_ns)
    assert failing(at_bound) == {}
    lost = {"tracker-lost": VerdictKind.FAULT}
    assert failing(replying(reply_ns=NOW_NS - TIMEOUTS.tracker_ns - 1)) == lost
    assert failing(replying(reply_ns=None)) == lost, "what never came has failed"


def test_stale_replies_fail_only_when_they_last() -> None:
    stale = replying(status=PoseStatus.STALE, fresh_ns=NOW_NS - TIMEOUTS.stale_ns)
    assert failing(stale) == {}
    older = replying(status=PoseStatus.STALE, fresh_ns=NOW_NS - TIMEOUTS.stale_ns - 1)
    assert failing(older) == {"tracker-stale": VerdictKind.FAULT}


def test_complaints_of_the_tracker_fail_only_when_they_last() -> None:
    complaining = replying(status=PoseStatus.FAULT, fresh_ns=NOW_NS - TIMEOUTS.tracker_ns)
    assert failing(complaining) == {}
    longer = replying(status=PoseStatus.FAULT, fresh_ns=NOW_NS - TIMEOUTS.tracker_ns - 1)
    assert failing(longer) == {"tracker-alert": VerdictKind.FAULT}


def test_a_pose_that_is_none_is_not_verified_and_no_fault_of_the_tracker() -> None:
    odd = replying(status=PoseStatus.NOT_UNDERSTOOD, pose_ns=NOW_NS - TIMEOUTS.tracker_ns)
    assert failing(odd) == {}
    longer = replying(status=PoseStatus.NOT_UNDERSTOOD, pose_ns=NOW_NS - TIMEOUTS.tracker_ns - 1)
    assert failing(longer) == {"pose-unusable": VerdictKind.NOT_VERIFIED}


@pytest.mark.parametrize(
    ("figure", "limit", "fault"),
    [
        ("fit_mm", LIMITS.marker_fit_mm, "marker-body"),
        ("shape_mm", LIMITS.marker_shape_mm, "marker-body"),
        ("indicator", LIMITS.field_indicator, "field-distortion"),
    ],
)
def test_a_bad_marker_body_or_field_fails_beyond_its_limit(figure: str, limit: float, fault: str) -> None:
    assert failing(replace(HEALTHY, body=MarkerBody(**{figure: limit}))) == {}
    assert failing(replace(HEALTHY, body=MarkerBody(**{figure: limit * 1.001}))) == {fault: VerdictKind.FAULT}
    untold = watch_devices(NOW_NS, replace(HEALTHY, body=MarkerBody()), TIMEOUTS, LIMITS)
    figures = [check for check in untold if check.fault in ("marker-body", "field-distortion")]
    assert {(check.verdict, isnan(check.value)) for check in figures} == {(VerdictKind.NOT_VERIFIED, True)}


@pytest.mark.parametrize("status", [PoseStatus.MISSING, PoseStatus.OUT_OF_VOLUME, PoseStatus.PARTIAL])
def test_a_hidden_probe_is_not_verified_and_no_fault(status: PoseStatus) -> None:
    hidden = replying(status=status, pose_ns=NOW_NS - TIMEOUTS.out_of_sight_ns)
    assert failing(hidden) == {}
    assert failing(replying(status=status, pose_ns=NOW_NS - TIMEOUTS.out_of_sight_ns - 1)) == {
        "line-of-sight": VerdictKind.NOT_VERIFIED
    }


def test_nothing_has_failed_for_longer_than_the_service_runs() -> None:
    checks = watch_devices(NOW_NS, DeviceHealth(started_ns=NOW_NS - 7_000_000), TIMEOUTS)
    assert max(check.value for check in checks) == 7.0


def test_every_watcher_has_a_row_in_the_alarm_table() -> None:
    for check in watch_devices(NOW_NS, HEALTHY, TIMEOUTS):
        assert check.fault.kind is not Kind.CALIBRATION


def test_damage_is_an_alarm_and_a_slow_disk_an_advisory() -> None:
    assert failing(replace(HEALTHY, damage=("memory-damaged", "log-damaged"))) == {"memory-damaged": VerdictKind.FAULT}
    waits = replace(HEALTHY, log_waits_ns=TIMEOUTS.log_ns)
    assert failing(waits) == {}
    assert failing(replace(waits, log_waits_ns=TIMEOUTS.log_ns + 1)) == {"log-not-written": VerdictKind.FAULT}
    assert Fault.LOG_NOT_WRITTEN.kind is Kind.ADVISORY
