"""What a tracker costs of the one core that all devices share, at its usual and at its highest rate."""

import time
from pathlib import Path

import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.device_api import TrackerSource
from probewatch.drivers.registry import open_tracker
from probewatch.drivers.twins.ndi.tool_definitions import PROBE, REFERENCE, make_rom
from tests.support.simulated import simulated_ndi

SETTLED_S = 2.0
WINDOWS, WINDOW_S = 10, 1.0


def four_tools(folder: Path) -> str:
    """Probe, reference and two more, as options of a URL."""
    for name, main_type in (("probe", PROBE), ("reference", REFERENCE), ("third", PROBE), ("fourth", PROBE)):
        (folder / f"{name}.rom").write_bytes(make_rom(main_type))
    files = {name: folder / f"{name}.rom" for name in ("probe", "reference", "third", "fourth")}
    return f"probe={files['probe']}&reference={files['reference']}&tools={files['third']},{files['fourth']}"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "rate_hz", "reply", "most"),
    [("polaris-spectra", 60, "bx", 0.05), ("vega", 400, "bx2", 0.25)],
    ids=["60 Hz BX", "400 Hz BX2"],
)
def test_share_of_one_core(
    model: str, rate_hz: int, reply: str, most: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Processor time of this process, in which nothing runs but the driver.

    The least of several windows: whatever else runs on the machine cools the caches and can only add to it. Where the
    simulator cannot keep up, what it costs is scaled to the full rate.
    """
    network = reply == "bx2"
    line = ["--tcp", "0"] if network else ["--pty", str(tmp_path / "tracker")]
    speed = "" if network else "&baud=921600"  # at 115200 the replies alone take all of the time
    options = f"{four_tools(tmp_path)}&reply={reply}{speed}&deadline_ms=2000"
    with (
        simulated_ndi(tmp_path, "--model", model, "--track-hz", str(rate_hz), *line) as device,
        open_tracker(f"{device.url}?{options}", HostClock()) as tracker,
    ):
        window(tracker, SETTLED_S)
        windows = [window(tracker, WINDOW_S) for _ in range(WINDOWS)]
    with capsys.disabled():
        print("", ", ".join(f"{100 * share:.1f} % at {per_s:.0f}/s" for share, per_s in windows))
    assert min(share * max(1.0, rate_hz / per_s) for share, per_s in windows) < most


def window(tracker: TrackerSource, seconds: float) -> tuple[float, float]:
    """(share of one core, poses per second) over the next while."""
    poses, wall_s, busy_s = 0, time.perf_counter(), time.process_time()
    while time.perf_counter() < wall_s + seconds:
        poses += tracker.read(0.1) is not None
    busy_s, wall_s = time.process_time() - busy_s, time.perf_counter() - wall_s
    return busy_s / wall_s, poses / wall_s
