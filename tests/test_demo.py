"""`probewatch demo`: its script, its judgement, its picture, and a real run that leaves nothing behind."""

import io
import json
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from rich.console import Console

from appliance.types import State
from drivers.errors import ConfigurationError
from drivers.twins.faults import FAULT_CLASS
from tests.demo_cart import PROBEWATCH
from tests.polling import until
from tools.demo_judgement import History, Moment, Switch, judge
from tools.demo_report import Circumstances, print_report, report_fields
from tools.demo_script import HEALTHY_S, Injection, Script, chosen_script, default_script
from tools.live_view import LiveView

MONITORING, WARNING, HALT = State.MONITORING, State.WARNING, State.HALT
REQUESTED, LOST = State.RECALIBRATION_REQUESTED, State.DEVICE_LOST
SCRIPT = Script((Injection("depth", 30.0), Injection("lose-tracker", 60.0)), 90.0)


def moment(t_s: float, state: State, fault: str | None = None) -> Moment:
    return Moment(t_s, state, fault, "because")


HEALTHY = (moment(8, MONITORING),)
DEPTH = (moment(30.1, WARNING, "scale"), moment(31.1, HALT, "scale"), moment(33.1, REQUESTED, "scale"))
TRACKER = (moment(60.5, WARNING, "tracker-lost"), moment(61.5, LOST, "tracker-lost"))
BACK, BACK_AGAIN = (moment(42, MONITORING),), (moment(65, MONITORING),)
GOOD = (*HEALTHY, *DEPTH, *BACK, *TRACKER, *BACK_AGAIN)
SWITCHES = tuple(Switch(t_s, t_s in (8, 42, 65)) for t_s in (8, 30.1, 42, 60.5, 65))


def sentence(*moments: Moment, switches: tuple[Switch, ...] = SWITCHES) -> str:
    return judge(SCRIPT, History(moments, switches, (41.0,), 90.0)).sentence


def test_a_run_as_it_should_be_passes() -> None:
    outcome = judge(SCRIPT, History(GOOD, SWITCHES, (41.0,), 90.0))
    assert (outcome.sentence, outcome.passed, outcome.unexpected, outcome.verified_s) == ("", True, (), 8)
    depth, tracker = outcome.findings
    assert depth.reached == pytest.approx({WARNING: 0.1, HALT: 1.1, REQUESTED: 3.1})
    assert (depth.named, depth.contact_open_after_s) == ("scale", pytest.approx(0.1))
    assert (depth.acknowledged_after_s, depth.verified_after_s) == (11.0, pytest.approx(42 - depth.injection.to_s))
    assert (tracker.named, tracker.acknowledged_after_s) == ("tracker-lost", None)


@pytest.mark.parametrize(
    ("moments", "said"),
    [
        ((), "The calibration was never verified."),
        ((*HEALTHY, *TRACKER, *BACK_AGAIN), "At 30.0 s depth was not found."),
        ((*HEALTHY, moment(30.1, WARNING, "offset"), *DEPTH[1:], *BACK, *TRACKER, *BACK_AGAIN), "was named offset"),
        ((*HEALTHY, *DEPTH[:2], *BACK, *TRACKER, *BACK_AGAIN), "did not lead to 'recalibration requested'"),
        ((*HEALTHY, DEPTH[0], moment(31, REQUESTED, "scale"), moment(32, HALT, "scale"), *BACK), "in the wrong order"),
        ((*HEALTHY, *DEPTH, moment(61, MONITORING)), "At 30.0 s depth was removed, but is not verified again in time"),
        ((*GOOD, moment(75, WARNING, "latency")), "At 75.0 s 'warning' (latency) came up without that fault."),
        ((*HEALTHY, moment(20, WARNING, "scale"), moment(22, MONITORING), *GOOD[1:]), "At 20.0 s 'warning' (scale)"),
        (
            (*HEALTHY, *DEPTH, moment(34, REQUESTED, "offset"), *GOOD[4:]),
            "At 34.0 s 'recalibration requested' (offset)",
        ),
        ((moment(31, MONITORING), *DEPTH[1:]), "At 30.0 s depth began while the service was still 'self-test'"),
    ],
)
def test_what_went_wrong_is_said_by_its_earliest_cause(moments: tuple[Moment, ...], said: str) -> None:
    assert said in sentence(*moments)


