"""`make soak`: half an hour of the installed service at full speed, 30 pictures and 60 poses a second."""

import json
import os
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.cart.bench import journal
from tests.cart.cart_in_container import come_first, main_pid, said, start_service, start_twins
from tests.cart.container import Container
from tests.cart.growth import Finding, growth

pytestmark = pytest.mark.slow

MINUTES = float(os.environ.get("PROBEWATCH_SOAK_MINUTES", "30"))
"""Shorter runs are for trying; only from ten minutes on do they tell whether memory grows."""
SETTLE_S, EVERY_S = 120.0, 10.0
FPS = 30.0
GROWTH_MIB_H, GROWTH_MIB = 8.0, 4.0
JITTER = 15
"""Pictures by which a reading may be late: half a second, the longest that the simulated scanner waits to send one."""
STATUS = (Path(__file__).parent / "inside/status.py").read_text()


@dataclass(frozen=True)
class Reading:
    """t_s: host. rss_mib, files: of the service's processes, its own first. counters, fps, tick: of its status."""

    t_s: float
    rss_mib: tuple[float, ...]
    files: tuple[int, ...]
    processor_s: float
    counters: dict[str, int]
    fps: dict[str, float]
    tick: dict[str, float]


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
        tuple(int(line.split()[1]) / 1024 for line in rss),
        tuple(map(int, files)),
        ticks / os.sysconf("SC_CLK_TCK"),
        status["counters"],
        status["fps"],
        status["tick"],
    )


def test_memory_and_files_stay_and_every_picture_is_accounted_for(container: Container) -> None:
    start_twins(container, fps=FPS)
    start_service(container)
    come_first(container)
    container.put("/run/status.py", STATUS)
    pid = main_pid(container)
    time.sleep(SETTLE_S)
    readings = [read(container)]
    end_s = readings[0].t_s + MINUTES * 60
    while readings[-1].t_s < end_s:
        time.sleep(EVERY_S)
        readings.append(read(container))
    account = scanner_account(container)
    after = read(container)
    assert main_pid(container) == pid
    report(container, readings)
    require_flat(readings)
    require_every_picture(readings, after, account)


def scanner_account(machine: Container) -> dict[str, int]:
    """What the scanner says of its own pictures when it is switched off; whatever it sent has been read then."""
    machine.sh("systemctl stop twin-scanner")
    time.sleep(2)
    (account,) = (event["account"] for event in said(machine, "scanner") if "account" in event)
    assert isinstance(account, dict)
    return account


def report(machine: Container, readings: list[Reading]) -> None:
    first, last = readings[0], readings[-1]
    elapsed_s = last.t_s - first.t_s
    told = {name: last.counters[name] - first.counters[name] for name in last.counters}
    print(f"{elapsed_s / 60:.1f} minutes on {os.cpu_count()} cores, load {os.getloadavg()[2]:.1f}")
    for number, name in enumerate(("service", "estimator")):
        rss = [one.rss_mib[number] for one in readings]
        files = [one.files[number] for one in readings]
        print(f"{name}: RSS {rss[0]:.1f} → {rss[-1]:.1f} MiB ({min(rss):.1f} … {max(rss):.1f}), ", end="")
        print(f"files {files[0]} → {files[-1]} ({min(files)} … {max(files)})")
    share = 100 * (last.processor_s - first.processor_s) / elapsed_s
    print(f"processor {share:.0f} % of one core; {told['frames'] / elapsed_s:.1f} pictures/s, ", end="")
    print(f"{told['poses'] / elapsed_s:.1f} poses/s; ticks {last.tick}; counted {told}")
    entries = journal(machine)
    lost = Counter(
        f"{entry['PROBEWATCH_DEVICE']}: {entry['PROBEWATCH_WHAT']}"
        for entry in entries
        if entry.get("PROBEWATCH_EVENT") == "device lost"
    )
    print(f"devices lost: {dict(lost)}")
    told = [entry for entry in entries if entry.get("PROBEWATCH_EVENT") == "state"]
    states = [f"{entry['PROBEWATCH_STATE']} ({entry.get('PROBEWATCH_FAULT', '')})" for entry in told]
    print(f"states: {' → '.join(states[:12])}{f' … {len(states)} in all' if len(states) > 12 else ''}")


def require_flat(readings: list[Reading]) -> None:
    seen = growth([one.t_s for one in readings], [sum(one.rss_mib) for one in readings])
    finding = seen.finding(GROWTH_MIB_H, GROWTH_MIB)
    print(f"memory: {seen.per_h:+.2f} ± {seen.error_per_h:.2f} MiB an hour, ", end="")
    print(f"first tenth {seen.first:.1f}, last tenth {seen.last:.1f} MiB: {finding.value}")
    assert finding is Finding.FLAT or (finding is Finding.UNTOLD and MINUTES < 30)
    files = [sum(one.files) for one in readings]
    assert max(files) - min(files) <= 1, "the status client's own connection"


def require_every_picture(readings: list[Reading], after: Reading, account: dict[str, int]) -> None:
    """The scanner's own account, and the clock: it numbers its pictures by time."""
    took, gaps = after.counters["frames"], after.counters["frame_gaps"]
    print(f"the scanner sent {account['sent']} pictures and skipped {account['skipped']} for being late; ", end="")
    print(f"the service took {took} and counted {gaps} gaps; ", end="")
    print(f"{after.counters['dropped_frames']} came faster than the estimator took them")
    assert (took, gaps) == (account["sent"], account["skipped"])
    first, last = readings[0].counters, readings[-1].counters
    numbered = sum(last[name] - first[name] for name in ("frames", "frame_gaps"))
    assert numbered == pytest.approx((readings[-1].t_s - readings[0].t_s) * FPS, abs=JITTER)
    assert last["estimator_restarts"] == first["estimator_restarts"]
