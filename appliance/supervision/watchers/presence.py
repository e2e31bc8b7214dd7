"""Raises a fault for outputs, scanner, tracker or estimator silent for longer than their timeout, counted from
the start.
"""

from probewatch.appliance.supervision.watchers.device_health import DeviceHealth, Timeouts, silence
from probewatch.appliance.types import Check, Fault, VerdictKind

REPORTS_FAULTS = (Fault.OUTPUT_FAILED, Fault.VIDEO_LOST, Fault.TRACKER_LOST, Fault.ESTIMATOR_SILENT)


def output_presence(now_ns: int, health: DeviceHealth, timeouts: Timeouts) -> Check:
    """output-failed when some output has completed no write for timeouts.output_ns: it cannot alarm."""
    return _presence(
        "output presence", Fault.OUTPUT_FAILED, now_ns, health.started_ns, health.output_ns, timeouts.output_ns
    )


def video_presence(now_ns: int, health: DeviceHealth, timeouts: Timeouts) -> Check:
    """video-lost when no picture has arrived for timeouts.video_ns."""
    return _presence("video presence", Fault.VIDEO_LOST, now_ns, health.started_ns, health.frame_ns, timeouts.video_ns)


def tracker_presence(now_ns: int, health: DeviceHealth, timeouts: Timeouts) -> Check:
    """tracker-lost when no reply for the probe's tool has come for timeouts.tracker_ns; one without a pose counts."""
    last_ns = health.replies.reply_ns
    return _presence("tracker presence", Fault.TRACKER_LOST, now_ns, health.started_ns, last_ns, timeouts.tracker_ns)


def estimator_presence(now_ns: int, health: DeviceHealth, timeouts: Timeouts) -> Check:
    """estimator-silent when no report of it has come for timeouts.estimator_ns, or its process has died.

    It speaks at least ten times a second, even when it has nothing to conclude.
    """
    last_ns = health.heartbeat_ns
    return _presence(
        "estimator presence", Fault.ESTIMATOR_SILENT, now_ns, health.started_ns, last_ns, timeouts.estimator_ns
    )


def _presence(name: str, fault: Fault, now_ns: int, started_ns: int, last_ns: int | None, limit_ns: int) -> Check:
    """What never came has failed; its age counts from the start."""
    if last_ns is None:
        return Check(name, fault, (now_ns - started_ns) / 1e6, 0.0, "ms", limit_ns / 1e6, VerdictKind.FAULT)
    return silence(name, fault, now_ns - last_ns, limit_ns)
