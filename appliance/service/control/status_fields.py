"""Lists the fields of the status, one row each. Pure.

`service_status.py` gives each field its value. The rows produce the table of docs/control.md, the metrics made of one
field, what MQTT publishes unchanged, the lists of both in docs/monitoring.md, and lines of `probewatch status`. Tested
against a running service in tests/appliance/service/test_daemon.py.
"""

from dataclasses import dataclass
from enum import Enum


class Kind(Enum):
    """Names how a metric represents the value of its field."""

    GAUGE = "the number; left out while it is null"
    COUNTER = "the number, which only rises"
    TRUE = "1: it is true, or there are some; 0: not"
    GIVEN = "1: it is not null; 0: it is"


@dataclass(frozen=True, slots=True)
class Metric:
    """Describes a metric made of one field. name: without probewatch_ and _total. help: for Prometheus."""

    name: str
    kind: Kind
    help: str


@dataclass(frozen=True, slots=True)
class Line:
    """Describes a line of `probewatch status`, left out while the field is null. {} is the value, as in str.format. de:
    in German; empty where the value is a sentence that stays English. A line that begins with ! is yellow.
    """

    en: str
    de: str = ""


@dataclass(frozen=True, slots=True)
class Field:
    """Describes one field. type, meaning: as in docs/control.md. parts: the fields inside an object; they have no type
    of their own there, and their meaning follows their name. mqtt: published unchanged; not for parts. line: for
    `probewatch status`. later: services of earlier versions do not have it, so that readers leave it out instead of
    calling the whole status unknown.
    """

    name: str
    type: str = ""
    meaning: str = ""
    parts: tuple["Field", ...] = ()
    metric: Metric | None = None
    mqtt: bool = False
    line: Line | None = None
    later: bool = False


