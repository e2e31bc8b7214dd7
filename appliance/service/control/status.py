"""Builds the status of the control socket: plain numbers and words, NaN as null; docs/control.md has every field."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from probewatch.appliance.configuration.config import Config
from probewatch.appliance.core.quality.check_fields import check_fields, limits_fields, point_fields, rival_fields
from probewatch.appliance.core.quality.gesture import Gesture
from probewatch.appliance.core.quality.shown import Shown, shown
from probewatch.appliance.limits import Limits
from probewatch.appliance.service.control.references import SOFTWARE, References
from probewatch.appliance.service.devices.output_thread import OutputThread
from probewatch.appliance.service.host.recorder import Recorder
from probewatch.appliance.storage.image_to_probe import image_to_probe
from probewatch.appliance.storage.reference import Reference
from probewatch.appliance.supervision.alarms import (
    CHECK_BUMPED,
    EARLIER,
    HAZARDS,
    NO_LATENCY,
    PARTLY_EARLIER,
    SIGNALS,
    operator_text,
)
from probewatch.appliance.supervision.audio import Sound
from probewatch.appliance.supervision.languages import translated
from probewatch.appliance.supervision.supervisor import LATCHED
from probewatch.appliance.types import AlarmState, Check, Fault, State, Verdict

NONE: Mapping[str, Shown] = MappingProxyType({})
_SIMULATED = {"en": "SIMULATED · ", "de": "SIMULIERT · "}
"""Precedes the text of every state while a source is not a real device."""


def origin_fields(config: Config, config_file: Path, references: References) -> dict[str, Any]:
    """Returns what the verdicts rest on: the software, its configuration, the reference in force, and which sources are
    real.

    reference: None while there is none; reference_waits says why.
    """
    current = references.current
    return {
        "software": SOFTWARE,
        "configuration": configuration_fields(config, config_file),
        "noise": noise_fields(config),
        "limits": limits_fields(config.limits),
        "reference": None if current is None else {**reference_fields(current), **_matrix_of(current)},
        "reference_due_utc": references.dates.due_utc,
        "reference_expires_utc": references.dates.expires_utc,
        "reference_overdue": references.overdue or None,
        "reference_waits": references.waits,
        "calibration_changed": references.changed,
        "simulated": [*config.simulated],
    }


def configuration_fields(config: Config, config_file: Path) -> dict[str, str]:
    """Returns the fields of the configuration in force."""
    return {"file": str(config_file.absolute()), "sha256": config.sha256}


def noise_fields(config: Config) -> dict[str, Any] | None:
    """Returns where the threshold of a name comes from; None for the one that probewatch ships with."""
    learned = config.learned_noise
    if learned is None:
        return None
    return {
        "file": str(config.noise.file),
        "sha256": learned.sha256,
        "named_nats": config.limits.named_nats,
        "hours": learned.hours,
        "recordings": len(learned.recording),
        "learned_utc": learned.learned_utc,
        "software": learned.software,
    }


def reference_fields(reference: Reference) -> dict[str, Any]:
    """Returns the fields that appliance.storage.reference_store.Entry describes."""
    return reference.entry.model_dump(mode="json")


def _matrix_of(reference: Reference) -> dict[str, Any]:
    """Returns the calibration as PLUS has it, and the signs that its matrix does not show."""
    calibration = reference.calibration
    return {"image_to_probe": image_to_probe(calibration).tolist(), "polarity": list(calibration.polarity)}


def alarm_fields(
    now_ns: int,
    alarm: AlarmState,
    language: str,
    simulated: Sequence[str] = (),
    wanted: Sequence[Gesture] = (),
    shown_now: Mapping[str, Shown] = NONE,
    next_step: str = "",
    bumped: bool = False,
    beyond_url: bool = False,
    scans: bool = False,
) -> dict[str, Any]:
    """Returns what is shown in the room, in its language. simulated: URLs of the sources that are not real devices.
    wanted: motion that is still required. shown_now: that of `shown_of_each`. next_step: of the reference, before which
    no motion helps. bumped: the tracker waits for a person to check its position sensor. beyond_url: the latency that
    motion shows is one that the tracker's URL cannot state. scans: a recalibration has not taken its calibration yet,
    so there is none that motion could show.
    """
    text, remedy = operator_text(alarm.state, alarm.fault, language, Fault.OVERLOADED in alarm.notices)
    text += _carried_by(alarm, shown_now, language)
    motions = [] if next_step else [translated(gesture.value, language) for gesture in wanted]
    waits = alarm.state is State.NOT_VERIFIED or (alarm.state is State.RECALIBRATING and not scans)
    shows = alarm.fault is None if waits else alarm.fault is Fault.UNDECIDED
    if shows and motions:
        remedy = "; ".join([translated("Probe on tissue", language), *motions])
    signal, reason = SIGNALS[alarm.state], alarm.reason
    if shows and next_step:
        remedy = translated(next_step, language)
        reason = next_step if reason == signal.remedy else reason
    if beyond_url and alarm.fault is Fault.LATENCY:
        remedy = translated(NO_LATENCY, language)
    if bumped and (alarm.state in LATCHED or alarm.fault is Fault.TRACKER_ALERT):
        remedy = translated(CHECK_BUMPED, language)
    return {
        "state": alarm.state.value,
        "text": f"{_SIMULATED[language] if simulated else ''}{text}",
        "remedy": remedy,
        "fault": alarm.fault,
        "reason": reason,
        "priority": signal.priority.value,
        "lamp": signal.lamp.value,
        "energised": alarm.energised,
        "latched": None if alarm.latched is None else alarm.latched.value,
        "acknowledged": alarm.acknowledged,
        "gesture": motions,
        "notices": [translated(HAZARDS[fault].text, language) for fault in alarm.notices],
        "since_s": (now_ns - alarm.since_ns) / 1e9,
        "verification_age_s": None if alarm.verified_ns is None else (now_ns - alarm.verified_ns) / 1e9,
    }


def _carried_by(alarm: AlarmState, shown_now: Mapping[str, Shown], language: str) -> str:
    """Returns the addition to the text of a verified calibration that does not rest on the present motion alone."""
    carried = [one is Shown.CARRIED for one in shown_now.values()]
    if alarm.state is not State.MONITORING or not any(carried):
        return ""
    return f" · {translated(EARLIER if all(carried) else PARTLY_EARLIER, language)}"


def ages_at_rest(verdict: Verdict | None, ages_ns: Mapping[str, int], most_ns: int) -> dict[str, int]:
    """Returns the ages plus the time that the probe has rested since, up to most_ns: max_verification_age."""
    rested_ns = {check.name: check.rested_ns for check in (() if verdict is None else verdict.checks)}
    return {name: min(age_ns + rested_ns.get(name, 0), most_ns) for name, age_ns in ages_ns.items()}


def shown_of_each(
    now_ns: int, alarm: AlarmState, verdict: Verdict | None, ages_ns: Mapping[str, int]
) -> dict[str, Shown]:
    """Returns how each required parameter was shown. What was shown before the last disturbance, or too long ago, is
    missing.

    ages_ns: for each parameter, how old the motion that showed it may be.
    """
    checks = {check.name: check for check in (() if verdict is None else verdict.checks)}
    return {
        name: shown(checks.get(name), now_ns, max(alarm.barrier_ns + 1, now_ns - age_ns))
        for name, age_ns in ages_ns.items()
    }


def check_lists(
    now_ns: int,
    verdict: Verdict | None,
    devices: tuple[Check, ...],
    ages_ns: Mapping[str, int] = MappingProxyType({}),
    shown_now: Mapping[str, Shown] = NONE,
) -> dict[str, Any]:
    """Returns what the line and the device watchers see. ages_ns, shown_now: as in `shown_of_each`."""
    seen = () if verdict is None else verdict.checks
    return {
        "verdict": None if verdict is None else verdict.kind.value,
        "checks": [_line_check(now_ns, check, ages_ns.get(check.name), shown_now.get(check.name)) for check in seen],
        "devices": [check_fields(now_ns, check) for check in devices],
        "rivals": [] if verdict is None else rival_fields(now_ns, verdict.rivals),
    }


def point_known(
    now_ns: int, alarm: AlarmState, verdict: Verdict | None, limits: Limits, most_ns: int
) -> dict[str, Any]:
    """Returns the error of a point and its limit; motion counts after the last disturbance and up to most_ns of age."""
    point = None if verdict is None else verdict.point
    if point is not None and not max(alarm.barrier_ns + 1, now_ns - most_ns) <= point.shown_ns <= now_ns:
        point = None
    return {"point": point_fields(now_ns, point, limits.region), "point_limit_mm": limits.point_mm}


def _line_check(now_ns: int, check: Check, age_ns: int | None, shown_now: Shown | None) -> dict[str, Any]:
    """Returns the fields of a check. age_ns: how old its motion may be; None where the contact does not require it."""
    return {
        **check_fields(now_ns, check),
        "max_age_s": None if age_ns is None else age_ns / 1e9,
        "shown": None if shown_now is None else shown_now.value,
        "carried": shown_now is Shown.CARRIED,
    }


def audio_fields(now_ns: int, sound: Sound | None, testing: bool) -> dict[str, Any]:
    """Returns whether the alarm may sound, and why not."""
    if sound is None:
        return {"mode": "on", "left_s": None, "reason": "", "lamp_test": testing}
    left_s = None if sound.until_ns is None else (sound.until_ns - now_ns) / 1e9
    return {"mode": sound.mode.value, "left_s": left_s, "reason": sound.off_reason, "lamp_test": testing}


def output_fields(outputs: Sequence[OutputThread]) -> list[dict[str, Any]]:
    """Returns the fields of each output: what it shows, and how quickly it did so."""
    return [
        {
            "url": output.url,
            "signal": output.signal.value,
            "energised": output.energised,
            "writes": output.writes,
            "slowest_ms": round(output.slowest_ms, 3),
            "delays": output.delays.fields(),
        }
        for output in outputs
    ]


def log_fields(recorder: Recorder) -> dict[str, Any]:
    """Returns how far the alarm log has been written to the disk."""
    return {
        "entries": recorder.written,
        "waiting": recorder.waiting,
        "dropped": recorder.dropped,
        "failing": recorder.failing,
        "free_bytes": recorder.free_bytes,
    }
