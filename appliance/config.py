"""The configuration file: read once, whole, and refused by key, value and bound when it cannot be meant."""

import difflib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from appliance.limits import Limits
from appliance.supervision.annunciator import Role
from appliance.supervision.ledger import Durations
from appliance.supervision.watchers.facts import Patience
from drivers.errors import ConfigurationError
from drivers.markup import toml_of
from drivers.ports import split_url
from drivers.regularfile import read_bounded

_MOST_BYTES = 64_000
"""The commented example has 3000."""

_MOST_TOLD = 20
"""Mistakes told at once; what is not told takes no time to be compared with what is known."""

_EXAMPLE = "config/probewatch.toml shows every key"


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


def _refuse_controls(value: str | Path) -> str | Path:
    if not str(value).isprintable():
        raise ValueError("a control character is in it, such as a NUL or a line break")
    return value


_Url = Annotated[str, Field(min_length=1), AfterValidator(_refuse_controls)]
_Place = Annotated[Path, Field(strict=False), AfterValidator(_refuse_controls)]


class Device(_Section):
    """One device by its URL."""

    url: _Url


class Output(Device):
    """One alarm output and what it shows; see appliance.supervision.annunciator.Role."""

    signal: Role = Field(default=Role.CONTACT, strict=False)


class CalibrationPlace(_Section):
    """Where the reference calibration lies; a relative path counts from the folder of the configuration file."""

    file: _Place


class SupervisorTimes(_Section):
    """Durations of the supervisor's table and of the device watchers, in the unit that ends each name."""

    gross_halt_after_s: float = Field(default=0.3, ge=0, le=10)
    halt_after_s: float = Field(default=1.0, ge=0, le=10)
    recalibrate_after_s: float = Field(default=2.0, ge=0, le=60)
    device_lost_after_s: float = Field(default=1.0, ge=0, le=10)
    probation_s: float = Field(default=1.0, ge=0.1, le=30)
    max_verification_age_s: float = Field(default=30.0, ge=1, le=600)
    self_test_s: float = Field(default=20.0, ge=1, le=120)
    starting_s: float = Field(default=10.0, ge=1, le=120)
    video_silence_ms: float = Field(default=500, ge=100, le=5000)
    tracker_silence_ms: float = Field(default=500, ge=100, le=5000)
    tracker_stale_ms: float = Field(default=500, ge=50, le=5000)
    estimator_silence_ms: float = Field(default=1000, ge=300, le=5000)
    output_silence_ms: float = Field(default=500, ge=200, le=5000)
    unseen_s: float = Field(default=3.0, ge=0.5, le=60)

    def durations(self) -> Durations:
        return Durations(
            gross_halt_after_ns=_ns(self.gross_halt_after_s),
            halt_after_ns=_ns(self.halt_after_s),
            recalibrate_after_ns=_ns(self.recalibrate_after_s),
            device_lost_after_ns=_ns(self.device_lost_after_s),
            probation_ns=_ns(self.probation_s),
            max_verification_age_ns=_ns(self.max_verification_age_s),
            self_test_ns=_ns(self.self_test_s),
            starting_ns=_ns(self.starting_s),
        )

    def patience(self) -> Patience:
        return Patience(
            video_ns=_ns(self.video_silence_ms / 1e3),
            tracker_ns=_ns(self.tracker_silence_ms / 1e3),
            stale_ns=_ns(self.tracker_stale_ms / 1e3),
            unseen_ns=_ns(self.unseen_s),
            estimator_ns=_ns(self.estimator_silence_ms / 1e3),
            output_ns=_ns(self.output_silence_ms / 1e3),
        )


class Control(_Section):
    """The Unix socket through which tools speak to the service; its path is bounded by the kernel."""

    socket: _Place = Path("/run/probewatch/control")
    group: str = ""


class Alarm(_Section):
    """How the operator is spoken to, and the folder of the alarm log, which must outlive a power cut."""

    language: Literal["en", "de"] = "en"
    folder: _Place = Path("/var/lib/probewatch")


class Log(_Section):
    """How much is logged to stderr."""

    level: Literal["debug", "info", "warning", "error"] = "info"


class Config(_Section):
    """The whole file. configured: False until a person has adapted it. output holds one or more alarm outputs."""

    configured: bool = True
    video: Device
    tracker: Device
    output: Annotated[tuple[Output, ...], Field(min_length=1, max_length=8, strict=False)]
    calibration: CalibrationPlace
    limits: Limits = Limits()
    supervisor: SupervisorTimes = SupervisorTimes()
    control: Control = Control()
    alarm: Alarm = Alarm()
    log: Log = Log()


