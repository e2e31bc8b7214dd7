"""What an error about a recording advises is there where it is read: no command is told an option of another one."""

import re
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import pytest

from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.appliance.types import Calibration
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import RecordingError
from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from probewatch.drivers.recordings.replay import open_tracker
from tests.drivers.recordings.test_film import film
from tests.support.answers import answered
from tests.support.commands import commands
from tests.support.recordings import items, turn

SIZE_PX = (48, 32)
ELSEWHERE = "replay and latency take poses of another file with --poses"
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
KINDS = ("film", "table", "text", "gif", "no poses", "other names", "one tool", "another reference", "no orientation")


def recording(folder: Path, kind: str) -> Path:
    """A recording that is refused, and whose refusal says what to give instead."""
    path = folder / "scan.igs.mha"
    if kind == "film":
        return film(folder / "scan.mkv", 2)
    if kind in ("table", "text"):
        path = path.with_suffix(".txt")
        path.write_text("t_s,m11,m12\n0,1,0\n" if kind == "table" else "a text\n")
        return path
    if kind == "gif":
        path.write_bytes(b"GIF89a" + bytes(400))
        return path
    names = {"no poses": (), "other names": ("StylusToTracker",), "one tool": ("XToY",)}.get(kind, ("ProbeToTracker",))
    found = [replace(one, transforms={name: turn(0.1) for name in names}) for one in items(4, SIZE_PX)]
    write_metaimage(path, found, SIZE_PX)
    if kind == "no orientation":
        path.write_bytes(path.read_bytes().replace(b"UltrasoundImageOrientation = MFA\n", b""))
    return path


def given(command: str, path: Path, kind: str) -> list[object]:
    folder = path.parent
    calibration = folder / "probe.toml"
    write_calibration(calibration, Calibration(np.eye(3), (1, 1), np.array([0.2, 0.2]), np.zeros(3), SIZE_PX), {})
    named = ["--reference", "Table"] if kind == "another reference" else []
    return {
        "replay": ["replay", path, "--calibration", calibration, *named],
        "latency": ["latency", path, "--calibration", calibration, *named],
        "noise": ["noise", path, "--calibration", calibration, "--output", folder / "noise.toml", *named],
        "recalibrate": ["recalibrate", "--recording", path, "--calibration", calibration, *named],
        "simulate ndi": ["simulate", "ndi", "--model", "vega", "--pty", folder / "pty", "--recording", path],
    }[command]


def options_of(command: str) -> set[str]:
    return {
        name
        for path, one in commands()
        if " ".join(path) == command
        for option in one.params
        if isinstance(option, click.Option)
        for name in option.opts
    }


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("command", ["replay", "latency", "noise", "recalibrate"])
def test_every_option_that_is_advised_is_one_of_the_command_or_of_one_that_is_named(
    command: str, kind: str, tmp_path: Path
) -> None:
    """`noise` and `recalibrate` were told to give --poses, which they have not."""
    answer = answered(*given(command, recording(tmp_path, kind), kind))
    assert answer.returncode != 0, answer
    said = " ".join(answer.stderr.split())
    assert kind == "text" or any(word in said for word in ("--", "table", "another file")), said
    assert set(OPTION.findall(said.replace(ELSEWHERE, ""))) <= options_of(command), said


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("another reference", "no orientation")])
def test_a_simulator_is_told_none_of_the_readers_options(kind: str, tmp_path: Path) -> None:
    answer = answered(*given("simulate ndi", recording(tmp_path, kind), kind))
    assert (answer.returncode, OPTION.findall(answer.stderr)) == (65, []), answer.stderr


@pytest.mark.parametrize(
    ("kind", "told"),
    [
        ("film", "name the poses of another file with poses="),
        ("other names", "on the ultrasound probe: probe=Stylus; name the poses"),
        ("one tool", "Name the tool with probe= and reference=;"),
        ("another reference", "Name the reference tool with reference=, or Tracker"),
        ("no orientation", "in the header or with orientation="),
    ],
)
def test_a_device_is_told_the_options_of_its_url(kind: str, told: str, tmp_path: Path) -> None:
    options = {"reference": "Table"} if kind == "another reference" else {}
    with pytest.raises(RecordingError) as error:
        open_tracker(str(recording(tmp_path, kind)), options, HostClock())
    assert told in error.value.remedy
    assert "--" not in error.value.remedy
