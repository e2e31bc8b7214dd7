"""The library of the compiled core: its structures are those of Python, and it is of this source."""

import ctypes
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import probewatch
from probewatch.appliance.core.registration import compiled
from probewatch.appliance.core.registration.points import Fit, Picture, Template
from tests.appliance.core.registration.test_points import askew, points, some, speckle

CORE = Path(compiled.__file__).parent


@pytest.mark.parametrize(("name", "structure"), [("Level", Picture), ("Template", Template), ("Fit", Fit)])
def test_structures_are_declared_alike_in_c_and_in_python(name: str, structure: type[ctypes.Structure]) -> None:
    """Their sizes are compared at import; here which field is which."""
    body = re.search(rf"typedef struct {{([^}}]*)}} {name};", (CORE / "compiled.h").read_text())
    assert body is not None
    fields = re.sub(r"\[\w*\]|\b(const|double|float|int16_t|int32_t|Matrix)\b|[*,;]", " ", body[1]).split()
    assert fields == [field[0].lstrip("_") for field in structure._fields_]


@pytest.mark.parametrize(
    ("file", "right", "wrong", "why"),
    [
        ("compiled.py", "load_library(_NAME", 'load_library("_absent"', "no file"),
        ("compiled.py", '"layout"', '"other"', "undefined symbol: other"),
        ("points.py", '("lost", c_int32)', '("lost", c_double)', "compiled from another source"),
        ("points.py", 'declared("prepare"', 'declared("other"', "undefined symbol: other"),
    ],
    ids=["absent", "foreign", "structure", "function"],
)
def test_a_library_that_is_not_of_this_source_says_what_to_do(
    tmp_path: Path, file: str, right: str, wrong: str, why: str
) -> None:
    for package in (CORE.parents[1], CORE.parents[2] / "drivers"):
        shutil.copytree(package, tmp_path / "probewatch" / package.name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(probewatch.__file__, tmp_path / "probewatch")
    source = tmp_path / "probewatch/appliance/core/registration" / file
    assert right in source.read_text()
    source.write_text(source.read_text().replace(right, wrong))
    command = [sys.executable, "-c", "import probewatch.appliance.core.registration.points"]
    said = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False).stderr.splitlines()[-1]
    assert said.startswith("ImportError: the compiled core")
    assert why in said
    assert "`make -B .venv/dev` compiles it again" in said


def test_what_is_compiled_for_one_processor_finds_what_another_finds() -> None:
    """Sums in another order differ in their last digits."""
    libraries = [ctypes.CDLL(str(path)) for path in sorted(CORE.glob("_compiled*.so"))]
    template, picture, found = points(some()), Picture(speckle()), []
    for library in libraries:
        fit = askew()
        arguments = (ctypes.byref(part) for part in (template, picture, fit))
        library.descend(*arguments, 3, ctypes.c_double(0), 1)
        found.append([fit.u_x, fit.u_y, fit.alpha, fit.gain, fit.bias, *fit.response])
    assert found[0][:3] != [2.3, -1.6, 0.05]
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], rtol=1e-3)


def test_the_libraries_are_not_older_than_their_sources() -> None:
    newest = max(source.stat().st_mtime for source in CORE.glob("*.[ch]"))
    oldest = min(library.stat().st_mtime for library in CORE.glob("_compiled*.so"))
    assert oldest >= newest, "make .venv/dev compiles them"
