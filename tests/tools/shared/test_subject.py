"""What a replay report says that it is of: terminal, JSON and page."""

import json
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.appliance.types import Calibration
from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from probewatch.tools.commands.replay import command
from tests.support.recordings import items

SIZE_PX = (48, 32)


def test_a_table_of_several_says_by_what_they_were_judged(tmp_path: Path) -> None:
    """Each row names its recording."""
    probe = tmp_path / "probe.toml"
    write_calibration(probe, Calibration(np.eye(3), (1, 1), np.array([0.2, 0.2]), np.zeros(3), SIZE_PX), {})
    for name in ("a.igs.mha", "b.igs.mha"):
        write_metaimage(tmp_path / name, items(10, SIZE_PX), SIZE_PX)
    words = [str(tmp_path / "a.igs.mha"), str(tmp_path / "b.igs.mha"), "--calibration", str(probe), "--json"]
    answer = CliRunner().invoke(command, words, catch_exceptions=False)
    told = json.loads(answer.stdout)["of"]
    assert (told["recording"], told["configuration"], told["injected"]) == ([], None, [])
    assert told["calibration"] == {"file": str(probe), "sha256": sha256sum(probe)}
    assert re.fullmatch(r"probewatch \S+", told["software"])
    assert f"calibration:      probe.toml, SHA-256 {sha256sum(probe)[:12]}" in answer.stderr
    assert "limits and times: as probewatch ships them" in answer.stderr


def sha256sum(path: Path) -> str:
    """By coreutils."""
    return subprocess.run(["sha256sum", path], capture_output=True, text=True, check=True).stdout.split()[0]


@pytest.mark.parametrize("spoiled", [[], ["--inject", "flip-lateral@0.1", "--inject", "depth"]])
def test_a_report_names_what_it_is_of_and_whether_it_was_spoiled(tmp_path: Path, spoiled: list[str]) -> None:
    scan, probe = tmp_path / "scan.igs.mha", tmp_path / "probe.toml"
    write_metaimage(scan, items(20, SIZE_PX), SIZE_PX)
    write_calibration(probe, Calibration(np.eye(3), (1, 1), np.array([0.2, 0.2]), np.zeros(3), SIZE_PX), {})
    page = tmp_path / "page.html"
    where = [str(scan), "--calibration", str(probe), "--json", "--html", str(page)]
    answer = CliRunner().invoke(command, [*where, *spoiled], catch_exceptions=False)
    said, told = answer.stderr, json.loads(answer.stdout)["of"]
    assert told["recording"] == [{"file": str(scan), "sha256": sha256sum(scan)}]
    assert told["calibration"] == {"file": str(probe), "sha256": sha256sum(probe)}
    assert told["configuration"] is None
    assert told["injected"] == (["flip-lateral@0.1", "depth@0"] if spoiled else [])
    assert re.fullmatch(r"probewatch \S+", told["software"])
    assert f"calibration:      probe.toml, SHA-256 {sha256sum(probe)[:12]}" in said
    title = re.search("<title>([^<]*)", page.read_text())
    assert title is not None
    assert title[1] == ("probewatch: SPOILED: scan.igs.mha" if spoiled else "probewatch: scan.igs.mha")
    assert str(tmp_path) not in page.read_text(), "a name tells the file; where it lay is its owner's business"
    assert sha256sum(scan)[:12] in page.read_text()
    assert (said.count("SPOILED on purpose: --inject flip-lateral@0.1, depth@0"), "SPOILED" in said) == (
        (2, True) if spoiled else (0, False)
    )