STATUS = (
    Field("t_ns", "number", "CLOCK_MONOTONIC of the tick that this describes, ns"),
    Field("state", "string", "as in [alarms.md](alarms.md)", mqtt=True),
    Field(
        "text",
        "string",
        "what is wrong, for the operator; while monitoring, whether that rests on earlier motion",
        mqtt=True,
    ),
    Field("remedy", "string", "what to do", mqtt=True),
    Field(
        "recalibration",
        "object or null",
        "who recalibrates: `who` (user and process), `yours` (bool: the process that asks), `since_s`, "
        "`hold_s` (longest silence; null: tied to no connection), `silent_s`, `ended` (null, or why the "
        "service gave it up, until it monitors again)",
    ),
    Field(
        "language",
        "string",
        "en or de: of `text`, `remedy`, `notices`, `gesture` and the text of `proposal`; everything else is English",
    ),
    Field("fault", "string or null", "class of the hazard that caused the state", mqtt=True),
    Field("reason", "string", "why, in one sentence"),
    Field("priority", "string", "high, medium, low, none", mqtt=True),
    Field("lamp", "string", "red, yellow, cyan, green"),
    Field("energised", "bool", "the contact is closed: the calibration is verified"),
    Field(
        "latched",
        "string or null",
        "state that holds until acknowledged and verified again",
        metric=Metric("latched", Kind.GIVEN, "1: a halt holds until a person has acknowledged it"),
        mqtt=True,
    ),
    Field(
        "acknowledged",
        "bool",
        "a person has acknowledged it",
        metric=Metric("acknowledged", Kind.TRUE, "1: a person has acknowledged the alarm"),
        mqtt=True,
    ),
    Field("notices", "strings", "what needs attention but no alarm", mqtt=True),
    Field(
        "since_s",
        "number",
        "age of the state",
        metric=Metric("state_age_seconds", Kind.GAUGE, "Since when it has been in force"),
    ),
    Field(
        "verification_age_s",
        "number or null",
        "age of the oldest motion that the verification rests on; null: not verified now",
        metric=Metric("verification_age_seconds", Kind.GAUGE, "Age of the motion that the verification rests on"),
    ),
    Field("software", "string", "version of probewatch", mqtt=True),
    Field("configuration", "object", "the configuration in force: `file`, `sha256`"),
    Field(
        "noise",
        "object or null",
        "origin of the threshold of a name ([noise.md](noise.md)), null for the default: `file`, `sha256`, "
        "`named_nats`, `hours`, `recordings`, `learned_utc`, `software`",
    ),
    Field(
        "reference",
        "object or null",
        "the calibration in force: `number` in the history, `origin` (configuration, recalibration, went "
        "back to N, file, file of reference N), `utc` (since), `software` (version that took it), `file` "
        "(where it lay), `sha256`, `image_size_px`, `probe`, `simulated`, `difference` (from the one before), "
        "`who`, `to_show` (checks that its first OK needs), `verified_utc` (null: not yet), `relative_pose` (16 "
        "numbers by rows, second marker body → first, mm; null: not known), `image_to_probe` (4 × 4, rows: "
        "pixel → mm in the frame of the marker body, as PLUS has it), `polarity` (±1 for lateral, "
        "axial: mirrored axes of the picture, which the matrix does not show)",
    ),
    Field(
        "reference_due_utc",
        "string or null",
        "when the reference is to be checked again: `[calibration] due_days` after it came in force, or the "
        "day that its file states, whichever is first",
        mqtt=True,
    ),
    Field("reference_expires_utc", "string or null", "when it expires by its file"),
    Field(
        "reference_overdue",
        "string or null",
        "which of these has passed, or why that is not known",
    ),
    Field(
        "reference_waits",
        "string or null",
        "why there is no reference, or none that can be verified, such as a full disk",
        metric=Metric("reference_waits", Kind.GIVEN, "1: there is no reference that may be verified"),
        line=Line("! reference: {}", "! Referenz: {}"),
    ),
    Field(
        "calibration_changed",
        "string or null",
        "the configured calibration file was edited, renamed or is no longer named, and is not in force",
        metric=Metric("calibration_file_changed", Kind.GIVEN, "1: the configured calibration file is not in force"),
        line=Line("! {}"),
    ),
    Field(
        "simulated",
        "strings",
        "URLs of sources that are not real devices; with any, `text` begins with SIMULATED",
        metric=Metric("simulated", Kind.TRUE, "1: some source is not a real device"),
    ),
    Field("verdict", "string or null", "OK, FAULT, NOT_VERIFIED: the latest"),
    Field(
        "missing",
        "strings",
        "parameters that the contact needs and that motion has not shown, or too long ago",
    ),
    Field(
        "gesture",
        "strings",
        "the shortest motion that shows them, or distinguishes `rivals`",
    ),
    Field(
        "checks",
        "list",
        "`name`, `fault`, `value`, `sigma`, `unit`, `limit`, `ratio` (1 is the limit), `verdict` (of a "
        "window of up to 30 s), `shown_age_s` (of the motion that showed it), `max_age_s` "
        "(`[limits.required_age_s]` plus the rest of the probe; null: not required), "
        "`shown` (`verified`: by motion of the last 10 s; `carried`: by earlier motion that is still valid; "
        "`missing`; null: not required), `carried` (bool)",
    ),
    Field("devices", "list", "the same of the device watchers"),
    Field(
        "point",
        "object or null",
        "how far what the picture shows may be from its true place, mm, as pairs of bounds for 95 % and 99.7 "
        "%: `worst_mm`, `median_mm` over the region; `depth_mm` of `[limits] point_depth_mm` and "
        "`at_depth_mm`; `shown_age_s`, of the oldest motion; `region_mm`, the "
        "bound for 99.7 % at five rows of five places of `region`, edges among them, from its upper left corner; "
        "`region`: `[limits] region`, shares of width and height. Null while a "
        "parameter was not observed, polarity or latency is not in order, something contradicts the "
        "calibration, or the hand's speed is not known",
    ),
    Field(
        "limits",
        "object",
        "in force: `profile` ([profiles.md](profiles.md)) and `beside`, the keys of `[limits]` that differ from it; "
        "null there: off",
        later=True,
    ),
    Field("point_limit_mm", "number or null", "limit of `worst_mm` at 99.7 %, `[limits] point_mm`"),
    Field(
        "rivals",
        "list",
        "what may be wrong where motion does not tell which, likeliest first: the keys of `checks`, and "
        "`behind_nats`, log likelihood behind the first",
    ),
    Field(
        "proposal",
        "object or null",
        "what the calibration has become since it was last verified; nothing is applied. `text`; `values`, "
        "each with `name`, `was`, `now`, `sigma`, `unit`; `steps` (`set-latency`, `take-x`, `recalibrate`); "
        "`image_to_probe` (4 × 4, null where motion does not recover it)",
    ),
    Field(
        "audio",
        "object",
        "`mode` (on, paused, acknowledged, off), `left_s`, `reason`, `lamp_test`",
    ),
    Field(
        "outputs",
        "list",
        "`url`, `signal`, `energised` (null: lost), `writes`, `slowest_ms` (from verdict to completed "
        "write), `delays` (histogram of these)",
    ),
    Field(
        "log",
        "object",
        "alarm log",
        parts=(
            Field(
                "entries",
                meaning=" on the disk",
                metric=Metric("log_last_entry", Kind.GAUGE, "Number of the last entry of the alarm log on the disk"),
            ),
            Field(
                "waiting",
                metric=Metric(
                    "log_waiting_entries", Kind.GAUGE, "Entries of the alarm log that are not on the disk yet"
                ),
            ),
            Field(
                "dropped",
                metric=Metric(
                    "log_dropped_entries", Kind.COUNTER, "Entries of the alarm log that no memory was left for"
                ),
            ),
            Field(
                "failing",
                meaning=" (why it cannot be written, or null)",
                metric=Metric("log_failing", Kind.GIVEN, "1: the alarm log cannot be written"),
            ),
            Field(
                "free_bytes",
                meaning=" (on its disk)",
                metric=Metric("log_disk_free_bytes", Kind.GAUGE, "Room on the disk of the alarm log"),
            ),
        ),
    ),
    Field("lost", "object", "device → what is wrong"),
    Field("losses", "object", "video, tracker, output → how often lost since the start"),
    Field("alarms", "object", "hazard → how often since the start it caused the state or a notice"),
    Field(
        "estimator",
        "string or null",
        "how its process ended last, and which restart followed; null: it never ended",
    ),
    Field(
        "feed",
        "object",
        "the [feed](feed.md), since the start of the estimator: `refused` (why there is none, or null), "
        "`clients`, `lost` (samples that a client missed), `dropped` (clients)",
    ),
    Field("remarks", "strings", "what the tracker says besides its poses"),
    Field("fps", "object", "`video`, `tracker`: per second"),
    Field(
        "tick",
        "object",
        "intervals of the tick: `median_ms`, `p99_ms`, `longest_ms` of the last minute, `histogram` since the start",
    ),
    Field(
        "load",
        "object",
        "",
        parts=(
            Field(
                "pressure",
                meaning=" (share of the last second in which some program waited for processor or memory, "
                "null: not known)",
                metric=Metric("pressure_ratio", Kind.GAUGE, "Share of the last second in which a program had to wait"),
            ),
            Field(
                "late",
                meaning=" (share by which ticks were late)",
                metric=Metric("late_ratio", Kind.GAUGE, "Share by which ticks of the last second were late"),
            ),
            Field(
                "waiting_frames",
                meaning=" (pictures not yet taken by the estimator)",
                metric=Metric("waiting_frames", Kind.GAUGE, "Pictures that wait to be judged"),
            ),
            Field(
                "overloaded_s",
                meaning=" (since when, null: it is not)",
                metric=Metric("overloaded", Kind.GIVEN, "1: this computer is too short of time"),
            ),
        ),
    ),
    Field(
        "counters",
        "object",
        "since the start",
        parts=(
            Field(
                "uptime_s",
                metric=Metric("uptime_seconds", Kind.GAUGE, "Since the start of the service"),
            ),
            Field("frames"),
            Field("poses"),
            Field(
                "frame_gaps",
                metric=Metric("frame_gaps", Kind.COUNTER, "Pictures counted by the device that never arrived"),
            ),
            Field(
                "early_stamps",
                meaning=" (refused: stamped later than they arrived)",
                metric=Metric("early_stamps", Kind.COUNTER, "Samples refused, stamped later than they arrived"),
            ),
            Field("dropped_frames"),
            Field("dropped_poses"),
            Field("output_writes"),
            Field("device_losses"),
            Field(
                "estimator_restarts",
                metric=Metric("estimator_restarts", Kind.COUNTER, "Processes that compute, started after the first"),
            ),
            Field(
                "dropped_clients",
                metric=Metric("dropped_clients", Kind.COUNTER, "Clients of the control socket, dropped"),
            ),
            Field(
                "late_ticks",
                metric=Metric("late_ticks", Kind.COUNTER, "Ticks that came more than half a period late"),
            ),
        ),
    ),
)
