"""An archive on a Dask cluster whose scheduler vanishes or hangs."""

import signal
import socket
import subprocess
import sys
import threading
import time

import pytest

from probewatch.tools.study import workers
from tests.support.polling import until


class Cluster:
    """A scheduler and a worker of their own processes, as often as they are started."""

    def __init__(self) -> None:
        with socket.create_server(("127.0.0.1", 0)) as door:
            self.port = int(door.getsockname()[1])
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.start()

    def start(self) -> None:
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        begin = [sys.executable, "-m"]
        place = ["--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard"]
        self.scheduler = subprocess.Popen([*begin, "distributed.cli.dask_scheduler", *place], **quiet)
        until(self._listens, 30)
        how = ["--nthreads", "1", "--no-dashboard", "--no-nanny", "--name", "one"]
        self.worker = subprocess.Popen([*begin, "distributed.cli.dask_worker", self.address, *how], **quiet)

    def kill(self) -> None:
        for process in (self.scheduler, self.worker):
            process.kill()
            process.wait()

    def _listens(self) -> bool:
        with socket.socket() as link:
            return link.connect_ex(("127.0.0.1", self.port)) == 0


def slowly(task: int) -> int:
    time.sleep(0.1)
    return task


@pytest.mark.thorough
def test_a_scheduler_that_vanishes_is_said_once_and_what_was_left_is_done_when_it_is_back() -> None:
    cluster, said, done = Cluster(), list[str](), list[int]()

    def vanish() -> None:
        cluster.kill()
        time.sleep(2.5)
        cluster.start()

    gone = threading.Thread(target=vanish)
    try:
        for result in workers.results(slowly, range(20), 1, cluster.address, said.append):
            done.append(result)
            if len(done) == 5:
                gone.start()
        gone.join()
    finally:
        cluster.kill()
    assert sorted(done) == list(range(20)), "each once"
    assert [one.partition(cluster.address)[2].partition(";")[0] for one in said] == [" has gone", " is back"]


@pytest.mark.thorough
def test_a_scheduler_that_hangs_is_said_once_and_what_was_left_is_done_when_it_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Stopped, it keeps its connections; it goes on once that was said. A busy computer may make it hang once more."""
    monkeypatch.setattr(workers, "_LOOK_S", 0.5)
    cluster, said, done = Cluster(), list[str](), list[int]()

    def say(text: str) -> None:
        said.append(text)
        cluster.scheduler.send_signal(signal.SIGCONT)

    try:
        for result in workers.results(slowly, range(20), 1, cluster.address, say):
            done.append(result)
            if len(done) == 5:
                cluster.scheduler.send_signal(signal.SIGSTOP)
    finally:
        cluster.kill()
    assert sorted(done) == list(range(20)), "each once"
    told = [one.partition(cluster.address)[2].partition(";")[0] for one in said]
    assert told
    assert told == [" hangs", " is back"] * (len(told) // 2)
