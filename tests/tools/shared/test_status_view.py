"""The status on every terminal: 80 and 38 columns, two languages, any locale, a pipe, JSON lines."""

import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from rich.cells import cell_len
from rich.console import Console

from probewatch.appliance.core.quality.check_fields import check_fields
from probewatch.appliance.core.quality.gesture import Gesture
from probewatch.appliance.core.quality.shown import Shown
from probewatch.appliance.service.control.status import alarm_fields, check_lists, shown_of_each
from probewatch.appliance.service.control.status_fields import Field, Line
from probewatch.appliance.supervision.alarms import DISPLAY_COLUMNS
from probewatch.appliance.supervision.device_health import DeviceHealth, Timeouts
from probewatch.appliance.supervision.device_watchers import watch_devices
from probewatch.appliance.supervision.languages import translated
from probewatch.appliance.types import PARAMETERS, AlarmState, Check, Fault, State, Verdict, VerdictKind
from probewatch.tools.shared import status_view
from probewatch.tools.shared.status_view import StatusView, one_line
from tests.support.answering import Answering
from tests.support.simulated import PROBEWATCH

REASON = "beyond its limit, not certain: offset-elevational -28.4 ± 1.5 mm, limit 4 mm; not shown yet: polarity"
SETTINGS = {
    "C": {"LC_ALL": "C"},
    "POSIX": {"LC_ALL": "POSIX"},
    "no locale": {},
    "ascii": {"PYTHONIOENCODING": "ascii"},
    "latin1": {"PYTHONIOENCODING": "latin1"},
    "UTF-8": {"LC_ALL": "C.UTF-8"},
}
LEADING = {"POSIX", "latin1", "UTF-8"}
"""One of each encoding."""


def status(language: str = "en", **fields: Any) -> dict[str, Any]:
    """Every kind of check, and everything that can be remarked."""
    line = [Check(name, Fault.SCALE, 6.0, 0.5, "%", 5.0, VerdictKind.NOT_VERIFIED) for name in PARAMETERS]
    line.append(Check("motion-agreement", Fault.AGREEMENT, float("nan"), 0.0, "1 − r", 0.1, VerdictKind.NOT_VERIFIED))
    german = language == "de"
    return {
        "state": "not verified",
        "text": "Kalibrierung nicht bestätigt" if german else "Calibration not verified",
        "remedy": "Sonde bewegen" if german else "Move the probe",
        "language": language,
        "fault": None,
        "reason": REASON,
        "priority": "low",
        "lamp": "cyan",
        "energised": False,
        "latched": "halt",
        "acknowledged": False,
        "notices": [],
        "verification_age_s": None,
        "checks": [check_fields(0, check) for check in line],
        "devices": [check_fields(0, check) for check in watch_devices(0, DeviceHealth(started_ns=0), Timeouts())],
        "audio": {"mode": "paused", "left_s": 33.0},
        "lost": {"tracker ndi:/dev/serial/by-id/usb-FTDI_FT232R_USB": "no such device. Plug it in"},
        "estimator": "killed by SIGKILL, restart 1",
        "remarks": ["temperature 31 °C"],
        "fps": {"video": 30.0, "tracker": 60.0},
        "counters": {"uptime_s": 5, "dropped_frames": 3, "dropped_poses": 0},
        **fields,
    }


def drawn(columns: int, shown: dict[str, Any], looks: int = 1) -> list[str]:
    stream, view = io.StringIO(), StatusView()
    for uptime_s in range(looks):
        stream.truncate(stream.seek(0))
        shown["counters"]["uptime_s"] = uptime_s
        Console(file=stream, width=columns, highlight=False).print(view.picture(shown))
    return stream.getvalue().splitlines()


