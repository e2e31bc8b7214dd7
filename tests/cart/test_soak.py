"""`make soak`: half an hour of the installed service at full speed, 30 pictures and 60 poses a second."""

import json
import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from tests.cart.cart_in_container import main_pid, start_service, start_twins
from tests.cart.container import Container

pytestmark = pytest.mark.slow

MINUTES = float(os.environ.get("PROBEWATCH_SOAK_MINUTES", "30"))
SETTLE_S = 60.0
EVERY_S = 10.0
STATUS = (Path(__file__).parent / "inside/status.py").read_text()


@dataclass(frozen=True)
class Reading:
    """t_s: host. rss_mib, files: of the service's processes together. counters: of its status."""

    t_s: float
    rss_mib: float
    files: int
    processor_s: float
    counters: dict[str, int]
    fps: dict[str, float]


def read(machine: Container) -> Reading:
    pid = main_pid(machine)
    own = f"{pid} $(pgrep -P {pid})"
    rss = machine.sh(f"for p in {own}; do grep VmRSS /proc/$p/status; done").out.splitlines()
    files = machine.sh(f"for p in {own}; do ls /proc/$p/fd | wc -l; done").out.split()
    stats = machine.sh(f"for p in {own}; do cat /proc/$p/stat; done").out.splitlines()
    ticks = sum(int(word) for line in stats for word in line.rpartition(")")[2].split()[11:13])
    status = json.loads(machine.sh("python3 /run/status.py").out)
    return Reading(
        time.monotonic(),
        sum(int(line.split()[1]) for line in rss) / 1024,
        sum(map(int, files)),
        ticks / os.sysconf("SC_CLK_TCK"),
        status["counters"],
        status["fps"],
    )


def test_memory_and_files_stay_and_every_picture_is_accounted_for(container: Container) -> None:
    start_twins(container, fps=30.0)
    start_service(container)
    container.put("/run/status.py", STATUS)
    pid = main_pid(container)
    time.sleep(SETTLE_S)
    readings = [read(container)]
    end_s = readings[0].t_s + MINUTES * 60
    while readings[-1].t_s < end_s:
        time.sleep(EVERY_S)
        readings.append(read(container))
    assert main_pid(container) == pid
    report(readings)
    require(readings)


def report(readings: list[Reading]) -> None:
    first, last = readings[0], readings[-1]
    elapsed_s = last.t_s - first.t_s
    told = {name: last.counters[name] - first.counters[name] for name in last.counters}
    print(f"{elapsed_s / 60:.1f} minutes on {os.cpu_count()} cores, load {os.getloadavg()[1]:.1f}")
    print(f"memory {first.rss_mib:.1f} → {last.rss_mib:.1f} MiB, files {first.files} → {last.files}")
    share = 100 * (last.processor_s - first.processor_s) / elapsed_s
    print(f"processor {share:.0f} % of one core; rates {last.fps}; counted {told}")


def require(readings: list[Reading]) -> None:
    """Growth by a straight line over all readings, in what an hour would bring."""
    hours = np.array([(one.t_s - readings[0].t_s) / 3600 for one in readings])
    growth_mib_h = np.polynomial.Polynomial.fit(hours, [one.rss_mib for one in readings], 1).convert().coef[1]
    print(f"memory grows by {growth_mib_h:.2f} MiB an hour")
    assert growth_mib_h < 8.0
    assert max(one.files for one in readings[1:]) - readings[0].files <= 1, "the status client's own connection"
    first, last = readings[0].counters, readings[-1].counters
    frames, gaps = (last[name] - first[name] for name in ("frames", "frame_gaps"))
    sent = (readings[-1].t_s - readings[0].t_s) * 30.0
    assert frames + gaps == pytest.approx(sent, abs=30 + 0.002 * sent), "every picture came, or is a counted gap"
    assert last["estimator_restarts"] == first["estimator_restarts"]