def test_a_contact_that_stays_closed_fails() -> None:
    assert "depth did not open the contact" in sentence(*GOOD, switches=SWITCHES[:1])
    assert "depth began while" in sentence(*GOOD, switches=())


def test_without_faults_only_quiet_is_asked_for() -> None:
    assert judge(Script((), 30.0), History(HEALTHY, SWITCHES[:1], (), 30.0)).passed


def test_the_default_script_is_healthy_first_and_under_three_minutes() -> None:
    script = default_script()
    assert script.injections[0].from_s == HEALTHY_S >= 20
    assert script.duration_s < 165
    assert {"flip-lateral", "depth", "bend-marker", "latency", "freeze-video", "lose-tracker"} <= {
        one.fault for one in script.injections
    }
    assert all(script.until_s(one) >= one.over_s for one in script.injections)
    assert [one.fault for one in default_script(70).injections] == ["flip-lateral", "depth"]
    assert default_script(20) == Script((), 20)


def test_a_chosen_script_keeps_its_faults_apart() -> None:
    script = chosen_script([("depth", 60.0), ("flip-vertical", 20.0)])
    assert [one.fault for one in script.injections] == ["flip-vertical", "depth"]
    assert (script.on(21), script.next_after(21)) == script.injections
    assert script.schedule.active(61) == {"depth"}
    with pytest.raises(ConfigurationError, match=r"--fault depth@30: .*Use 39 or later"):
        chosen_script([("depth", 30.0), ("flip-vertical", 20.0)])
    with pytest.raises(ConfigurationError, match="--duration 30"):
        chosen_script([("depth", 20.0)], 30)


def test_every_fault_has_its_time_and_class() -> None:
    for fault, fault_class in FAULT_CLASS.items():
        injection = Injection(fault, 20.0)
        assert injection.fault_class == fault_class
        assert 3 <= injection.to_s - 20 <= 12
        assert injection.states[0] is WARNING


def test_the_report_is_json_and_a_table_of_80_columns() -> None:
    history = History((*GOOD, moment(75, WARNING, "latency")), SWITCHES, (41.0,), 90.0)
    outcome = judge(SCRIPT, history)
    fields = json.loads(json.dumps(report_fields(outcome, history, Circumstances(1, 1.0, {}))))
    assert (fields["version"], fields["passed"]) == (1, False)
    assert fields["faults"][0]["recalibration_request_after_s"] == 3.1
    assert fields["unexpected"][0]["fault"] == "latency"
    console = Console(file=io.StringIO(), width=80)
    print_report(console, outcome)
    table = console.file.getvalue()
    assert max(map(len, table.splitlines())) <= 80
    assert "…" not in table, "no column is cut"
    assert all(word in table for word in ("lose-tracker", "verified", "FAILED: At 75.0 s"))


def status(**changed: object) -> dict[str, object]:
    check = {"name": "rotation-elevational", "fault": "rotation", "ratio": 0.5, "verdict": "OK"}
    failing = check | {"name": "polarity", "ratio": 2.0, "verdict": "FAULT"}
    unknown = check | {"name": "latency", "ratio": None, "verdict": "NOT_VERIFIED"}
    return {
        "state": "halt",
        "text": "HALT: calibration is wrong",
        "remedy": "Reset the flip",
        "fault": "polarity",
        "reason": "polarity +1 axes, limit 0.5 axes",
        "lamp": "red",
        "energised": False,
        "latched": "halt",
        "acknowledged": False,
        "notices": [],
        "remarks": [],
        "lost": {},
        "audio": {"mode": "paused", "left_s": 29.0},
        "verification_age_s": None,
        "fps": {"video": 30.0, "tracker": 60.0},
        "counters": {"dropped_frames": 3, "dropped_poses": 0, "uptime_s": 20},
        "checks": [check | {"name": f"rotation-elevational{n}"[-20:]} for n in range(13)] + [failing, unknown],
        "devices": [check | {"name": f"alarm log integrity{n}"[-20:]} for n in range(12)],
        **changed,
    }


