"""Describes each driver by one row of values that can be read before the driver is imported. Everything that must know
the drivers is made from these rows: the registry, `probe --help`, `configure`, tables of the pages, the unit's
DeviceAllow and the contract suites.

The rows are the constant DRIVERS in the `__init__.py` of the driver's folder; importing that imports no driver.
"""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.suggestion import did_you_mean, suggested


@dataclass(frozen=True, slots=True)
class Target:
    """Describes what a URL names after its scheme.

    looks_like: a regular expression for what people write without a scheme; empty where nothing is recognised. allow:
    classes of device nodes that the service's unit must permit. group: the group whose members may open such a node.
    """

    name: str
    looks_like: str = ""
    allow: tuple[str, ...] = ()
    group: str = ""


SERIAL_PORT = Target(
    "serial port", r"/dev/(tty|serial/|cu\.).*", ("char-ttyUSB", "char-ttyACM", "char-ttyS"), "dialout"
)
VIDEO_NODE = Target("video", r"/dev/(video|v4l/).*", ("char-video4linux",), "video")
GPIO_CHIP = Target("GPIO chip", r"/dev/gpiochip.*", ("char-gpiochip",), "gpio")
STREAM = Target("stream", r"(rtsp|rtsps|rtmp|http|https|udp)://.*")
RECORDING = Target("recording", r".*\.(mha|mhd)")
FILM_SUFFIXES = (".mp4", ".avi", ".mkv", ".mov")
"""Suffixes of the files that screen recorders write. What OpenCV decodes under another name is a film as well."""
FILM = Target("film", rf".*({'|'.join(map(re.escape, FILM_SUFFIXES))})")
HOST = Target("host", r"(tcp://)?[\w.-]*[\w-](:\d+)?")
CAMERA = Target("number of a camera", allow=VIDEO_NODE.allow, group=VIDEO_NODE.group)
SOUND_CARD = Target("sound card", allow=("char-alsa",), group="audio")
SOCKET = Target("socket")
TARGETS = (SERIAL_PORT, VIDEO_NODE, GPIO_CHIP, STREAM, RECORDING, FILM, HOST, CAMERA, SOUND_CARD, SOCKET)
"""All targets. Where a text looks like two, the first is meant: a file name may also be the name of a host."""


@dataclass(frozen=True, slots=True)
class Option:
    """Describes one option of a URL.

    help: its meaning, in words that a terminal and a page can show. unit: that of a number. bounds: the least and the
    greatest number. words: the only permitted values. form: how any other value is written. default: what holds without
    the option; a number where the driver reads its default from here. refusal: the words that follow an invalid value
    and say what is wrong with it. question: what `configure` asks to obtain the value, which is the path of a file.
    without: the answer to that question that leaves the option out.
    """

    name: str
    help: str
    default: str = "none"
    unit: str = ""
    bounds: tuple[float, float] | None = None
    words: tuple[str, ...] = ()
    form: str = ""
    required: bool = False
    refusal: str = "cannot be used"
    question: str = ""
    without: str = ""

    @property
    def values(self) -> str:
        """Returns what may be written after the name: `20…5000`, `high|low`, `FILE.rom`."""
        if self.bounds is not None:
            return "{:g}…{:g}".format(*self.bounds)
        return "|".join(self.words) or self.form

    def remedy(self, kind: str) -> str:
        """Returns what to write instead of a value out of bounds. kind: the kind of number, in words."""
        assert self.bounds is not None, f"the row of '{self.name}' has no bounds"
        return f"Use {kind} from {self.bounds[0]:g} to {self.bounds[1]:g} {self.unit}".rstrip()


@dataclass(frozen=True, slots=True)
class Contact:
    """Describes the contact of an output.

    read_back: how it is known that the contact followed. process_dies, cart_hangs: what happens to the contact in that
    case. serves_contact: whether the output can be the contact itself, not only a signal beside it.
    """

    read_back: str
    process_dies: str
    cart_hangs: str
    serves_contact: bool = True


@dataclass(frozen=True, slots=True)
class Twin:
    """Describes the simulated device, which exists as bytes alone. name: that of its command, `probewatch simulate
    NAME`. what: what the command simulates.
    """

    name: str
    what: str


