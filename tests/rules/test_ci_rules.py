"""The rules of CI, tried on small suites: which skips are failures, and what a second run decides."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.rules import pythons, quick, retried, skips
from tests.rules.changed import ABOUT
from tests.support.polling import until
from tests.support.signals import processes

ROOT = Path(__file__).parents[2]
FIRST = next(iter(skips.allowed()))


def run(folder: Path, *command: str, ci: str = "true", how: tuple[str, ...] = ("-m",)) -> tuple[int, str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "CI": ci, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    whole = [sys.executable, *how, *command]
    done = subprocess.run(whole, cwd=folder, capture_output=True, text=True, check=False, env=environment)
    return done.returncode, done.stdout + done.stderr


def twice(folder: Path, *options: str, ci: str = "true") -> tuple[int, str]:
    return run(folder, "tests.rules.retried", *options, ci=ci)


def suite(folder: Path, *lines: str) -> Path:
    (folder / "test_it.py").write_text("\n".join(("import pytest", "from pathlib import Path", *lines)) + "\n")
    return folder


SKIPPING = f"""
def test_asks(): pytest.skip("needs a screen")
@pytest.mark.skipif(True, reason="needs a screen")
def test_is_marked(): pass
@pytest.fixture
def screen(): pytest.skip("needs a screen")
def test_needs(screen): pass
def test_is_on_the_list(): pytest.skip("{FIRST} of another day")
@pytest.mark.xfail(strict=True)
def test_is_known_to_fail(): assert False
def test_passes(): pass
"""


def test_a_skip_in_ci_is_a_failure_unless_its_reason_is_on_the_list(tmp_path: Path) -> None:
    (tmp_path / "test_whole_file.py").write_text("import pytest\npytest.importorskip('no_such_module')\n")
    command = ("pytest", "-p", "tests.rules.skips", "-p", "no:cacheprovider", "--continue-on-collection-errors", "-rA")
    code, text = run(suite(tmp_path, SKIPPING), *command)
    assert code == 1, text
    assert "1 failed, 1 passed, 1 skipped, 1 xfailed, 3 errors" in text
    assert "FAILED test_it.py::test_asks" in text
    assert all(f"ERROR {name}" in text for name in ("test_it.py::test_is_marked", "test_it.py::test_needs")), text
    assert "ERROR test_whole_file.py" in text
    assert "skipped in CI: needs a screen" in text


def test_outside_ci_a_skip_is_a_skip(tmp_path: Path) -> None:
    code, text = run(suite(tmp_path, SKIPPING), "pytest", "-p", "tests.rules.skips", "-p", "no:cacheprovider", ci="")
    assert (code, "1 passed, 4 skipped, 1 xfailed" in text) == (0, True), text


def test_ci_runs_what_the_quick_suite_leaves_out_as_thorough() -> None:
    targets = (ROOT / "Makefile").read_text()
    rest = "not slow and not live and not cart and not deb"
    for target, which in (("quick", f"not thorough and {rest}"), ("thorough", f"thorough and {rest}")):
        assert re.search(rf'^{target}:.*\n\t.*\$\(BIN\)/pytest .*-m "{which}"$', targets, re.M), target


BUSY = """
def busy(s):
    end = time.process_time() + s
    while time.process_time() < end: pass