def test_the_live_view_fits_a_small_terminal() -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=80, height=24, color_system=None)
    with LiveView(console, SCRIPT) as view:
        for number in range(30):
            view.event(float(number), "relay board: contact opened " * 5)
        view.show(20.0, status())
        drawn = io.StringIO()
        Console(file=drawn, width=80).print(view.picture)
    lines = drawn.getvalue().splitlines()
    assert len(lines) < 24
    assert max(map(len, lines)) <= 80
    assert "next fault: depth in 10 s" in lines[0]
    text = drawn.getvalue()
    assert all(part in text for part in ("HALT", "contact OPEN", "━━━━─────┃  0.50 ✓", "2.00 ✗", "–   ?", "dropped: 3"))


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
        return until(lambda: next((pid for pid, line in self.processes().items() if part in line), 0), 20)

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


def test_a_mirrored_picture_from_bytes_to_halt_and_back(tmp_path: Path, folder: Path, demos: list[Demo]) -> None:
    report = tmp_path / "demo.json"
    demo = Demo(folder, "--fault", "flip-lateral@19", "--json", str(report))
    demos.append(demo)
    code, out, err = demo.finish(90)
    assert (code, err) == (0, ""), out
    assert not [character for character in out if ord(character) < 32 and character != "\n"]
    assert demo.left_nothing()
    fields = json.loads(report.read_text())
    (fault,) = fields["faults"]
    times_s = [fault[f"{name}_after_s"] for name in ("warning", "halt", "recalibration_request", "acknowledged")]
    assert (fields["passed"], fault["named"], times_s) == (True, "polarity", sorted(times_s))
    assert [switch["energised"] for switch in fields["contact"]] == [True, False, True]
    assert "PASSED" in out.splitlines()[-1]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_ends_everything(folder: Path, demos: list[Demo], number: signal.Signals) -> None:
    demo = Demo(folder)
    demos.append(demo)
    demo.pid_of("estimator_process")
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


@pytest.mark.parametrize(("part", "name"), [("drivers.twins.polaris", "polaris"), ("run", "service")])
def test_a_part_that_dies_is_named(folder: Path, demos: list[Demo], part: str, name: str) -> None:
    demo = Demo(folder)
    demos.append(demo)
    demo.pid_of("estimator_process")
    os.kill(demo.pid_of(f"\0{part}\0"), signal.SIGKILL)
    code, _, err = demo.finish()
    assert code == 69
    assert f"{name} was killed by signal 9; its last lines:" in err
    assert "Traceback" not in err
    assert demo.left_nothing()


def test_a_killed_demo_takes_its_processes_with_it(folder: Path, demos: list[Demo]) -> None:
    demo = Demo(folder)
    demos.append(demo)
    demo.pid_of("estimator_process")
    demo.process.kill()
    demo.process.communicate()
    until(lambda: not demo.processes(), 40)


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--fault", "flip@20"], 2, "'flip' is none of flip-lateral"),
        (["--fault", "depth"], 2, "such as depth@25"),
        (["--fault", "depth@nan"], 2, "needs a time in seconds"),
        (["--fault", "depth@20", "--fault", "depth@22"], 78, "Use 39 or later"),
        (["--json", "/nowhere/at/all.json"], 78, "no file can be written here"),
    ],
)
def test_a_bad_command_line_is_refused_before_anything_starts(arguments: list[str], code: int, said: str) -> None:
    began_s = time.monotonic()
    refused = subprocess.run([str(PROBEWATCH), "demo", *arguments], capture_output=True, text=True, check=False)
    assert (refused.returncode, refused.stdout) == (code, "")
    assert said in refused.stderr
    assert time.monotonic() - began_s < 30


def test_the_help_names_every_fault() -> None:
    text = subprocess.run([str(PROBEWATCH), "demo", "--help"], capture_output=True, text=True, check=True).stdout
    assert all(fault in text and fault_class in text for fault, fault_class in FAULT_CLASS.items())
