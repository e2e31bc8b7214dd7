"""Byte logs: what is written, what is read back, and recorded devices that answer once more."""

import json
import subprocess
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from threading import Event, Thread
from typing import Any

import numpy as np
import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError, DeviceLost, RecordingError
from probewatch.drivers.io.byte_log import HEADING, ByteLog, Direction, read_log
from probewatch.drivers.registry import open_tracker
from probewatch.drivers.twins.byte_log_twin import LogTwin, exchanges
from probewatch.drivers.twins.ndi.models import AURORA, MODELS
from probewatch.drivers.twins.ndi.tool_definitions import PROBE, REFERENCE, make_rom
from probewatch.drivers.twins.pty_line import PtyLine
from probewatch.drivers.twins.tcp_line import TcpLine
from tests.support.decoded import decoded
from tests.support.record_logs import AURORA_OPTIONS, LOGS
from tests.support.simulated import PROBEWATCH, matrix_of, probe_place, reference_place

RATE = 3.0


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    clock = HostClock()
    with ByteLog(tmp_path / "a.log", "ndi:/dev/x", clock) as byte_log:
        byte_log.remark("9600 baud")
        byte_log.sent(b"INIT:E3A5\r")
        byte_log.received(b"OKAY")
        byte_log.received(b"A896\r")
    entries = read_log(tmp_path / "a.log")
    assert [(entry.direction, entry.data) for entry in entries] == [
        (Direction.NOTE, b"9600 baud"),
        (Direction.SENT, b"INIT:E3A5\r"),
        (Direction.RECEIVED, b"OKAY"),
        (Direction.RECEIVED, b"A896\r"),
    ]
    assert all(abs(entry.t_ns - clock.now_ns()) < 5e9 for entry in entries)
    assert (tmp_path / "a.log").read_text().splitlines()[0] == "# probewatch byte log 1 ndi:/dev/x"
    assert [b"".join(data for _, data in found.chunks) for found in exchanges(entries)] == [b"", b"OKAYA896\r"]


def test_a_second_connection_goes_on_in_the_same_file(tmp_path: Path) -> None:
    for data in (b"a", b"b"):
        with ByteLog(tmp_path / "a.log", "ndi:x", HostClock()) as byte_log:
            byte_log.sent(data)
    assert [entry.data for entry in read_log(tmp_path / "a.log")] == [b"a", b"b"]


def test_the_log_is_bounded_and_keeps_the_latest(tmp_path: Path) -> None:
    with ByteLog(tmp_path / "a.log", "ndi:x", HostClock(), limit_bytes=4000) as byte_log:
        for number in range(500):
            byte_log.sent(number.to_bytes(2))
    files = [tmp_path / "a.log.1", tmp_path / "a.log"]
    assert sum(file.stat().st_size for file in files) < 4200
    kept = [int.from_bytes(entry.data) for file in files for entry in read_log(file)]
    assert kept == list(range(kept[0], 500))


def test_a_log_that_cannot_be_written_is_a_configuration_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="cannot be written"):
        ByteLog(tmp_path / "absent" / "a.log", "ndi:x", HostClock())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "not a byte log"),
        ("PK\x03\x04", "not a byte log"),
        (f"{HEADING} x\n1.000000 > 4f4\n", "line 2 is damaged"),
        (f"{HEADING} x\n1.000000 > 4f\nsoon < 00\n", "line 3 is damaged"),
        (f"{HEADING} x\n1.000000 ? 4f\n", "line 2 is damaged"),
    ],
)
def test_a_damaged_log_is_refused_by_line(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "a.log").write_text(text)
    with pytest.raises(RecordingError, match=words):
        read_log(tmp_path / "a.log")


def play(model: str, folder: Path) -> list[dict[str, Any]]:
    """What the driver makes of the log of a model, played through a pseudo-terminal or TCP."""
    clock, stop = HostClock(RATE), Event()
    for name, main_type in (("probe", PROBE), ("reference", REFERENCE)):
        (folder / f"{name}.rom").write_bytes(make_rom(main_type))
    tools = f"probe={folder}/probe.rom&reference={folder}/reference.rom"
    found = []
    with TcpLine(0, clock) if MODELS[model].network else PtyLine(folder / "tracker", clock) as line:
        twin = LogTwin(line, clock, read_log(LOGS / f"{model}.log"))
        thread = Thread(target=twin.run, args=(stop,))
        thread.start()
        place = f"ndi+tcp://127.0.0.1:{line.port}" if isinstance(line, TcpLine) else f"ndi:{folder}/tracker"
        try:
            wanted = AURORA_OPTIONS if MODELS[model] is AURORA else tools
            with suppress(DeviceLost), open_tracker(f"{place}?{wanted}&deadline_ms=3000", clock) as tracker:
                while True:
                    pose = tracker.read(1.0)
                    found += [] if pose is None else [pose]
        finally:
            stop.set()
            thread.join()
    return decoded(found)


@pytest.mark.parametrize("model", sorted(MODELS))
def test_a_recorded_tracker_decodes_as_it_did(model: str, tmp_path: Path) -> None:
    stated = json.loads((LOGS / f"{model}.json").read_text())
    assert len(stated) > 40
    assert play(model, tmp_path) == stated


@pytest.mark.parametrize("model", sorted(MODELS))
def test_the_stated_poses_are_those_that_were_simulated(model: str) -> None:
    """Independent of driver and log: from the places that the recording session gave to the simulator."""
    counter_hz = MODELS[model].counter_hz
    stated = [entry for entry in json.loads((LOGS / f"{model}.json").read_text()) if "matrix" in entry]
    assert len(stated) > 15
    for entry in stated:
        t_s = entry["frame"] / counter_hz
        true = np.linalg.inv(matrix_of(reference_place(t_s))) @ matrix_of(probe_place(t_s))
        assert np.linalg.norm(np.array(entry["matrix"])[:, 3] - true[:3, 3]) < (0.5 if counter_hz > 60 else 0.15)
        np.testing.assert_allclose(np.array(entry["matrix"])[:, :3], true[:3, :3], atol=2e-3)


@pytest.mark.thorough
def test_the_command_plays_a_log_once_and_hangs_up(tmp_path: Path) -> None:
    (tmp_path / "probe.rom").write_bytes(make_rom(PROBE))
    (tmp_path / "reference.rom").write_bytes(make_rom(REFERENCE))
    tools = f"probe={tmp_path}/probe.rom&reference={tmp_path}/reference.rom"
    log, rate = str(LOGS / "vega.log"), 2.0
    command = [*PROBEWATCH, "simulate", "log", log, "--tcp", "0", "--rate", f"{rate:g}"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        url = json.loads(process.stdout.readline())["url"]
        found = []
        with suppress(DeviceLost), open_tracker(f"{url}?{tools}&deadline_ms=3000", HostClock(rate)) as tracker:
            while True:
                found += filter(None, [tracker.read(1.0)])
        assert process.wait(10) == 0
    assert decoded(found) == json.loads((LOGS / "vega.json").read_text())


def test_a_request_the_log_does_not_hold_is_not_answered(tmp_path: Path) -> None:
    clock, stop = HostClock(), Event()
    entries = read_log(LOGS / "vega.log")
    with TcpLine(0, clock) as line:
        twin = LogTwin(line, clock, tuple(replace(entry) for entry in entries))
        twin._answer(b"BEEP:28544\r")
        assert twin.unanswered == [b"BEEP:28544\r"]
        stop.set()
        twin.run(stop)