@pytest.fixture
def prepared(): busy(0.3)
def test_in_it(): busy(0.3)
def test_in_its_fixture(prepared): pass
def test_in_a_child(): subprocess.run([sys.executable, "-c", "import time\\nwhile time.process_time() < .3: pass"])
def test_that_waits(): time.sleep(0.3)
"""


PEER = """
from tests.rules import quick
quick.peer_s = lambda: quick.PEER_S * {times}
"""


@pytest.mark.parametrize(
    ("ci", "slower", "passed", "failed"),
    [("true", 1, "1 passed", "2 failed"), ("true", 50, "4 passed", ""), ("", 1, "4 passed", "")],
)
def test_a_quick_test_takes_little_of_a_processor_as_fast_as_this_one_is_now(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ci: str, slower: int, passed: str, failed: str
) -> None:
    monkeypatch.setenv(quick.MOST, "0.2")
    suite(tmp_path, "import subprocess, sys, time", PEER.format(times=slower), BUSY)
    code, text = run(tmp_path, "pytest", "-p", "tests.rules.quick", "-rA", ci=ci)
    assert (code, passed in text, failed in text) == (int(bool(failed)), True, True), text
    told = re.search(r"what is set up for it took 0\.\d s of the processor, a quick test 0\.2 s at most", text)
    assert (told is not None) is bool(failed)


def test_what_needs_the_computer_alone_runs_as_well() -> None:
    """Both halves of `make live`, and nothing besides."""
    recipe = re.search(r"^live:.*\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text(), re.M)
    assert recipe is not None
    chosen = re.findall(r'tests\.rules\.retried .*-m "(.*)"$', recipe[1], re.M)
    assert chosen == ["live and not slow and not alone", "live and not slow and alone"]


def test_ci_runs_every_part_that_gates_and_no_smaller_one() -> None:
    """All of `make live`, a third of `make thorough`; three parts where what they are about has changed. What is begun
    beside others is waited for.
    """
    script = (ROOT / ".ci/run").read_text()
    parts = re.findall(r"^ *part (.*)$", script, re.M)
    aside = re.search(
        r"^without_real_time\(\) {\n(.*?)^}\n.*^beside without_real_time\n.*^end_beside\n", script, re.M | re.S
    )
    assert aside is not None
    assert "live" not in aside[1]
    third = 'make thorough THIRD="$(.venv/bin/python -m tests.rules.third)"'
    whole = ["make test", third, "make invariant", "make live"]
    assert [part for part in whole if part not in parts] == []
    changed = dict(re.findall(r"^ *when_changed (\w+) (.*?)(?:  #.*)?$", script, re.M))
    assert changed.keys() == ABOUT.keys()
    assert changed["mutation"] == "part make mutation"
    assert changed["pythons"] == f"part make pythons VERSIONS={pythons.BY_TURNS}"


@pytest.mark.parametrize(("code", "ran", "gate"), [(0, True, 0), (3, False, 0), (2, False, 2), (1, False, 1)])
def test_a_part_is_left_out_only_where_nothing_that_it_is_about_has_changed(
    tmp_path: Path, code: int, ran: bool, gate: int
) -> None:
    """What cannot be judged, such as a wrong PROBEWATCH_GATE_BASE, breaks the gate off."""
    python = stand_in(tmp_path / ".venv/bin", "python", f'[ "$*" = "-m tests.rules.changed deb" ] && exit {code}')
    function = re.search(r"^when_changed\(\) {\n.*?^}\n", (ROOT / ".ci/run").read_text(), re.M | re.S)
    assert python.exists()
    assert function is not None
    script = f"set -euo pipefail\n{function[0]}when_changed deb echo ran it\necho 'went on'"
    done = subprocess.run(["bash", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, "ran it" in done.stdout, "went on" in done.stdout) == (gate, ran, gate == 0)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_gate_that_is_broken_off_leaves_no_process_and_says_in_which_part(
    tmp_path: Path, number: signal.Signals
) -> None:
    """The script alone gets the signal; what its part has started listens to no SIGINT."""
    begin = re.search(r"^part\(\) {\n.*?(?=^# The command after)", (ROOT / ".ci/run").read_text(), re.M | re.S)
    assert begin is not None
    (tmp_path / "deaf").write_text("trap '' INT\nsleep 60 &\necho begun\nwait\n")
    script = f"set -euo pipefail\n{begin[0].replace('seq 100', 'seq 3')}part true\npart sh deaf"
    with subprocess.Popen(
        ["bash", "-c", script], cwd=tmp_path, stdout=-1, stderr=-1, text=True, start_new_session=True
    ) as process:
        assert process.stdout is not None
        assert any(line == "begun\n" for line in process.stdout)
        process.send_signal(number)
        _, said = process.communicate(timeout=10)
        until(lambda: not processes(process.pid), otherwise=lambda: processes(process.pid))
    assert process.returncode == 128 + number
    assert f"=== interrupted by {number.name} in: sh deaf\n" in said


def test_a_part_that_fails_ends_the_gate_with_its_exit_code() -> None:
    part = re.search(r"^part\(\) {\n.*?^}\n", (ROOT / ".ci/run").read_text(), re.M | re.S)
    assert part is not None
    script = f"set -euo pipefail\n{part[0]}part true\npart sh -c 'exit 7'\npart echo later"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, "later" in done.stdout) == (7, False)
    assert re.search(r"^=== true: \d s$", done.stdout, re.M)


def gate(folder: Path, *lines: str) -> "subprocess.Popen[str]":
    """These lines in place of the gate's parts, by its own functions."""
    functions = re.search(r"^part\(\) {\n.*?(?=^# The command after)", (ROOT / ".ci/run").read_text(), re.M | re.S)
    assert functions is not None
    script = "\n".join(("set -euo pipefail", functions[0].replace("seq 100", "seq 3"), *lines))
    command = ["bash", "-c", script]
    return subprocess.Popen(command, cwd=folder, stdout=-1, stderr=-2, text=True, start_new_session=True)


