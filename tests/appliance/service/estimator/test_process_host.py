"""The two sides of the estimator, with a real second process."""

import io
import json
import os
import re
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import psutil
import pytest

from probewatch.appliance.limits import Limits
from probewatch.appliance.service.estimator.link import EstimatorReport
from probewatch.appliance.service.estimator.process_host import EstimatorHost
from probewatch.appliance.service.host.log import configure
from probewatch.appliance.types import Calibration, Verdict, VerdictKind
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp
from tests.support import stand_in_estimator as stand_in
from tests.support.polling import until
from tests.support.stopwatch import Stopwatch

COMMAND = (sys.executable, "-m", "tests.support.stand_in_estimator")
HEARTBEAT_S = 0.5


def reference(scale: float = 0.25) -> Calibration:
    return Calibration(np.eye(3), (1, 1), np.array([scale, scale]), np.zeros(3), (64, 48))


def frame(order: int, t_ns: int = 1) -> Frame:
    return Frame(Stamp(t_ns, 0), 1, np.full((48, 64), order, np.uint8))


@pytest.fixture(scope="module")
def host() -> Iterator[EstimatorHost]:
    """One that nobody harms, for all tests that only talk to it."""
    host = EstimatorHost(reference(), Limits(), 500_000_000, COMMAND)
    until(lambda: host.poll()[0])
    yield host
    assert host.restarts == 0
    host.close()


def seen(host: EstimatorHost) -> EstimatorReport:
    """What it says after everything before was heard."""
    until(lambda: host.poll()[0])
    assert host.last is not None
    return host.last


def verdicts(host: EstimatorHost) -> tuple[Verdict, ...]:
    return until(lambda: host.poll()[1])


def test_it_speaks_without_having_anything_to_say(host: EstimatorHost) -> None:
    before = seen(host)
    for _ in range(5):
        until(lambda: host.poll()[0], HEARTBEAT_S)
    assert host.last is not None
    assert (host.last.verdicts, host.last.frames) == ((), before.frames)


def test_samples_go_in_and_verdicts_come_out(host: EstimatorHost) -> None:
    before = seen(host)
    host.put(Pose(Stamp(1, 0), 1, None, float("nan"), PoseStatus.MISSING))
    host.put(frame(stand_in.OK, t_ns=77))
    (verdict,) = verdicts(host)
    assert (verdict.t_ns, verdict.kind) == (77, VerdictKind.OK)
    assert host.last is not None
    assert (host.last.frames, host.last.poses) == (before.frames + 1, before.poses + 1)
    assert host.last.dropped_frames == before.dropped_frames


def test_other_timeouts_of_a_tracker_reach_the_line() -> None:
    with closing(EstimatorHost(reference(), Limits(), 500_000_000, COMMAND)) as host:
        until(lambda: host.poll()[0])
        host.put(frame(stand_in.OK))
        assert verdicts(host)[0].checks[0].limit == 500_000_000
        host.set_limits(Limits(), 250_000_000)
        until(lambda: host.put(frame(stand_in.OK)) or any(v.checks[0].limit == 250_000_000 for v in host.poll()[1]))


def test_both_streams_reach_the_line_in_the_order_of_their_stamps(host: EstimatorHost) -> None:
    """Samples that wait together: the process is held until all are there, or it would take them as they come."""
    seen(host)
    assert host.pid is not None
    os.kill(host.pid, signal.SIGSTOP)
    try:
        until(lambda: psutil.Process(host.pid).status() == psutil.STATUS_STOPPED)
        for t_ns in (30, 10, 20):
            host.put(frame(stand_in.OK, t_ns))
    finally:
        os.kill(host.pid, signal.SIGCONT)
    came: list[int] = []
    until(lambda: came.extend(verdict.t_ns for verdict in host.poll()[1]) or len(came) == 3)
    assert came == [10, 20, 30]


def test_a_sample_wakes_it(host: EstimatorHost) -> None:
    """It does not wait for its next report, 0.1 s later."""
    delays_s = []
    for _ in range(15):
        time.sleep(0.013)
        put_ns = time.monotonic_ns()
        host.put(frame(stand_in.OK))
        verdicts(host)
        delays_s.append((host.sent_ns - put_ns) / 1e9)
    assert float(np.median(delays_s)) < 0.025


def test_without_samples_it_sleeps(host: EstimatorHost) -> None:
    """Two or three switches a report, ten reports a second."""

    def switches() -> int:
        status = Path(f"/proc/{host.pid}/status").read_text()
        return int(re.findall(r"^voluntary_ctxt_switches:\s+(\d+)", status, re.M)[0])

    before, reports = switches(), 0
    while reports < 5:
        reports += until(lambda: host.poll()[0], HEARTBEAT_S)
    assert switches() - before < 40


