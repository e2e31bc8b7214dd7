"""What `import probewatch` gives, and what it costs."""

import subprocess
import sys
from pathlib import Path

import pytest

import probewatch
from probewatch import appliance, drivers, tools

ROOT = Path(__file__).parents[3]


def test_every_name_of_the_interface_is_the_one_of_its_module() -> None:
    for name in dir(probewatch):
        assert getattr(probewatch, name).__module__.startswith("probewatch."), name


def test_a_name_that_is_not_of_it_is_told_with_those_that_are() -> None:
    with pytest.raises(AttributeError, match=r"probewatch has no 'Judge'; it has Judged, judge, reference, Line"):
        _ = probewatch.Judge


def test_a_checkout_gives_its_own_folders() -> None:
    for package in (appliance, drivers, tools):
        assert Path(package.__file__).parent == ROOT / package.__name__.removeprefix("probewatch.")


def test_nothing_is_loaded_before_it_is_asked_for() -> None:
    code = "import sys, probewatch; print(*(name for name in sys.modules if name.startswith(('probewatch.', 'numpy'))))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_beside_it_an_installed_wheel_has_its_folders(tmp_path: Path) -> None:
    """As in site-packages: what stands beside the file is taken, nothing above it."""
    installed = tmp_path / "probewatch"
    (installed / "appliance").mkdir(parents=True)
    (installed / "__init__.py").write_text(Path(probewatch.__file__).read_text())
    (installed / "appliance/__init__.py").write_text("HERE = __file__")
    code = "import probewatch.appliance as one; print(one.HERE)"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(installed / "appliance/__init__.py")