def test_what_runs_beside_others_takes_what_they_leave_and_is_told_in_one_piece(tmp_path: Path) -> None:
    (tmp_path / "waits").write_text("until [ -e begun ]; do sleep 0.01; done; chrt -p $$; touch ended\n")
    (tmp_path / "begins").write_text("touch begun; until [ -e ended ]; do sleep 0.01; done; chrt -p $$\n")
    with gate(
        tmp_path, "both() { part sh waits; part true; }", "beside both", "part sh begins", "end_beside"
    ) as process:
        said, _ = process.communicate(timeout=20)
    assert process.returncode == 0, said
    classes = re.findall(r"SCHED_\w+$", said, re.M)
    assert classes == ["SCHED_OTHER", "SCHED_IDLE"], said
    assert re.findall(r"^=== (.*): \d+ s$", said, re.M) == ["sh begins", "sh waits", "true"]


FAILS_FIRST = "part sh -c 'until [ -e begun ]; do sleep 0.01; done; exit 7'\nend_beside"


@pytest.mark.parametrize("then", ["touch fails; end_beside; echo later", FAILS_FIRST])
def test_what_fails_beside_others_or_before_it_has_ended_fails_the_gate(tmp_path: Path, then: str) -> None:
    """And leaves nothing that runs on."""
    (tmp_path / "lasts").write_text("touch begun; until [ -e fails ]; do sleep 0.01; done; exit 7\n")
    with gate(tmp_path, "aside() { part sh lasts; }", "beside aside", then) as process:
        said, _ = process.communicate(timeout=20)
        until(lambda: not processes(process.pid), otherwise=lambda: processes(process.pid))
    assert (process.returncode, "later\n" in said) == (7, False), said
    assert "=== sh lasts\n" in said


def test_a_gate_that_is_broken_off_ends_what_runs_beside_it(tmp_path: Path) -> None:
    (tmp_path / "deaf").write_text("trap '' INT\nsleep 60 &\necho begun >begun\nwait\n")
    with gate(tmp_path, "aside() { part sh deaf; }", "beside aside", "part sleep 60") as process:
        until((tmp_path / "begun").exists)
        process.send_signal(signal.SIGTERM)
        said, _ = process.communicate(timeout=20)
        until(lambda: not processes(process.pid), otherwise=lambda: processes(process.pid))
    assert process.returncode == 128 + signal.SIGTERM
    assert "=== interrupted by SIGTERM in: sleep 60\n" in said
    assert "=== interrupted by SIGTERM in: sh deaf\n" in said


def test_this_suite_follows_the_list(pytestconfig: pytest.Config) -> None:
    assert pytestconfig.pluginmanager.has_plugin("tests.rules.skips")


FLAKY = """
@pytest.mark.parametrize("n", range(3))
def test_first_time_only(n):
    mark = Path(f"ran-{n}")
    known, ran = mark.exists(), mark.touch()
    assert known or n == 0
@pytest.mark.skip(reason="left out by the options")
def test_left_out(): pass
"""


