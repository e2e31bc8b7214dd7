"""`probewatch demo` as a process: a real run that leaves nothing behind."""

import json
import os
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from probewatch.tools.demo.script import DEFAULT, FAULT_CLASS
from tests.support.demo_cart import PROBEWATCH
from tests.support.polling import until

_STARTED_S = 60.0
"""Within which a part of the demo is there: what is judged begins after it, so a busy computer may take its time."""


class Demo:
    """A demo of its own process; every process under it carries a mark in its environment."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.folder, self.mark = folder, f"PROBEWATCH_TEST={folder.name}-{os.getpid()}"
        name, _, value = self.mark.partition("=")
        environment = os.environ | {"TMPDIR": str(folder), name: value}
        self.process = subprocess.Popen(
            [str(PROBEWATCH), "demo", *arguments],
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=environment,
        )

    def processes(self) -> dict[int, str]:
        """Command line of every living process with the mark, the demo's own excepted."""
        found = {}
        for place in Path("/proc").glob("[0-9]*"):
            try:
                if self.mark in (place / "environ").read_text() and int(place.name) != self.process.pid:
                    found[int(place.name)] = (place / "cmdline").read_text()
            except OSError:
                continue
        return found

    def pid_of(self, part: str) -> int:
        return until(lambda: next((pid for pid, line in self.processes().items() if part in line), 0), _STARTED_S)

    def finish(self, deadline_s: float = 40.0) -> tuple[int, str, str]:
        out, err = self.process.communicate(timeout=deadline_s)
        return self.process.returncode, out, err

    def left_nothing(self) -> bool:
        return not self.processes() and not list(self.folder.iterdir())


@pytest.fixture
def demos() -> Iterator[list[Demo]]:
    started: list[Demo] = []
    yield started
    for demo in started:
        if demo.process.poll() is None:
            demo.process.kill()
            demo.process.communicate()


@pytest.fixture
def folder() -> Iterator[Path]:
    """For the demo's temporary files; near the root, as the path of a Unix socket is bounded."""
    with tempfile.TemporaryDirectory(prefix="pw-") as place:
        yield Path(place)


@pytest.mark.alone
def test_every_fault_from_bytes_to_its_last_state_and_back(folder: Path, demos: list[Demo]) -> None:
    """All of what `make demo` shows; the picture is mirrored first."""
    demo = Demo(folder, "--json")
    demos.append(demo)
    code, out, err = demo.finish(300)
    assert code == 0, err
    assert not [character for character in err if ord(character) < 32 and character not in "\t\n"], "a pipe gets tabs"
    assert demo.left_nothing()
    fields = json.loads(out)
    assert [fault["fault"] for fault in fields["faults"]] == list(DEFAULT)
    assert [fault["named"] for fault in fields["faults"]] == [FAULT_CLASS[fault] for fault in DEFAULT]
    fault = fields["faults"][0]
    times_s = [fault[f"{name}_after_s"] for name in ("warning", "halt", "acknowledged")]
    assert fault["recalibration_request_after_s"] is None, "the flip is reset at the scanner"
    assert (fields["passed"], fault["named"], times_s) == (True, "polarity", sorted(times_s))
    closed = [switch["energised"] for switch in fields["contact"]]
    assert closed == [True, False] * (len(closed) // 2) + [True]
    assert len(closed) > 2 * len(DEFAULT), "it opened for each"
    assert "PASSED" in err.splitlines()[-1]
    verified_s = next(one["t_s"] for one in fields["timeline"] if one["state"] == "monitoring")
    asked = [one for one in fields["prompts"] if one["t_s"] < verified_s]
    assert {one["asked"] for one in asked} == {10}
    assert any("twist it about its long axis, 8° each way" in one["gesture"] for one in asked)
    assert len(asked[-1]["missing"]) < len(asked[0]["missing"]), "what is shown already is told"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_ends_everything(folder: Path, demos: list[Demo], number: signal.Signals) -> None:
    demo = Demo(folder)
    demos.append(demo)
    demo.pid_of("service.estimator.process")
    demo.process.send_signal(number)
    demo.process.send_signal(number)
    code, _, err = demo.finish()
    assert (code, err) == (130, "probewatch: stopped\n")
    assert demo.left_nothing()


def test_a_stop_while_starting_ends_everything(folder: Path, demos: list[Demo]) -> None:
    demo = Demo(folder)
    demos.append(demo)
    demo.pid_of("scanner")
    demo.process.send_signal(signal.SIGINT)
    assert demo.finish()[0] == 130
    assert demo.left_nothing()


@pytest.mark.parametrize(("part", "name"), [("ndi", "polaris"), ("run", "service")])
def test_a_part_that_dies_is_named(folder: Path, demos: list[Demo], part: str, name: str) -> None:
    demo = Demo(folder)
    demos.append(demo)
    demo.pid_of("service.estimator.process")
    os.kill(demo.pid_of(f"\0{part}\0"), signal.SIGKILL)
    code, _, err = demo.finish()
    assert code == 69
    assert f"{name} was killed by signal 9; its last lines:" in err
    assert "Traceback" not in err
    assert demo.left_nothing()


def test_a_killed_demo_takes_its_processes_with_it(folder: Path, demos: list[Demo]) -> None:
    demo = Demo(folder)
    demos.append(demo)
    demo.pid_of("service.estimator.process")
    demo.process.kill()
    demo.process.communicate()
    until(lambda: not demo.processes(), 40)
