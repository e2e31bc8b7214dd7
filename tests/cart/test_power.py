"""The plug is pulled, again and again, while the machine writes."""

import random
import shutil
import subprocess
import time
import tomllib
from pathlib import Path

from probewatch.appliance.storage.alarm_chain import Reading, read_log
from probewatch.appliance.storage.calibration_file import read_calibration
from tests.cart.guest import PYTHON, SCRIPTS, Guest
from tests.cart.image import run
from tests.support.polling import until

CUTS, WRITING = 20, "writing"
STATE = "/var/lib/probewatch"
START_S = 240.0


def test_no_acknowledged_record_is_lost_by_a_power_cut(guest: Guest, tmp_path: Path) -> None:
    """The package's own alarm log and calibration writer, as fast as the disk allows. What was acknowledged on the
    serial port before the cut must be there after it, and the calibration must be one of the two that were written.
    """
    acks = tmp_path / "acknowledged"
    guest.ports.printed = acks
    writing, when, total = _snapshot_while_writing(guest, acks, tmp_path), random.Random(7), 0
    for number in range(CUTS):
        acks.unlink(missing_ok=True)
        guest.resume(writing, WRITING)
        before = _await_more(acks, 0)
        time.sleep(when.uniform(0.5, 3.0))
        guest.cut_power()
        last = _last(acks)
        total += last - before + 1
        found = _after_the_cut(guest.disk, tmp_path)
        assert last >= before > 0
        assert found.entries[-1].number >= last, f"cut {number}: {last} was acknowledged"
        assert [one for one in found.damages if one.fault] == [], f"cut {number}"
        source = read_calibration_name(tmp_path / "kept/calibration.toml")
        assert source in ("first", "second"), f"cut {number}"
    print(f"{CUTS} power cuts, {total} acknowledged entries, none lost, every file system clean")
    assert total > 2 * CUTS


def _snapshot_while_writing(guest: Guest, acks: Path, folder: Path) -> Path:
    """Taken once, so that each cut needs no start of Python under emulation."""
    guest.restore()
    guest.put_scripts()
    guest.begin(f"{PYTHON} {SCRIPTS}/writer.py {STATE} /dev/ttyS2")
    _await_more(acks, 12, START_S)
    guest.qmp("human-monitor-command", {"command-line": f"savevm {WRITING}"})
    guest.cut_power()
    return guest.disk.rename(folder / "writing.qcow2")


def _await_more(acks: Path, than: int, deadline_s: float = 30.0) -> int:
    """The first acknowledged number above that."""
    until(lambda: acks.exists() and _last(acks) > than, deadline_s, 0.02, lambda: "nothing is acknowledged")
    return _last(acks)


def _last(acks: Path) -> int:
    """The last whole line; 0 before the first."""
    whole = acks.read_bytes().replace(b"\r", b"").rpartition(b"\n")[0]
    return int(whole.rpartition(b"\n")[2] or 0)


def _after_the_cut(disk: Path, folder: Path) -> Reading:
    """The file system recovers as at a boot, is clean then, and the log is read from it."""
    raw, kept = folder / "cut.raw", folder / "kept"
    run("qemu-img", "convert", "-O", "raw", str(disk), str(raw))
    recovery = subprocess.run(["e2fsck", "-fy", raw], capture_output=True, text=True, check=False)
    assert recovery.returncode in (0, 1), recovery.stdout
    run("e2fsck", "-fn", str(raw))
    shutil.rmtree(kept, ignore_errors=True)
    kept.mkdir()
    run("debugfs", "-R", f"rdump {STATE} {kept}", str(raw))
    raw.unlink()
    for file in (kept / Path(STATE).name).iterdir():
        file.rename(kept / file.name)
    return read_log(kept)


def read_calibration_name(path: Path) -> str:
    """Raises when the file is not whole."""
    read_calibration(path)
    return str(tomllib.loads(path.read_text())["provenance"]["name"])
