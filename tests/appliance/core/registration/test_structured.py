"""The compiled choice of points against whatever it is given: it ends, and writes nowhere else."""

import multiprocessing
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from probewatch.appliance.core.registration import points
from probewatch.appliance.core.registration.points import Fit, Picture, Template
from probewatch.appliance.core.registration.template import template

INT32 = st.integers(-(2**31), 2**31 - 1)
EXTREME = st.sampled_from([-(2**31), -1, 0, 1, 2, 3, 32767, 32768, 8388608, 2**31 - 1])
SHARE = st.floats(allow_nan=True, allow_infinity=True)
CANARY = -123456789


def level(rows: int, columns: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).integers(-32768, 32767, (rows, columns), dtype=np.int16)


def chosen_raw(grey: np.ndarray, rows: int, columns: int, numbers: tuple[int, int, float, int]) -> np.ndarray:
    """What C itself finds, without the checks of Python; the room for it is that of all pixels, with a border."""
    picture = Picture(grey)
    picture._rows, picture._columns = rows, columns
    pitch, edge, share, steep = numbers
    found = np.full(grey.size + 64, CANARY, np.int32)
    count = points._structured(picture, None, pitch, edge, share, steep, found[32:].ctypes.data)
    assert 0 <= count <= grey.size
    assert (found[:32] == CANARY).all()
    assert (found[-32:] == CANARY).all()
    return found[32 : 32 + count]


@settings(max_examples=200, deadline=None)
@given(INT32 | EXTREME, INT32 | EXTREME, SHARE, INT32 | EXTREME)
def test_numbers_of_every_size(pitch: int, edge: int, share: float, steep: int) -> None:
    grey = level(40, 50)
    found = chosen_raw(grey, 40, 50, (pitch, edge, share, steep))
    if min(pitch, edge) < 1:
        assert found.size == 0
    rows, columns = np.divmod(found, 50)
    if found.size:
        assert min(rows.min(), columns.min()) >= edge
        assert rows.max() < 40 - edge
        assert columns.max() < 50 - edge


@settings(max_examples=200, deadline=None)
@given(st.sampled_from([-(2**31), -1, 0, 1, 2, 5, 32768, 2**31 - 1]), st.sampled_from([-(2**31), -1, 0, 1, 2, 7]))
def test_sides_that_are_none(rows: int, columns: int) -> None:
    """Sides beyond 32767 px hold nothing, whatever the memory behind them is."""
    assert chosen_raw(level(5, 7), rows, columns, (1, 1, 0.02, 3)).size <= 35
    assert chosen_raw(level(5, 7), columns, rows if rows != 5 else 0, (1, 1, 0.02, 3)).size <= 35


@settings(max_examples=80, deadline=None)
@given(
    arrays.arrays(np.int16, arrays.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=40)),
    st.integers(-3, 50),
    st.integers(-3, 50),
    SHARE,
)
def test_the_way_from_python(grey: np.ndarray, pitch: int, edge: int, share: float) -> None:
    try:
        picture = Picture(grey)
    except ValueError:
        assert min(grey.shape) < 2
        return
    if min(pitch, edge) < 1:
        with pytest.raises(ValueError, match="choose no points"):
            picture.structured(None, pitch, edge, share, 3)
        return
    found = picture.structured(None, pitch, edge, share, 3)
    assert np.unique(found).size == found.size
    with pytest.raises(ValueError, match="a mask of"):
        picture.structured(np.ones((1, 1), np.bool_), pitch, edge, share, 3)


ODD = st.floats(allow_nan=True, allow_infinity=True)


@settings(max_examples=100, deadline=None)
@given(ODD, ODD, ODD, ODD, ODD, ODD, st.integers(-3, 3), ODD)
def test_a_descent_with_any_numbers_ends(
    u_x: float, u_y: float, alpha: float, gain: float, bias: float, aspect: float, steps: int, reach: float
) -> None:
    grey = level(64, 80) // 8
    chosen = template(grey, 1.0, (39.5, 31.5), aspect, 20.0, 500, None)
    assert isinstance(chosen, Template)
    fit = Fit(u_x, u_y, alpha, gain, bias)
    chosen.descend(Picture(grey), fit, steps, 0.1, responding=True)
    correlations, share = chosen.correlate(Picture(grey), fit, reach)
    assert len(correlations) == 5
    assert 0 <= share <= 1
    fit.drawn(aspect, fit.together(), np.full(6, reach))


LOOPED = ((0, 1, 0.02, 3), (-1, 1, 0.02, 3), (2**31 - 1, 1, 0.02, 3), (1, 2**31 - 1, 0.0, 0))


def all_that_looped() -> None:
    for numbers in LOOPED:
        chosen_raw(level(40, 50), 40, 50, numbers)


def test_what_looped_for_ever_ends() -> None:
    """In a process of its own, because nothing else ends such a loop."""
    child = multiprocessing.get_context("spawn").Process(target=all_that_looped)
    child.start()
    child.join(20)
    hung, code = child.is_alive(), child.exitcode
    child.kill()
    assert (hung, code) == (False, 0)


SANITIZED = "PROBEWATCH_SANITIZED"


@pytest.mark.slow
def test_the_sanitizers_find_nothing(tmp_path: Path) -> None:
    """These tests again, with the C compiled by GCC to end at the first undefined step or foreign byte."""
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("no GCC here: its sanitizers are asked, Zig's wheel brings none for addresses")
    core = Path(points.__file__).parent
    library = tmp_path / "sanitized.so"
    flags = ["-std=c11", "-O1", "-g", "-shared", "-fPIC", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    subprocess.run([compiler, *flags, "-o", library, *core.glob("*.c"), "-lm"], check=True)
    runtime = subprocess.run([compiler, "-print-file-name=libasan.so"], capture_output=True, text=True, check=True)
    environment = os.environ | {
        SANITIZED: str(library),
        "LD_PRELOAD": runtime.stdout.strip(),
        "ASAN_OPTIONS": "detect_leaks=0",
    }
    command = [sys.executable, "-m", "pytest", "-qs", "-p", "tests.support.sanitized", "-m", "not slow", __file__]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
