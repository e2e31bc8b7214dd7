"""Programs that others wrote for real trackers, against the simulated ones: the poses they read are those simulated."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from probewatch.drivers.twins.ndi.tool_definitions import PROBE, REFERENCE, make_rom
from tests.support.simulated import Place, matrix_of, probe_place, reference_place, simulated_ndi, write_poses

RATE = "6"
POLARIS_S = [k / 60 for k in range(60 * 60)]
AURORA_S = [(8 * k + 6) / 320 for k in range(40 * 60)]


def read(*arguments: str, path: str | None = None) -> list[dict[str, Any]]:
    """What a client prints."""
    environment = os.environ | ({"PATH": f"{path}{os.pathsep}{os.environ['PATH']}"} if path else {})
    command = [sys.executable, "-m", "tests.support.public_client", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=40, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    readings: list[dict[str, Any]] = json.loads(done.stdout.splitlines()[-1])
    return readings


def check(readings: list[dict[str, Any]], counter_hz: int, **places: tuple[int, Place]) -> None:
    """Every reading of a handle equals the place at its frame number; the probe was seen at several."""
    for tool, (handle, place) in places.items():
        found = [reading for reading in readings if reading["handle"] == handle]
        assert len({reading["frame"] for reading in found}) >= 3, tool
        for reading in found:
            true = matrix_of(place(reading["frame"] / counter_hz))
            np.testing.assert_allclose(reading["t"], true[:3, 3], atol=1e-3)
            w, x, y, z = reading["q"]
            np.testing.assert_allclose(Rotation.from_quat([x, y, z, w]).as_matrix(), true[:3, :3], atol=3e-4)


@pytest.fixture
def roms(tmp_path: Path) -> list[str]:
    paths = [tmp_path / "probe.rom", tmp_path / "reference.rom"]
    for path, main_type in zip(paths, (PROBE, REFERENCE), strict=True):
        path.write_bytes(make_rom(main_type))
    return [str(path) for path in paths]


@pytest.fixture
def polaris_poses(tmp_path: Path) -> str:
    return str(write_poses(tmp_path / "p.csv", POLARIS_S, probe=probe_place, reference=reference_place))


@pytest.mark.parametrize("command", ["TX", "BX"])
def test_ndicapi_through_a_pseudo_terminal(command: str, tmp_path: Path, roms: list[str], polaris_poses: str) -> None:
    pytest.importorskip("ndicapy", reason="ndicapi has no wheel for this Python")
    link = str(tmp_path / "tracker")
    arguments = ["--model", "polaris-spectra", "--pty", link, "--poses", polaris_poses, "--rate", RATE]
    with simulated_ndi(tmp_path, *arguments):
        readings = read(command, link, *roms)
    check(readings, 60, probe=(1, probe_place), reference=(2, reference_place))


def test_scikit_as_polaris_through_a_pseudo_terminal(tmp_path: Path, roms: list[str], polaris_poses: str) -> None:
    pytest.importorskip("sksurgerynditracker", reason="scikit-surgerynditracker is not for this Python")
    link = str(tmp_path / "tracker")
    settings = {"tracker type": "polaris", "romfiles": roms, "serial port": link}
    with simulated_ndi(tmp_path, "--model", "polaris-vicra", "--pty", link, "--poses", polaris_poses, "--rate", RATE):
        readings = read("scikit", json.dumps(settings))
    check(readings, 60, probe=(1, probe_place), reference=(2, reference_place))


def test_scikit_as_aurora_through_a_pseudo_terminal(tmp_path: Path) -> None:
    pytest.importorskip("sksurgerynditracker", reason="scikit-surgerynditracker is not for this Python")
    link = str(tmp_path / "tracker")
    poses = str(write_poses(tmp_path / "p.csv", AURORA_S, probe=probe_place, reference=reference_place))
    settings = {"tracker type": "aurora", "serial port": link}
    with simulated_ndi(tmp_path, "--model", "aurora", "--pty", link, "--poses", poses, "--rate", RATE):
        readings = read("scikit", json.dumps(settings))
    check(readings, 320, probe=(1, probe_place), reference=(2, reference_place))


def test_scikit_as_vega_over_tcp(tmp_path: Path, roms: list[str], polaris_poses: str) -> None:
    pytest.importorskip("sksurgerynditracker", reason="scikit-surgerynditracker is not for this Python")
    ping = tmp_path / "bin" / "ping"
    ping.parent.mkdir()
    ping.write_text("#!/bin/sh\nexit 0\n")
    ping.chmod(0o755)
    with simulated_ndi(tmp_path, "--model", "vega", "--tcp", "0", "--poses", polaris_poses, "--rate", RATE) as device:
        port = int(device.url.rpartition(":")[2])
        settings = {"tracker type": "vega", "ip address": "127.0.0.1", "port": port, "romfiles": roms}
        readings = read("scikit", json.dumps(settings), path=str(ping.parent))
    check(readings, 60, probe=(1, probe_place), reference=(2, reference_place))
