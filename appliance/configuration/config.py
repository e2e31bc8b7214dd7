"""Reads the configuration file: once, whole, and refused by line, key, value and bound where it cannot be intended."""

import errno
import hashlib
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, PrivateAttr, ValidationError, model_validator

from probewatch.appliance.configuration.across import (
    refuse_by_hand,
    refuse_shared_port,
    refuse_unbounded_ages,
    refused,
)
from probewatch.appliance.configuration.mistakes import Mistakes
from probewatch.appliance.configuration.noise_file import LearnedNoise, judged_by, read_noise
from probewatch.appliance.configuration.toml_lines import key_lines, line_of
from probewatch.appliance.limits import MAX_VERIFICATION_AGE_S, NAMED_NATS, TRACKER_STALE_MS, Limits
from probewatch.appliance.supervision.annunciator import Role
from probewatch.appliance.supervision.device_health import Timeouts
from probewatch.appliance.supervision.policy import BEHIND_NS, Durations
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.markup import SAVE_AS_UTF_8, NotUtf8Error, text_of, toml_of
from probewatch.drivers.files.regular_file import read_bounded
from probewatch.drivers.registry import checked_url, is_simulated, split_url

_MOST_BYTES = 64_000
"""Bytes. The commented example has 3000."""


_EXAMPLE = "config/probewatch.toml shows every key"
_LONGEST_SOCKET_BYTES = 100
"""Bytes. The kernel takes 107."""


def _url(kind: str) -> AfterValidator:
    """Returns a validator that raises what pydantic collects for a URL that can never be opened as this kind."""

    def check(url: str) -> str:
        _refuse_controls(url)
        try:
            return checked_url(url, kind)
        except ConfigurationError as error:
            raise refused(error.advice) from None

    return AfterValidator(check)


def _watched(outputs: "tuple[Output, ...]") -> "tuple[Output, ...]":
    urls = [output.url for output in outputs]
    doubled = next((url for url in urls if urls.count(url) > 1), None)
    if doubled is not None:
        raise refused(f"two outputs share one contact, url = '{doubled}'. Give each its own channel or line")
    if all(output.signal is not Role.CONTACT for output in outputs):
        raise refused("no output has signal = 'contact'. Without one nobody hears of a fault; add it")
    return outputs


def _bindable(socket: Path) -> Path:
    if len(str(socket).encode(errors="surrogateescape")) > _LONGEST_SOCKET_BYTES:
        raise refused("the path is longer than 100 bytes. Choose a shorter path, such as in /run")
    return socket


_Side = Annotated[int, Field(ge=16, le=16_384)]


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


def _refuse_controls(value: str | Path) -> str | Path:
    if not str(value).isprintable():
        raise refused("a control character is in it, such as a NUL or a line break. Type it again")
    return value


_Users = Annotated[tuple[str, ...], Field(max_length=16, strict=False)]
_Place = Annotated[Path, Field(strict=False), AfterValidator(_refuse_controls)]


class Video(_Section):
    """Names the scanner's picture by its URL."""

    url: Annotated[str, _url("video")]


class Tracker(_Section):
    """Names the tracker by its URL."""

    url: Annotated[str, _url("tracker")]


class Output(_Section):
    """Names one alarm output by its URL and the signal it shows; see appliance.supervision.annunciator.Role."""

    url: Annotated[str, _url("output")]
    signal: Role = Field(default=Role.CONTACT, strict=False)


class CalibrationPlace(_Section):
    """Locates the first reference; a relative path counts from the folder of the configuration file. file: None for a
    cart that has none yet, whose first one is scanned on it.

    image_size_px: (width, height) of the pictures, where the file does not state it. probe: names the transform of a
    PLUS device set. due_days: after which it is to be checked again; None for a cart whose due date is kept elsewhere.
    overdue: what a passed date does: advise, or also expires, which removes the verification.
    """

    file: _Place | None = None
    image_size_px: Annotated[tuple[_Side, _Side], Field(strict=False)] | None = None
    probe: str = Field(default="Probe", min_length=1)
    due_days: int | None = Field(default=None, ge=1, le=3650)
    overdue: Literal["advise", "expires"] = "advise"