def test_what_it_could_not_keep_up_with_is_counted(host: EstimatorHost) -> None:
    before = seen(host)
    assert host.pid is not None
    os.kill(host.pid, signal.SIGSTOP)
    for t_ns in range(40):
        host.put(frame(stand_in.SILENT, t_ns))
    os.kill(host.pid, signal.SIGCONT)
    until(lambda: seen(host).dropped_frames == before.dropped_frames + 24)
    assert seen(host).frames == before.frames + 16


def test_a_new_reference_silences_what_is_said_of_the_old(host: EstimatorHost) -> None:
    host.put(frame(stand_in.OK, t_ns=1))
    time.sleep(0.2)
    host.set_reference(reference(0.5))
    host.put(frame(stand_in.OK, t_ns=2))
    (verdict,) = verdicts(host)
    assert (verdict.t_ns, verdict.checks[0].value) == (2, 0.5)


def test_it_is_started_again_after_each_death_with_the_same_reference(impatient: EstimatorHost) -> None:
    host = impatient
    host.set_reference(reference(0.5))
    for restarts, (kill, how) in enumerate((("SIGKILL", "killed by SIGKILL"), ("crash", "ended with exit code 1")), 1):
        before = host.pid
        assert before is not None
        if kill == "SIGKILL":
            os.kill(before, signal.SIGKILL)
        else:
            host.put(frame(stand_in.CRASH))
        until(lambda gone=before: host.poll() and host.pid not in {None, gone})
        until(lambda: host.poll()[0])
        host.put(frame(stand_in.FAULT))
        (verdict,) = verdicts(host)
        assert (verdict.fault, verdict.checks[0].value) == ("polarity", 0.5)
        assert (host.restarts, host.ended) == (restarts, f"{how}, restart {restarts}")


def test_one_that_goes_on_dying_is_named_and_counted_each_time() -> None:
    """By whatever signal: those for real time have no name."""
    command, stream = (sys.executable, "-c", "import os; os.kill(os.getpid(), 40)"), io.StringIO()
    with configure("info", stream):
        host = EstimatorHost(reference(), Limits(), 500_000_000, command)
        until(lambda: host.poll() and host.restarts == 3)
        host.close()
    assert host.ended == "killed by 40, restart 3"
    said = [json.loads(line) for line in stream.getvalue().splitlines()]
    assert [(one["event"], one["how"], one["restart"]) for one in said] == [
        ("estimator ended", "killed by 40", number) for number in (1, 2, 3)
    ]


@pytest.fixture
def impatient() -> Iterator[EstimatorHost]:
    """A host whose timeout is 0.4 of the usual: 2 s instead of 5 s of silence."""
    host = EstimatorHost(reference(), Limits(), 500_000_000, COMMAND, slowness=0.4)
    until(lambda: host.poll()[0])
    yield host
    host.close()


def test_a_hung_one_is_named_and_polling_it_never_waits(impatient: EstimatorHost) -> None:
    host = impatient
    assert host.ended is None
    host.put(frame(stand_in.HANG))
    until(lambda: host.waiting_frames == 0)
    longest_s = 0.0
    for t_ns in range(200):
        host.put(frame(stand_in.OK, t_ns))
        watch = Stopwatch()
        host.poll()
        longest_s = max(longest_s, watch.spent_s())
    assert longest_s < 0.05
    until(lambda: host.poll() and host.ended is not None, 8)
    assert re.fullmatch(r"hung, silent for 2\.\d s, restart 1", str(host.ended))


@pytest.mark.thorough
def test_one_that_no_signal_reaches_holds_up_no_poll_and_is_reaped_later(
    impatient: EstimatorHost, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process that waits in the kernel for a disk dies when the disk has answered, not when it is killed."""
    host = impatient
    first = host._process
    assert first is not None
    monkeypatch.setattr(first, "send_signal", lambda _: None)
    os.kill(first.pid, signal.SIGSTOP)
    longest_s, end_s = 0.0, time.monotonic() + 8
    while host.pid in {None, first.pid} and time.monotonic() < end_s:
        watch = Stopwatch()
        host.poll()
        longest_s = max(longest_s, watch.spent_s())
        time.sleep(0.01)
    assert longest_s < 0.2
    until(lambda: host.poll()[0])
    os.kill(first.pid, signal.SIGKILL)
    until(lambda: host.poll() and first.returncode is not None)
    assert host.restarts == 1


def test_it_dies_with_its_parent(tmp_path: Path) -> None:
    program = """
        import sys, time
        from probewatch.appliance.limits import Limits
        from probewatch.appliance.service.estimator.process_host import EstimatorHost
        from tests.appliance.service.estimator.test_process_host import COMMAND, reference
        host = EstimatorHost(reference(), Limits(), 500_000_000, COMMAND)
        while not host.poll()[0]:
            time.sleep(0.01)
        print(host.pid, flush=True)
        time.sleep(60)
    """
    parent = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(program)],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[4],
    )
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    assert Path(f"/proc/{child}").exists()
    parent.kill()
    parent.communicate()
    until(lambda: not _alive(child), 2)


def _alive(pid: int) -> bool:
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False
