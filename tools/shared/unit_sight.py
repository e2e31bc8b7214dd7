"""Finds files that the service's unit cannot read: with ProtectHome= and PrivateTmp= it sees no home folders, and a
/tmp of its own.
"""

from collections.abc import Iterator
from pathlib import Path

from probewatch.appliance.configuration.config import Config
from probewatch.drivers.registry import split_url
from probewatch.tools.german.translation import mistake_text
from probewatch.tools.shared.named_cart import CONFIG

_HIDDEN = ("/home", "/root", "/run/user", "/tmp", "/var/tmp")
_REMEDY = "Copy it to /etc/probewatch, and name it there"


def unseen(file: Path) -> str:
    """Returns why the unit cannot read that file, and what to do; empty where it can."""
    places = (file.absolute(), file.resolve())
    for place in _HIDDEN:
        if any(one.is_relative_to(place) for one in places):
            return f"the service cannot see it: its unit is shown nothing of {place}. {_REMEDY}"
    return ""


def is_of_the_unit(configuration: Path) -> bool:
    """Returns whether the unit uses this configuration; any other belongs to a service that a person started, with that
    person's rights.
    """
    return configuration.absolute() == CONFIG


def unseen_mistakes(config: Config, file: Path, language: str) -> Iterator[str]:
    """Yields the mistakes in the files that a configuration names, one per line, in the language. `file` is its
    path.
    """
    if not is_of_the_unit(file):
        return
    named = [("[calibration] file", config.calibration.file), ("[noise] file", config.noise.file)]
    urls = [("[video] url", config.video.url), ("[tracker] url", config.tracker.url)]
    urls += [(f"[output] entry {number} url", output.url) for number, output in enumerate(config.output, 1)]
    named += [(where, path) for where, url in urls for path in _paths(url)]
    for where, url in urls:
        for why in relative(url):
            yield f"{file}: {where}: {mistake_text(why, language)}"
    for where, path in named:
        if path is not None and (why := unseen(path)):
            yield f"{file}: {where}: {path}: {mistake_text(why, language)}"


def relative(url: str) -> Iterator[str]:
    """Yields an error for each relative path in a URL: the service starts in another folder and would look for it
    there.
    """
    _, target, options = split_url(url)
    for text in (target, *options.values()):
        for part in (one.partition("@")[0] for one in text.split(",")):
            path = Path(part)
            if not path.is_absolute() and not part.isdecimal() and path.exists():
                yield f"{part} is a path from this folder, and the service starts in another. Write {path.absolute()}"


def _paths(url: str) -> Iterator[Path]:
    """Yields the absolute paths in the target and the options of a URL, such as FILE.rom@PLUG,FILE.rom."""
    _, target, options = split_url(url)
    for text in (target, *options.values()):
        yield from (Path(part.partition("@")[0]) for part in text.split(",") if part.startswith("/"))