def test_a_module_that_fails_once_is_run_once_more_and_both_results_are_said(tmp_path: Path) -> None:
    (tmp_path / "test_sound.py").write_text("def test_runs_once(): pass\n")
    code, text = twice(suite(tmp_path, FLAKY), "-m", "not slow", ci="")
    assert code == 0, text
    assert "2 failed, 2 passed, 1 skipped" in text
    assert "3 passed, 1 skipped" in text, "all tests of the module, and no other"
    names = "test_first_time_only[1], test_first_time_only[2]"
    assert f"test_it.py: failed in the whole run ({names}), passed alone" in text
    assert "test_sound.py: " not in text


@pytest.mark.thorough
def test_a_module_alone_runs_the_same_tests_without_sharing_the_processors(tmp_path: Path) -> None:
    slow = "@pytest.mark.slow\ndef test_slow(): assert False"
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = slow\n")
    options = ("-p", "xdist.plugin", "-n", "2", "-m", "not slow")
    code, text = twice(suite(tmp_path, FLAKY, slow), *options, ci="")
    assert code == 0, text
    assert "test_slow" not in text
    assert text.count("2 workers [") == 1, text


def test_what_fails_twice_fails_the_run(tmp_path: Path) -> None:
    (tmp_path / "test_flaky.py").write_text("import pytest\nfrom pathlib import Path\n" + FLAKY)
    code, text = twice(suite(tmp_path, "def test_broken(): assert False"), ci="")
    assert code == 1, text
    assert "test_it.py: failed in the whole run (test_broken), failed alone" in text
    assert "test_flaky.py: failed in the whole run (test_first_time_only[1], test_first_time_only[2]), passed" in text


@pytest.mark.parametrize(("modules", "once_more"), [(1, True), (retried.MOST + 1, False)])
def test_failures_in_many_modules_are_no_chance(modules: int, once_more: bool, tmp_path: Path) -> None:
    many = f"import pytest\n@pytest.mark.parametrize('n', range({retried.MOST + 1}))\ndef test_broken(n): assert n < 0"
    for number in range(modules):
        (tmp_path / f"test_{number}.py").write_text(many)
    code, text = twice(tmp_path)
    assert (code, "too many for chance" in text) == (1, not once_more), text
    assert text.count("once more alone") == modules * once_more, text


@pytest.mark.parametrize(
    "line", [pytest.param("syntax error", id="broken"), pytest.param("", id="empty", marks=pytest.mark.thorough)]
)
def test_a_suite_that_could_not_run_is_not_run_again(line: str, tmp_path: Path) -> None:
    code, text = twice(suite(tmp_path, line))
    assert code not in (0, 1), text
    assert "once more" not in text


def stand_in(folder: Path, name: str, answer: str) -> Path:
    """A program on the path that says it is this Python, or none at all, as pyenv's shims do."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(f"#!/bin/sh\n{answer}\n")
    (folder / name).chmod(0o755)
    return folder / name


def test_six_commits_in_a_row_run_every_test_on_every_other_python() -> None:
    others = ["3.12", "3.13"]
    six = [pythons.in_turn(others, count) for count in range(7, 13)]
    assert six[:2] == [(["3.13"], "1"), (["3.12"], "2")]
    assert sorted((*chosen, third) for chosen, third in six) == [(one, third) for one in others for third in "123"]
    assert pythons.in_turn(others, None) == (others, ""), "a clone without all commits runs them all"


def test_a_python_is_one_that_answers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(tmp_path / "shims", "python3.12", "echo no such version; exit 127")
    stand_in(tmp_path / "shims", "python3.13", "echo no such version; exit 127")
    real = stand_in(tmp_path / "pyenv/versions/3.13.7/bin", "python3.13", "echo 3.13")
    monkeypatch.setenv("PATH", str(tmp_path / "shims"))
    monkeypatch.setenv("PYENV_ROOT", str(tmp_path / "pyenv"))
    assert pythons.interpreter("3.13") == real
    assert pythons.interpreter("3.12") is None
    assert pythons.tried("3.12").startswith("LEFT OUT, this machine has no python3.12")