@pytest.mark.parametrize("looks", [1, 12])
@pytest.mark.parametrize("language", ["en", "de"])
@pytest.mark.parametrize("columns", [38, 80])
def test_the_status_fits_and_nothing_of_it_is_cut(columns: int, language: str, looks: int) -> None:
    lines = drawn(columns, status(language), looks)
    assert all(cell_len(line) <= columns for line in lines)
    whole = " ".join(" ".join(lines).replace("│", " ").split())
    assert "…" not in whole
    assert ("Versatz elevational -28.4 ± 1.5 mm, Grenze 4 mm" if language == "de" else REASON) in whole
    assert "33 s" in whole
    bars = [line for line in lines if line.count("┃")]
    checks = 9 + len(watch_devices(0, DeviceHealth(started_ns=0), Timeouts()))
    assert len(bars) == (checks if columns == 38 else -(-checks // 2))
    assert len({line.index("┃") for line in bars}) == 1


@pytest.mark.parametrize("columns", [38, 80])
def test_what_is_proposed_stands_below_clause_by_clause(columns: int) -> None:
    text = "latency is now 132.0 ± 6.0 ms, was 80.0 ms; set latency_ms=132 in the tracker's URL and restart the service"
    lines = drawn(columns, status(proposal={"text": text, "values": [], "steps": ["set-latency"]}))
    assert all(cell_len(line) <= columns for line in lines)
    whole = " ".join(" ".join(lines).split())
    assert all(f"→ {clause}" in whole for clause in text.split("; "))


def test_a_line_is_never_half_german() -> None:
    shown = drawn(80, status("de", reason="something new; calibration verified"))
    assert any("something new; calibration verified" in line for line in shown)
    assert any("jetzt nicht bestätigt · Kontakt OFFEN · nicht quittiert" in line for line in shown)


@pytest.mark.parametrize(
    ("language", "origin", "said"),
    [
        (
            "en",
            "went back to 1",
            "reference 3 · went back to 1, SIMULATED · probe.toml · 9bc342d50898 · since 2026-11-29",
        ),
        ("de", "went back to 1", "Referenz 3 · zurück zu 1, SIMULIERT · probe.toml · 9bc342d50898 · seit 2026-11-29"),
        ("de", "configuration", "Referenz 3 · Konfiguration, SIMULIERT · "),
        ("de", "recalibration", "Referenz 3 · Neukalibrierung, SIMULIERT · "),
        ("en", "file", "reference 3 · file, SIMULATED · "),
        ("de", "file", "Referenz 3 · Datei, SIMULIERT · "),
        ("de", "file of reference 2", "Referenz 3 · Datei der Referenz 2, SIMULIERT · "),
    ],
)
def test_the_reference_is_named_in_the_language_of_the_room(language: str, origin: str, said: str) -> None:
    known = {"number": 3, "origin": origin, "simulated": True, "file": "/x/probe.toml", "sha256": "9bc342d50898" * 5}
    shown = drawn(120, status(language, reference=known | {"utc": "2026-11-29T15:19:10+00:00"}))
    assert any(line.startswith(said) for line in shown), shown


@pytest.mark.parametrize(
    ("language", "said"), [("en", "no detector saw a change: offset-axial 48/120 s"), ("de", "Versatz axial 48/120 s")]
)
def test_what_is_carried_is_told_apart_from_what_motion_shows(language: str, said: str) -> None:
    now_ns = 50 * 10**9
    known = [
        Check("scale-axial", Fault.SCALE, 1.0, 0.3, "%", 5.0, VerdictKind.OK, 42 * 10**9),
        Check("offset-axial", Fault.OFFSET, 1.0, 2.0, "mm", 4.0, VerdictKind.OK, 2 * 10**9),
        Check("offset-lateral", Fault.OFFSET, 1.0, 2.0, "mm", 4.0, VerdictKind.OK, 1 * 10**9),
    ]
    ages_ns = {check.name: 120 * 10**9 for check in known}
    alarm = AlarmState(State.MONITORING, 0, None, "", True, 2 * 10**9, barrier_ns=10**9)
    verdict = Verdict(now_ns, VerdictKind.NOT_VERIFIED, tuple(known))
    each = shown_of_each(now_ns, alarm, verdict, ages_ns)
    lists = check_lists(now_ns, verdict, (), ages_ns, each)
    assert [check["shown"] for check in lists["checks"]] == ["verified", "carried", "missing"]
    assert [check["carried"] for check in lists["checks"]] == [False, True, False]
    told = "\n".join(drawn(38, status(language, **lists, energised=True)))
    assert re.findall(r"0\.2[05] (.)", told) == ["✓", "~", "?"]
    assert said in " ".join(told.split())


@pytest.mark.parametrize(
    ("shown", "text"),
    [
        ("VERIFIED VERIFIED", "Calibration verified"),
        ("VERIFIED CARRIED", "Calibration verified · in part by earlier motion"),
        ("CARRIED CARRIED", "Calibration verified · by earlier motion"),
        ("", "Calibration verified"),
    ],
)
def test_the_text_says_what_a_verified_calibration_rests_on(shown: str, text: str) -> None:
    alarm = AlarmState(State.MONITORING, 0, None, "Calibration verified", True, 0)
    each = {str(k): Shown[one] for k, one in enumerate(shown.split())}
    said = alarm_fields(0, alarm, "en", shown_now=each)
    assert said["text"] == text
    assert len(said["text"]) <= DISPLAY_COLUMNS
    assert one_line(status(**said)).count("Calibration verified") == 1
    halted = AlarmState(State.HALT, 0, Fault.SCALE, "", False, None)
    assert "motion" not in alarm_fields(0, halted, "en", shown_now=each)["text"]


@pytest.mark.parametrize(("language", "said"), [("en", "shelf 1.3 m"), ("de", "Ablage 1.3 m")])
def test_a_field_with_a_line_is_shown_and_one_that_is_null_is_not(
    language: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    line = Line("shelf {:.1f} m", "Ablage {:.1f} m")
    monkeypatch.setattr(status_view, "STATUS", (Field("cart", "object", parts=(Field("shelf_m", line=line),)),))
    assert said in "\n".join(drawn(80, status(language, cart={"shelf_m": 1.26})))
    for cart in ({"shelf_m": None}, {}, None):
        assert said[:5] not in "\n".join(drawn(80, status(language, cart=cart)))


@pytest.mark.parametrize(
    ("field", "line"), [("reference_waits", "! reference: disk full"), ("calibration_changed", "! disk full")]
)
def test_what_keeps_a_reference_from_being_in_force_is_a_line(field: str, line: str) -> None:
    lines = [one.strip() for one in drawn(80, status(**{field: "disk full"}))]
    assert line in lines
    assert line not in [one.strip() for one in drawn(80, status(**{field: None}))]


def test_monitoring_does_not_say_the_same_twice() -> None:
    calm = status(state="monitoring", text="Calibration verified", reason="Calibration verified", energised=True)
    assert "".join(drawn(80, calm)).count("Calibration verified") == 1
    assert one_line(calm).count("Calibration verified") == 1


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Path]:
    """The control socket of a service that answers with this status, in German."""
    with Answering(tmp_path / "control", lambda: status("de", outputs=[])) as service:
        yield service.path


def environment(setting: str) -> dict[str, str]:
    kept = {name: text for name, text in os.environ.items() if not name.startswith(("LC_", "LANG", "PYTHON"))}
    return {**kept, **SETTINGS[setting]}


ONE_AFTER_THE_OTHER = """
import importlib, json, os, sys
from probewatch.tools.cli import main
for words in json.loads(sys.argv[1]):
    importlib.import_module("probewatch.tools.commands." + words[0])
    if os.fork() == 0:
        sys.argv = ["probewatch", *words]
        main()
    code = os.waitstatus_to_exitcode(os.wait()[1])
    os.write(1, f"\\0{code}\\0".encode())
"""


def asked(setting: str, *commands: tuple[str, ...]) -> list[tuple[int, bytes]]:
    """Exit code and output of each, each in a process of its own with these variables, all started by one Python.

    None of them may say anything on stderr.
    """
    program = [sys.executable, "-c", ONE_AFTER_THE_OTHER, json.dumps(commands)]
    done = subprocess.run(program, capture_output=True, timeout=60, check=True, env=environment(setting))
    assert done.stderr == b""
    *told, _ = done.stdout.split(b"\0")
    return [(int(code), output) for output, code in zip(told[::2], told[1::2], strict=True)]


@pytest.mark.parametrize(
    "setting", [one if one in LEADING else pytest.param(one, marks=pytest.mark.thorough) for one in SETTINGS]
)
def test_the_status_is_readable_in_any_locale_and_its_json_the_same(service: Path, setting: str) -> None:
    status = ("status", "--socket", str(service))
    (code, shown), (_, as_json) = asked(setting, status, (*status, "--json"))
    assert code == 3
    encoding = {"UTF-8": "utf-8", "latin1": "latin-1"}.get(setting, "ascii")
    lines = shown.decode(encoding).splitlines()
    bare = encoding == "ascii"
    assert any(("NICHT BESTAETIGT" if bare else "NICHT BESTÄTIGT") in line for line in lines)
    assert any(("31 degC" if bare else "31 °C") in line for line in lines)
    box = [line for line in lines if line.startswith(("|", "│"))]
    assert {len(line) for line in box} == {80}, "the frame is straight"
    assert json.loads(as_json)["text"] == "Kalibrierung nicht bestätigt"


@pytest.mark.thorough
@pytest.mark.parametrize("as_json", [False, True])
def test_watching_into_a_pipe_prints_lines(service: Path, as_json: bool) -> None:
    words = ["status", "--watch", *(["--json"] if as_json else []), "--socket", str(service)]
    with subprocess.Popen(
        [*PROBEWATCH, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment("UTF-8")
    ) as watching:
        assert watching.stdout is not None
        assert watching.stderr is not None
        lines = [watching.stdout.readline().decode() for _ in range(2)]
        watching.stdout.close()
        watching.wait(10)
        assert watching.stderr.read() == b""
    for line in lines:
        if as_json:
            assert json.loads(line)["state"] == "not verified"
        else:
            assert line.startswith("NICHT BESTÄTIGT: Kalibrierung nicht bestätigt · ")
            assert "\x1b" not in line


@pytest.mark.thorough
def test_help_is_ascii_where_the_locale_is() -> None:
    commands = ("check", "demo", "log", "probe", "recalibrate", "replay", "simulate", "status")
    for code, shown in asked("POSIX", *((command, "--help") for command in commands)):
        assert code == 0
        assert shown.isascii()
        assert b"Usage" in shown


def test_a_refusal_is_ascii_where_the_locale_is_and_names_any_file() -> None:
    check = [*PROBEWATCH, "check"]
    plain = subprocess.run([*check, "/tmp/ζ.toml"], capture_output=True, check=False, env=environment("POSIX"))
    assert plain.returncode == 78
    assert b"/tmp/zeta.toml: cannot be read" in plain.stderr
    odd = subprocess.run([*check, b"/tmp/\xff.toml"], capture_output=True, check=False)
    assert odd.returncode == 78
    assert b"Traceback" not in odd.stderr


def test_the_motion_that_is_asked_for_stands_beside_the_reason() -> None:
    asking = status(remedy="Probe on tissue; rock it", gesture=["rock it"])
    assert "Probe on tissue; rock it" in " ".join(drawn(80, asking))
    assert "Probe on tissue; rock it" in one_line(asking)
    assert "rock it" not in one_line(asking | {"gesture": []})
    assert one_line(asking | {"fault": "scale"}).count("rock it") == 1, "a fault says what to do about it, once"


@pytest.mark.parametrize("language", ["en", "de"])
def test_a_motion_that_is_asked_for_is_a_link_to_its_moving_drawing(language: str) -> None:
    """Where the terminal has links; a pipe gets none."""
    asked = [translated(gesture.value, language) for gesture in Gesture]
    wanted = status(language, gesture=asked, remedy="; ".join(["Probe on tissue", *asked]))
    out = io.StringIO()
    Console(file=out, width=300, force_terminal=True).print(StatusView().picture(wanted))
    links = re.findall(r"\x1b]8;[^;]*;(file://\S+?\.svg)\x1b", out.getvalue())
    files = [Path(urlsplit(link).path) for link in dict.fromkeys(links)]
    assert [file.name for file in files] == [f"gesture-{gesture.name.lower()}.svg" for gesture in Gesture]
    assert all("<svg" in file.read_text(encoding="utf-8") for file in files)
    assert "\x1b" not in "".join(drawn(80, wanted))


def test_a_cross_below_its_limit_is_explained() -> None:
    """The computer was overloaded until a moment ago."""
    devices = status()["devices"]
    busy = [*devices, {**devices[0], "name": "processor time", "fault": "overloaded", "verdict": "FAULT", "ratio": 0.4}]
    said = "! within its limit again; good once it has stayed so for some seconds: processor time !"
    assert said in " ".join(drawn(120, status(devices=busy)))
    assert "within its limit again" not in " ".join(drawn(120, status()))


def test_why_a_calibration_has_ended_is_told_in_german() -> None:
    """The reason in the box was English."""
    shown = " ".join(drawn(120, status("de", fault=None, reason="it has expired since 2026-09-02 00:00 UTC")))
    assert "sie ist abgelaufen seit 2026-09-02 00:00 UTC" in shown


def test_while_recalibrating_the_status_says_what_comes_next() -> None:
    shown = " ".join(drawn(120, status(state="recalibrating", reason="", remedy="Finish the scan")))
    assert "Finish the scan" in shown


def test_while_recalibrating_the_remedy_is_said_once() -> None:
    asked = status(state="recalibrating", reason="", remedy="Finish the scan", gesture=["tilt it"])
    assert " ".join(drawn(120, asked)).count("Finish the scan") == 1
    moves = status(state="recalibrating", reason="", remedy="Probe on tissue; tilt it", gesture=["tilt it"])
    assert " ".join(drawn(120, moves)).count("tilt it") == one_line(moves).count("tilt it") == 1
