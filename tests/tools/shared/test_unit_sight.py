"""Paths that the person who configures sees, and the service does not."""

from pathlib import Path

import pytest

from probewatch.tools.shared.unit_sight import relative
from tests.support.answers import answered


@pytest.mark.parametrize("url", ["ndi:tty", "ndi:/dev/x?probe=probe.rom@2,other.rom", "sim:scanner"])
def test_a_path_from_this_folder_is_told_with_the_whole_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, url: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert list(relative(url)) == [], "a host, or nothing that is here"
    for name in ("tty", "probe.rom", "scanner"):
        (tmp_path / name).touch()
    (why,) = relative(url)
    assert str(tmp_path) in why
    assert list(relative(f"ndi:{tmp_path}/tty?probe={tmp_path}/probe.rom")) == []


def test_the_number_of_a_camera_is_no_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "0").touch()
    assert list(relative("opencv:0")) == []


def test_configure_refuses_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A service that systemd starts looks for it in /."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "board").touch()
    urls = ["--video", "v4l2:/dev/video0", "--tracker", "ndi:/dev/ttyUSB0", "--contact", "relay:board?channel=1"]
    more = ["--untried", "--no-calibration", "--profile", "coarse", "--language", "en", "--yes"]
    answer = answered("configure", tmp_path / "cart.toml", *urls, *more)
    assert answer.returncode == 78, answer
    assert f"Write {tmp_path}/board" in answer.stderr
    assert not (tmp_path / "cart.toml").exists()