def load_config(path: Path) -> Config:
    """Raises ConfigurationError naming file, key, value, bound and what to do."""
    values = _read_toml(path)
    try:
        config = Config.model_validate(values)
    except ValidationError as error:
        raise ConfigurationError("; ".join(_violations(error)), str(path), f"Mend it; {_EXAMPLE}") from None
    _check_urls(config, path)
    _check_contact(config, path)
    _check_outputs(config, path)
    _check_socket(config.control.socket, path)
    place = CalibrationPlace(file=path.parent / config.calibration.file)
    alarm = config.alarm.model_copy(update={"folder": path.parent / config.alarm.folder})
    return config.model_copy(update={"calibration": place, "alarm": alarm})


def is_configured(path: Path) -> bool:
    """Whether a person has adapted the file; one without the key counts as adapted. Raises ConfigurationError."""
    return _read_toml(path).get("configured", True) is not False


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return toml_of(read_bounded(path, _MOST_BYTES), _MOST_BYTES)
    except OSError as error:
        raise ConfigurationError(
            f"cannot be read ({error.strerror})", str(path), "Check the path and its rights"
        ) from None
    except UnicodeDecodeError:
        raise ConfigurationError("is not UTF-8 text", str(path), "Save it as UTF-8") from None
    except ValueError as error:
        raise ConfigurationError(f"is not valid TOML: {error}", str(path), f"Mend that line; {_EXAMPLE}") from None


def _violations(error: ValidationError) -> list[str]:
    found = error.errors()
    told = [_violation(item["loc"], item["type"], item["msg"], item["input"]) for item in found[:_MOST_TOLD]]
    return told if len(found) <= _MOST_TOLD else [*told, f"and {len(found) - _MOST_TOLD} more"]


def _violation(loc: tuple[int | str, ...], kind: str, message: str, value: object) -> str:
    key = _key(loc)
    if kind == "missing":
        return f"{key} is missing"
    if kind == "extra_forbidden":
        return f"{key} is not known{_did_you_mean(loc)}"
    shown = "" if isinstance(value, dict | list) else f" = {value!r}"
    return f"{key}{shown}: {message[0].lower()}{message[1:]}"


def _key(loc: tuple[int | str, ...]) -> str:
    """[section] key, as it stands in the file; entries of [[output]] are counted from 1."""
    section, *rest = loc
    if not rest:
        return f"'{section}'"
    names = [f"entry {part + 1}" if isinstance(part, int) else part for part in rest]
    return f"[{section}] {' '.join(names)}"


def _did_you_mean(loc: tuple[int | str, ...]) -> str:
    known = _known_keys(loc[:-1])
    close = difflib.get_close_matches(str(loc[-1]), known, n=1, cutoff=0.5)
    return f", did you mean '{close[0]}'?" if close else f" (known: {', '.join(known)})"


def _known_keys(section: tuple[int | str, ...]) -> list[str]:
    if not section:
        return list(Config.model_fields)
    if section[0] == "output":
        return list(Output.model_fields)
    kind = Config.model_fields[str(section[0])].annotation
    assert isinstance(kind, type)
    assert issubclass(kind, BaseModel)
    return list(kind.model_fields)


def _check_urls(config: Config, path: Path) -> None:
    named = [("video", config.video), ("tracker", config.tracker)]
    named += [(f"output (entry {number})", output) for number, output in enumerate(config.output, 1)]
    for section, device in named:
        try:
            split_url(device.url)
        except ConfigurationError as error:
            where = f"{path}: [{section}] url = '{device.url}'"
            raise ConfigurationError(error.what, where, error.remedy) from None


def _check_contact(config: Config, path: Path) -> None:
    if all(output.signal is not Role.CONTACT for output in config.output):
        what = "no output has signal = 'contact'"
        raise ConfigurationError(what, f"{path}: [[output]]", "Without one nobody hears of a fault; add it")


def _check_outputs(config: Config, path: Path) -> None:
    urls = [output.url for output in config.output]
    doubled = next((url for url in urls if urls.count(url) > 1), None)
    if doubled is not None:
        where = f"{path}: [[output]] url = '{doubled}'"
        raise ConfigurationError("two outputs share one contact", where, "Give each its own channel or line")


def _check_socket(socket: Path, path: Path) -> None:
    if len(str(socket).encode()) > 100:
        where = f"{path}: [control] socket = '{socket}'"
        raise ConfigurationError("the path is longer than 100 bytes", where, "Choose a shorter path, such as in /run")