class NoisePlace(_Section):
    """Locates what `probewatch noise` has learned from healthy scanning of this cart; a relative path counts from the
    folder of the configuration file. file: None for the threshold that probewatch ships with.
    """

    file: _Place | None = None


class SupervisorTimes(_Section):
    """Holds durations of the supervisor's table and of the device watchers, in the unit that ends each name."""

    gross_halt_after_s: float = Field(default=0.3, ge=0, le=10)
    halt_after_s: float = Field(default=1.0, ge=0, le=10)
    recalibrate_after_s: float = Field(default=2.0, ge=0, le=60)
    device_lost_after_s: float = Field(default=1.0, ge=0, le=10)
    probation_s: float = Field(default=1.0, ge=0.1, le=30)
    max_verification_age_s: float = Field(default=MAX_VERIFICATION_AGE_S, ge=1, le=600)
    self_test_s: float = Field(default=20.0, ge=1, le=120)
    starting_s: float = Field(default=10.0, ge=1, le=120)
    video_silence_ms: float = Field(default=500, ge=100, le=5000)
    tracker_silence_ms: float = Field(default=500, ge=100, le=5000)
    tracker_stale_ms: float = Field(default=TRACKER_STALE_MS, ge=50, le=5000)
    estimator_silence_ms: float = Field(default=1000, ge=300, le=5000)
    output_silence_ms: float = Field(default=500, ge=200, le=5000)
    unseen_s: float = Field(default=3.0, ge=0.5, le=60)

    def durations(self, stated_ns: int = 0) -> Durations:
        """Returns the durations. stated_ns: the delay that the sources are known to have."""
        return Durations(
            gross_halt_after_ns=_ns(self.gross_halt_after_s),
            halt_after_ns=_ns(self.halt_after_s),
            recalibrate_after_ns=_ns(self.recalibrate_after_s),
            device_lost_after_ns=_ns(self.device_lost_after_s),
            probation_ns=_ns(self.probation_s),
            max_verification_age_ns=_ns(self.max_verification_age_s),
            self_test_ns=_ns(self.self_test_s),
            starting_ns=_ns(self.starting_s),
            behind_ns=BEHIND_NS + stated_ns,
        )

    def timeouts(self) -> Timeouts:
        return Timeouts(
            video_ns=_ns(self.video_silence_ms / 1e3),
            tracker_ns=_ns(self.tracker_silence_ms / 1e3),
            stale_ns=_ns(self.tracker_stale_ms / 1e3),
            out_of_sight_ns=_ns(self.unseen_s),
            estimator_ns=_ns(self.estimator_silence_ms / 1e3),
            output_ns=_ns(self.output_silence_ms / 1e3),
        )


class Control(_Section):
    """Describes the Unix socket through which tools talk to the service; the kernel limits its path.

    viewers: users who may read status and feed without pictures, and request nothing, whatever group they are in; one
    that does not exist has no rights.
    """

    socket: Annotated[_Place, AfterValidator(_bindable)] = Path("/run/probewatch/control")
    group: str = ""
    viewers: _Users = ("probewatch-monitor",)


class Feed(_Section):
    """Describes the feed, with pictures, for programs of the same group on this computer; docs/feed.md.

    socket: None for `feed` beside the control socket. offered: whether there is one. viewers: users who may read status
    and feed, including pictures, and request nothing, whatever group they are in.
    """

    offered: bool = True
    viewers: _Users = ("probewatch-openigtlink", "probewatch-recorder")
    socket: Annotated[_Place, AfterValidator(_bindable)] | None = None


