"""Reads and writes what healthy scanning of a cart has taught about its noise: the threshold of a name, and its origin.

`probewatch noise` writes the file, `[noise] file` of the configuration names it. It can only raise the threshold of a
name; the condition that withdraws the OK has a threshold of its own, which no file changes.
"""

import hashlib
import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, ValidationError, field_validator

from probewatch.appliance.configuration.mistakes import Mistakes
from probewatch.appliance.limits import MOST_NAMED_NATS, NAMED_NATS, Limits
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.atomic_file import writing
from probewatch.drivers.files.markup import SAVE_AS_UTF_8, NotUtf8Error, text_of, toml_of
from probewatch.drivers.files.regular_file import read_bounded

_MOST_BYTES = 256_000
"""Bytes, a thousand recordings with their names; a cart's week has some hundred. More takes longer at each start."""
NOISE_BEGINS = "# Learned from healthy scanning of this cart"
"""The first words of each such file."""
_LEARN = "Learn it again: probewatch noise"
_JUDGED = ("rotation_deg", "scale_percent", "offset_mm", "latency_ms", "confidence_sigma")
"""Limits that the log likelihood ratio depends on."""

_Known = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class LearnedFrom(BaseModel):
    """Identifies one file from which the noise was learned."""

    model_config = _Known

    file: str
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class LearnedNoise(BaseModel):
    """Holds what was learned. named_nats: log likelihood ratio from which a FAULT is named. hours: in which the test
    had something to test. exceedances: blocks of it that came above from_nats; tail_nats, per_hour: upper bounds of how
    slowly such peaks become rarer, nats for a factor of e, and of their number. simulated: learned from no real cart.
    """

    model_config = _Known

    format: Literal["probewatch-noise"]
    version: Literal[1]
    named_nats: float = Field(ge=NAMED_NATS - 0.01, le=MOST_NAMED_NATS)
    hours: float = Field(gt=0)
    from_nats: float = Field(gt=0)
    exceedances: int = Field(ge=0)
    tail_nats: float = Field(gt=0)
    per_hour: float = Field(gt=0)
    software: str
    learned_utc: str
    simulated: bool = False
    limits: dict[str, float]
    recording: Annotated[tuple[LearnedFrom, ...], Field(min_length=1, strict=False)]

    _sha256: str = PrivateAttr(default="")

    @field_validator("limits")
    @classmethod
    def _are_those(cls, limits: dict[str, float]) -> dict[str, float]:
        if set(limits) != set(_JUDGED):
            raise ValueError(f"must be {', '.join(_JUDGED)}, each once")
        return limits

    @property
    def sha256(self) -> str:
        """Returns the SHA-256 of the file's content; empty where there is no file yet."""
        return self._sha256

    def toml(self) -> str:
        """Returns the text of the file."""
        lines = [
            f"{NOISE_BEGINS} by `probewatch noise`; docs/noise.md says what it means.",
            "# [noise] file of the configuration names it. It raises the threshold of a name and changes nothing else.",
        ]
        plain = self.model_dump(exclude={"limits", "recording"})
        lines += [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in plain.items()]
        lines += ["", "[limits]", *(f"{name} = {json.dumps(value)}" for name, value in self.limits.items())]
        for one in self.recording:
            file = json.dumps(one.file, ensure_ascii=False)
            lines += ["", "[[recording]]", f"file = {file}", f'sha256 = "{one.sha256}"']
        return "\n".join(lines) + "\n"


def judged_by(limits: Limits) -> dict[str, float]:
    """Returns the limits to which a threshold belongs."""
    return {name: getattr(limits, name) for name in _JUDGED}


def write_noise(path: Path, learned: LearnedNoise) -> None:
    """Writes the file; the old one stays until the new one is whole and on the disk. Raises ConfigurationError."""
    with writing(path) as stream:
        stream.write(learned.toml().encode())


def read_noise(path: Path) -> LearnedNoise:
    """Reads the file. Raises ConfigurationError, or its kind Mistakes, where it cannot be read or is something else."""
    try:
        data = read_bounded(path, _MOST_BYTES)
    except OSError as error:
        raise ConfigurationError(f"cannot be read ({error.strerror})", str(path), _LEARN) from None
    try:
        text = text_of(data)
        values: dict[str, Any] = toml_of(data, _MOST_BYTES)
        if values.get("format") != "probewatch-noise":
            raise ConfigurationError("is not what probewatch noise writes", str(path), _LEARN)
        learned = LearnedNoise.model_validate(values)
    except ValidationError as error:
        raise Mistakes.found(error, LearnedNoise, text, path, _LEARN) from None
    except NotUtf8Error as error:
        raise ConfigurationError(str(error), str(path), SAVE_AS_UTF_8) from None
    except ValueError as error:
        raise ConfigurationError(f"is not valid TOML: {error}", str(path), _LEARN) from None
    learned._sha256 = hashlib.sha256(data).hexdigest()
    return learned
