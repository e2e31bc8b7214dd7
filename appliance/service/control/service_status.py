"""Assembles the whole status of the service from what each part knows."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from probewatch.appliance.core.quality.gesture import Gesture, gestures
from probewatch.appliance.core.quality.shown import Shown
from probewatch.appliance.service.control.hold import Hold
from probewatch.appliance.service.control.live_configuration import LiveConfiguration
from probewatch.appliance.service.control.proposals import Proposals
from probewatch.appliance.service.control.references import References
from probewatch.appliance.service.control.server import Peer
from probewatch.appliance.service.control.status import (
    ages_at_rest,
    alarm_fields,
    audio_fields,
    check_lists,
    log_fields,
    origin_fields,
    output_fields,
    point_known,
    shown_of_each,
)
from probewatch.appliance.service.control.supervision import Supervision
from probewatch.appliance.service.devices.cart_devices import CartDevices
from probewatch.appliance.service.estimator.process_host import EstimatorHost
from probewatch.appliance.service.feed.process_host import FeedHost
from probewatch.appliance.service.host.host_watch import HostWatch
from probewatch.appliance.service.host.recorder import Recorder
from probewatch.appliance.supervision.annunciator import Annunciator
from probewatch.appliance.types import AlarmState, State
from probewatch.drivers.device_api import BUMPED


class ServiceStatus:
    """Assembles the status. dropped_clients: number of clients that the control server has dropped."""

    def __init__(
        self,
        supervision: Supervision,
        configuration: LiveConfiguration,
        references: References,
        annunciator: Annunciator,
        devices: CartDevices,
        estimator: EstimatorHost,
        recorder: Recorder,
        host: HostWatch,
        feed: FeedHost,
        hold: Hold,
        proposals: Proposals,
        dropped_clients: Callable[[], int],
    ) -> None:
        self._supervision, self._configuration, self._references = supervision, configuration, references
        self._annunciator, self._devices, self._estimator = annunciator, devices, estimator
        self._recorder, self._host, self._feed, self._dropped_clients = recorder, host, feed, dropped_clients
        self._hold, self._proposals = hold, proposals

    def fields(self, peer: Peer) -> dict[str, Any]:
        """Returns the fields that docs/control.md describes, for this peer."""
        now_ns, seen, config = self._supervision.now_ns, self._supervision, self._configuration.config
        assert seen.alarm is not None
        testing = self._annunciator.testing(now_ns)
        most_ns = config.supervisor.durations().max_verification_age_ns
        ages_ns = ages_at_rest(seen.verdict, config.required_ages_ns, most_ns)
        shown_now = shown_of_each(now_ns, seen.alarm, seen.verdict, ages_ns)
        lacking = [name for name, one in shown_now.items() if one is Shown.MISSING]
        rivals = () if seen.verdict is None else seen.verdict.rivals
        asked = gestures([rival.check.name for rival in rivals] or lacking)
        return {
            "t_ns": now_ns,
            **self._alarm_fields(seen.alarm, asked, shown_now),
            **origin_fields(config, self._configuration.file, self._references),
            "recalibration": self._hold.fields(peer, now_ns, seen.recalibrating, seen.alarm.state is State.MONITORING),
            "language": config.alarm.language,
            "missing": lacking,
            **check_lists(now_ns, seen.verdict, seen.devices, ages_ns, shown_now),
            **point_known(now_ns, seen.alarm, seen.verdict, config.limits, most_ns),
            "proposal": self._proposals.fields(config.alarm.language),
            "audio": audio_fields(now_ns, self._annunciator.sound, testing),
            "outputs": output_fields(self._devices.outputs),
            "log": log_fields(self._recorder),
            "lost": self._devices.lost,
            "losses": self._devices.losses_by_role,
            "alarms": dict(seen.alarms),
            "estimator": self._estimator.ended,
            "feed": {"refused": self._feed.refused, **self._feed.counts._asdict()},
            "remarks": list(self._devices.tracker.remarks),
            "fps": self._devices.fps,
            **self._host.fields(now_ns),
            "counters": self._counters(),
        }

    def _alarm_fields(
        self, alarm: AlarmState, asked: Sequence[Gesture], shown_now: Mapping[str, Shown]
    ) -> dict[str, Any]:
        config = self._configuration.config
        return alarm_fields(
            self._supervision.now_ns,
            alarm,
            config.alarm.language,
            config.simulated,
            asked,
            shown_now,
            self._references.next_step,
            bumped=any(BUMPED in remark for remark in self._devices.tracker.remarks),
            beyond_url=self._proposals.beyond_url,
            scans=self._hold.scans,
        )

    def _counters(self) -> dict[str, int]:
        video, tracker, word = self._devices.video, self._devices.tracker, self._estimator.last
        return {
            "uptime_s": (self._supervision.now_ns - self._supervision.started_ns) // 1_000_000_000,
            "frames": video.samples,
            "poses": tracker.samples,
            "frame_gaps": video.gaps,
            "early_stamps": video.early_stamps + tracker.early_stamps,
            "dropped_frames": 0 if word is None else word.dropped_frames,
            "dropped_poses": 0 if word is None else word.dropped_poses,
            "output_writes": self._devices.writes,
            "device_losses": self._devices.losses,
            "estimator_restarts": max(0, self._estimator.restarts),
            "dropped_clients": self._dropped_clients(),
            "late_ticks": self._host.ticks.late,
        }
