"""Pictures on the disk: rendered once for all processes, never half of one, and no more of them than is allowed."""

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from probewatch.drivers.twins.scene.world import World, WorldSettings
from tests.support import kept_pictures
from tests.support.sessions import KeptWorld

TINY = WorldSettings(width_px=60, height_px=40)
SIZE_PX = (60, 40)
IMAGE = np.arange(60 * 40, dtype=np.uint8).reshape(40, 60)


def never() -> np.ndarray:
    raise AssertionError("rendered again")


def test_a_picture_is_rendered_once_for_all_worlds_of_its_scene(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept_pictures, "FOLDER", tmp_path)
    first = KeptWorld(1, "sweep", "tissue", TINY).frame(0.1, 3)
    assert np.array_equal(first, World(1, settings=TINY).frame(0.1, 3))
    (path,) = (path for path in tmp_path.rglob("*") if path.is_file())
    kept = path.read_bytes()
    path.write_bytes(bytes(len(kept)))
    assert not np.array_equal(KeptWorld(1, "sweep", "tissue", TINY).frame(0.1, 3), first), "it is taken from the disk"
    others = KeptWorld(2, "sweep", "tissue", TINY), KeptWorld(1, "sweep", "tissue", WorldSettings(60, 40, gain_db=9.0))
    assert all(other.frame(0.1, 3).any() for other in others), "another seed or setting is another scene"


def test_what_a_lost_process_or_computer_left_is_rendered_again(tmp_path: Path) -> None:
    path = tmp_path / "picture"
    for left in (b"", IMAGE.tobytes()[:-1]):
        path.write_bytes(left)
        assert np.array_equal(kept_pictures.picture(path, SIZE_PX, IMAGE.copy), IMAGE)
        assert np.array_equal(kept_pictures.picture(path, SIZE_PX, never), IMAGE)


def _put_often(path: Path) -> None:
    for _ in range(300):
        path.unlink(missing_ok=True)
        kept_pictures.picture(path, SIZE_PX, IMAGE.copy)


def test_nobody_reads_half_a_picture_while_another_worker_writes_it(tmp_path: Path) -> None:
    path = tmp_path / "picture"
    seen = 0
    with ThreadPoolExecutor(1) as pool:
        writing = pool.submit(_put_often, path)
        while not writing.done():
            assert np.array_equal(kept_pictures.picture(path, SIZE_PX, IMAGE.copy), IMAGE)
            seen += 1
        writing.result()
    assert seen > 10
    assert [one.name for one in tmp_path.iterdir()] == ["picture"], "nothing else is left"


def test_those_that_were_not_used_for_longest_go_first(tmp_path: Path) -> None:
    for number in range(5):
        (tmp_path / f"scene-{number % 2}").mkdir(exist_ok=True)
        path = tmp_path / f"scene-{number % 2}" / str(number)
        kept_pictures.picture(path, SIZE_PX, IMAGE.copy)
        os.utime(path, (number, number))
    kept_pictures.picture(tmp_path / "scene-0/0", SIZE_PX, never)
    kept_pictures.limit(tmp_path, 3 * IMAGE.size)
    assert sorted(path.name for path in tmp_path.rglob("?")) == ["0", "3", "4"]