class Recorder(_Section):
    """Describes what `probewatch record` keeps of the feed; the service ignores it. docs/black-box.md.

    ring_gb, kept_gb: 10⁹ bytes of the latest, and of what is kept of alarms and of stretches that a person marked.
    leave_free_gb: of the disk, below which nothing is written. before_alarm_s, after_alarm_s: what is kept of an alarm.
    every: keeps one picture of this many. text: whether what lies outside the sector is made black.
    """

    folder: _Place = Path("/var/lib/probewatch-recorder")
    socket: Annotated[_Place, AfterValidator(_bindable)] = Path("/run/probewatch-recorder/control")
    ring_gb: float = Field(default=20.0, ge=0.05, le=100_000)
    kept_gb: float = Field(default=10.0, ge=0.05, le=100_000)
    leave_free_gb: float = Field(default=2.0, ge=0.1, le=100_000)
    before_alarm_s: float = Field(default=120.0, ge=10, le=3600)
    after_alarm_s: float = Field(default=60.0, ge=0, le=3600)
    every: int = Field(default=1, ge=1, le=1000)
    text: Literal["blacken", "keep"] = "blacken"


class Alarm(_Section):
    """Sets the operator's language, and the folder of the alarm log, which must survive a power cut."""

    language: Literal["en", "de"] = "en"
    folder: _Place = Path("/var/lib/probewatch")


class Log(_Section):
    """Sets how much is logged to stderr."""

    level: Literal["debug", "info", "warning", "error"] = "info"


class Config(_Section):
    """Holds the whole file. configured: False until a person has adapted it. output holds one or more alarm outputs."""

    configured: bool = True
    video: Video
    tracker: Tracker
    output: Annotated[tuple[Output, ...], Field(min_length=1, max_length=8, strict=False), AfterValidator(_watched)]
    calibration: CalibrationPlace = CalibrationPlace()
    limits: Limits = Limits()
    noise: NoisePlace = NoisePlace()
    supervisor: SupervisorTimes = SupervisorTimes()
    control: Control = Control()
    feed: Feed = Feed()
    recorder: Recorder = Recorder()
    alarm: Alarm = Alarm()
    log: Log = Log()

    _sha256: str = PrivateAttr(default="")
    _learned: LearnedNoise | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _check_across(self) -> Self:
        refuse_shared_port(self.tracker.url, [output.url for output in self.output])
        refuse_unbounded_ages(self.limits, self.supervisor.max_verification_age_s)
        refuse_by_hand(self.limits)
        return self

    @property
    def learned_noise(self) -> LearnedNoise | None:
        """Returns the origin of the limits' threshold of a name; None for the one that probewatch ships with."""
        return self._learned

    @property
    def sha256(self) -> str:
        """Returns the SHA-256 of the file's content, in hexadecimal; empty where there was no file."""
        return self._sha256

    @property
    def required_ages_ns(self) -> dict[str, int]:
        """Returns how old the motion may be that showed each parameter which the contact requires."""
        most_s = self.supervisor.max_verification_age_s
        ages_s = self.limits.required_age_s.ages_s
        return {name: _ns(most_s if age_s is None else min(age_s, most_s)) for name, age_s in ages_s.items()}

    @property
    def feed_socket(self) -> Path | None:
        """Returns the path at which the feed is offered, None where it is not."""
        return (self.feed.socket or self.control.socket.with_name("feed")) if self.feed.offered else None

    @property
    def simulated(self) -> tuple[str, ...]:
        """Returns the URLs of the sources that are not real devices; without any it is a real cart."""
        return tuple(device.url for device in (self.video, self.tracker) if is_simulated(device.url))

    @property
    def tracker_latency_ms(self) -> float:
        """Returns what the tracker's URL subtracts from every stamp."""
        return _stated_ms(self.tracker.url, "tracker")

    @property
    def durations(self) -> Durations:
        """Returns the durations of `[supervisor]`; what the URLs subtract from the stamps is added to behind_ns."""
        stated_ms = _stated_ms(self.video.url, "video") + self.tracker_latency_ms
        return self.supervisor.durations(_ns(stated_ms / 1e3))


def load_config(path: Path) -> Config:
    """Reads the file. Raises ConfigurationError, or its kind Mistakes, naming file, line, key, value, bound, remedy."""
    return config_of(configuration_text(path), path)


