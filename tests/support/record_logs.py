"""`python -m tests.support.record_logs`: the regression logs of all simulated trackers, and what they decode to."""

import json
import tempfile
from contextlib import suppress
from pathlib import Path

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.registry import open_tracker
from tests.support.decoded import decoded
from tests.support.simulated import probe_place, reference_place, simulated_ndi, write_poses

LOGS = Path(__file__).parents[1] / "data" / "logs"
AURORA_OPTIONS = "probe=@1&reference=@2&counter_hz=320"
"""The rate of the counter is given, as finding it out takes as many requests as there is time for."""
_SCENES = {
    "polaris-vicra": ["missing@1.6..2.0", "partial@2.2..2.5", "bump@2.8"],
    "polaris-spectra": ["missing@1.2..1.3", "out-of-volume@1.4..1.5", "corrupt-crc@1.6..1.7", "hot@1.8"],
    "vega": ["missing@0.6..0.7", "partial@0.8..0.9", "interference@1.0..1.1", "bump@1.2"],
    "aurora": ["missing@1.8..1.9", "interference@2.0..2.1", "out-of-volume@2.2..2.3"],
}
_END_S = {"polaris-vicra": 3.2, "polaris-spectra": 2.0, "vega": 1.35, "aurora": 2.4}


def record(model: str, folder: Path) -> None:
    """One log and its decoded poses."""
    clock = HostClock()
    log = LOGS / f"{model}.log"
    log.unlink(missing_ok=True)
    times_s = [k / 60 for k in range(240)]
    poses = write_poses(folder / "poses.csv", times_s, probe=probe_place, reference=reference_place)
    line = ["--tcp", "0"] if model == "vega" else ["--pty", str(folder / "tracker")]
    tools = [] if model == "aurora" else ["--rom", f"{folder}/probe.rom", "--reference-rom", f"{folder}/reference.rom"]
    faults = [word for fault in _SCENES[model] for word in ("--fault", fault)]
    found = []
    with simulated_ndi(folder, "--model", model, *line, "--poses", str(poses), *tools, *faults) as device:
        end_ns = clock.now_ns() + round(_END_S[model] * 1e9)
        url = f"{device.url}{'&' if tools else f'?{AURORA_OPTIONS}&'}log={log}&deadline_ms=500"
        with suppress(DeviceLost), open_tracker(url, clock) as tracker:
            while clock.now_ns() < end_ns:
                pose = tracker.read(0.1)
                found += [] if pose is None else [pose]
    lines = [json.dumps(entry) for entry in decoded(found)]
    (LOGS / f"{model}.json").write_text("[\n" + ",\n".join(lines) + "\n]\n")


if __name__ == "__main__":
    for name in _SCENES:
        with tempfile.TemporaryDirectory() as place:
            record(name, Path(place))