@dataclass(frozen=True, slots=True)
class Driver:
    """Describes the driver of one URL scheme.

    module: the module with open_video, open_tracker or open_output (target, options, clock), one for each kind, and
    with `checked` (target, options), which opens nothing. examples: kind of device → a URL that opens it as that kind.
    device: what the driver is for. line: how that device is connected. is_simulated: whether it stands for a simulation
    or a recording rather than a device that is there now. is_listed: whether `configure` offers each connected target
    with this scheme. twin: None where there is none. contact: that of an output. advice: what else to say where an
    option is unknown. page: the page of docs/ with its options.
    """

    scheme: str
    module: str
    device: str
    line: str
    examples: Mapping[str, str]
    targets: tuple[Target, ...]
    options: tuple[Option, ...] = ()
    twin: Twin | None = None
    is_simulated: bool = False
    is_listed: bool = False
    contact: Contact | None = None
    advice: str = ""
    page: str = ""

    @property
    def kinds(self) -> tuple[str, ...]:
        """Returns the kinds of device, of "output", "tracker" and "video", that it can be opened as."""
        return tuple(self.examples)

    @property
    def required(self) -> tuple[str, ...]:
        """Returns the names of the mandatory options."""
        return tuple(option.name for option in self.options if option.required)

    def url(self, target: str) -> str:
        """Returns a URL of this driver for that target, with the mandatory options as in the example."""
        begin, _, query = next(iter(self.examples.values())).partition("?")
        slashes = "//" if begin.startswith(f"{self.scheme}://") else ""
        kept = "&".join(part for part in query.split("&") if part.partition("=")[0] in self.required)
        return f"{self.scheme}:{slashes}{target}{f'?{kept}' if kept else ''}"

    def given(self, options: Mapping[str, str], where: str) -> "Given":
        """Reads the options of a URL by these rows. Raises ConfigurationError for an option that is unknown."""
        return Given(self.options, options, where, self.advice)


def refuse_unknown(options: Collection[str], known: Sequence[str], where: str, advice: str = "") -> None:
    """Raises ConfigurationError for an option that is not in `known`. The error names it, the one that may have been
    meant, and all of `known`, followed by advice.
    """
    if unknown := sorted(set(options) - set(known)):
        meant = did_you_mean(suggested(unknown[0], known))
        remedy = f"Use {', '.join(known)}" if known else "Leave it out: this kind of device takes none"
        raise ConfigurationError(f"unknown option '{unknown[0]}'", where, f"{meant} {remedy}{advice}".lstrip())


class Given:
    """Holds the options of one URL and reads each by its row. Every reader raises ConfigurationError that names the
    option and its value.
    """

    def __init__(self, rows: Sequence[Option], options: Mapping[str, str], where: str, advice: str = "") -> None:
        self._rows, self._options, self.where = {row.name: row for row in rows}, options, where
        refuse_unknown(options, list(self._rows), where, advice)

    def text(self, name: str) -> str | None:
        """Returns the value as it is written; None where it is not given."""
        assert name in self._rows, f"the driver reads '{name}', and its descriptor has no such row"
        return self._options.get(name)

    def number(self, name: str) -> float:
        """Returns the number, or the default of the row."""
        number = self.number_or_none(name)
        return float(self._rows[name].default) if number is None else number

    def number_or_none(self, name: str) -> float | None:
        """Returns the number; None where it is not given, whatever the default of the row is."""
        text, row = self.text(name), self._rows[name]
        if text is None:
            return None
        assert row.bounds is not None, f"the row of '{name}' has no bounds"
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not row.bounds[0] <= value <= row.bounds[1]:
            raise self.refusal(name, row.remedy("a number"))
        return value

    def integer(self, name: str) -> int:
        """Returns the whole number, or the default of the row."""
        number = self.integer_or_none(name)
        return int(self._rows[name].default) if number is None else number

    def integer_or_none(self, name: str) -> int | None:
        """Returns the whole number; None where it is not given, whatever the default of the row is."""
        text, row = self.text(name), self._rows[name]
        if text is None:
            return None
        assert row.bounds is not None, f"the row of '{name}' has no bounds"
        if not (text.isascii() and text.isdecimal() and row.bounds[0] <= int(text) <= row.bounds[1]):
            raise self.refusal(name, row.remedy("a whole number"))
        return int(text)

    def word(self, name: str) -> str:
        """Returns one of the row's words, or its default. Where all words are in capitals, the value may be written in
        small letters.
        """
        word = self.word_or_none(name)
        return self._rows[name].default if word is None else word

    def word_or_none(self, name: str) -> str | None:
        """Returns the word; None where it is not given, whatever the default of the row is."""
        text, words = self.text(name), self._rows[name].words
        if text is None:
            return None
        word = text.upper() if all(one.isupper() or one.isdecimal() for one in words) else text
        if word not in words:
            raise self.refusal(name, f"Use {', '.join(words[:-1])} or {words[-1]}" if words[1:] else f"Use {words[0]}")
        return word

    def refusal(self, name: str, remedy: str) -> ConfigurationError:
        """Returns the error that refuses an invalid value of this option."""
        what = f"{name}={self._options.get(name, '')} {self._rows[name].refusal}"
        return ConfigurationError(what, self.where, remedy)