def config_of(text: str, path: Path) -> Config:
    """Returns what the file at `path` would mean with that text. Raises as load_config does."""
    values = _parsed(text, path)
    try:
        config = Config.model_validate(values)
    except ValidationError as error:
        raise Mistakes.found(error, Config, text, path, f"Mend it; {_EXAMPLE}") from None
    config._sha256 = hashlib.sha256(text.encode()).hexdigest()
    if config.noise.file is not None:
        config = _with_noise(config, path.parent / config.noise.file, text, path)
    file = config.calibration.file
    place = config.calibration.model_copy(update={"file": None if file is None else path.parent / file})
    if config.feed_socket == config.control.socket:
        raise _one_socket(config, text, path)
    alarm = config.alarm.model_copy(update={"folder": path.parent / config.alarm.folder})
    recorder = config.recorder.model_copy(update={"folder": path.parent / config.recorder.folder})
    return config.model_copy(update={"calibration": place, "alarm": alarm, "recorder": recorder})


def _one_socket(config: Config, text: str, path: Path) -> Mistakes:
    """Returns the mistake of a control socket and a feed at one path, which the file may name or not."""
    section, what = (
        ("feed", "is the control socket") if config.feed.socket else ("control", "is the socket of the feed")
    )
    line = line_of((section, "socket"), key_lines(text))
    told = f"[{section}] socket = '{config.control.socket}': {what}. Choose another path"
    return Mistakes(path, [(line, told)], f"Mend it; {_EXAMPLE}")


def _with_noise(config: Config, file: Path, text: str, path: Path) -> Config:
    """Returns the configuration with the threshold that was learned. Raises Mistakes of either file."""

    def refused(what: str) -> Mistakes:
        line = line_of(("noise", "file"), key_lines(text))
        return Mistakes(path, [(line, f"[noise] file = '{file}': {what}")], "Learn it again: probewatch noise")

    try:
        learned = read_noise(file)
    except Mistakes:
        raise
    except ConfigurationError as error:
        raise refused(error.what) from None
    if learned.limits != judged_by(config.limits):
        learned_limits = ", ".join(f"{name} = {value:g}" for name, value in learned.limits.items())
        raise refused(f"was learned under other [limits], {learned_limits}")
    if learned.simulated and not config.simulated:
        raise refused("was learned from simulated devices, and those of this cart are real")
    limits = config.limits.model_copy(update={"named_nats": max(learned.named_nats, NAMED_NATS)})
    config = config.model_copy(update={"limits": limits, "noise": NoisePlace(file=file)})
    config._learned = learned
    return config


def is_configured(path: Path) -> bool:
    """Returns False until a person has adapted the file; True without the key. Raises ConfigurationError."""
    return _parsed(configuration_text(path), path).get("configured", True) is not False


def _stated_ms(url: str, kind: str) -> float:
    """Returns the delay that the URL of a source states; 0 for text that is no number, which the driver refuses."""
    options = split_url(url, kind)[2]
    return sum(_number(options.get(name, "0")) for name in ("latency_ms", "delay_ms"))


def _number(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        return 0.0
    return number if isfinite(number) else 0.0


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)


def configuration_text(path: Path) -> str:
    """Returns the file's text. Raises ConfigurationError for a file that cannot be read as text of bounded size."""
    try:
        return text_of(read_bounded(path, _MOST_BYTES))
    except OSError as error:
        what = f"cannot be read ({error.strerror})"
        is_folder = isinstance(error, IsADirectoryError)
        remedy = "Name the file in it" if is_folder else "Check the path's permissions"
        if error.errno in (errno.EINVAL, errno.EFBIG):  # a device, a pipe, or far too long
            remedy = "Name the cart's configuration, a TOML file"
        if isinstance(error, FileNotFoundError):
            remedy = f"Correct its name, or write it: probewatch configure {path}"
        raise ConfigurationError(what, str(path), remedy) from None
    except NotUtf8Error as error:
        raise ConfigurationError(str(error), str(path), SAVE_AS_UTF_8) from None


def _parsed(text: str, path: Path) -> dict[str, Any]:
    try:
        return toml_of(text.encode(), _MOST_BYTES)
    except ValueError as error:
        raise ConfigurationError(f"is not valid TOML: {error}", str(path), f"Mend that line; {_EXAMPLE}") from None
