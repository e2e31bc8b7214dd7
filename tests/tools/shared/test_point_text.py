"""The error of a point is one figure: whoever tells it tells the same, to a tenth of a millimetre and never less."""

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from probewatch.appliance.core.exact_fields import verdict_fields, verdict_of
from probewatch.appliance.core.quality.check_fields import point_fields, up_to
from probewatch.appliance.core.quality.report import LineReport, report_json
from probewatch.appliance.limits import Limits
from probewatch.appliance.service.control.status import point_known
from probewatch.appliance.storage.black_box_fields import fields_of
from probewatch.appliance.types import AlarmState, PointError, State, Verdict, VerdictKind
from probewatch.tools.monitoring.reading import found
from probewatch.tools.openigtlink.wording import fields_of as openigtlink_fields
from probewatch.tools.page.room import room
from probewatch.tools.report.recording_page import write_recording_page
from probewatch.tools.report.trace import Trace
from probewatch.tools.shared.point_text import point_text
from probewatch.tools.shared.replay_outcome import Outcome, print_outcome
from probewatch.tools.shared.status_view import StatusView, one_line
from probewatch.tools.shared.status_watch import Seen
from probewatch.tools.shared.subject import Subject
from tests.support.answering import recorded

S = 1_000_000_000
POINT = PointError((1.9234, 2.4321), (1.5, 2.0), 30.0, (1.7, 2.2222), 5 * S)
VERDICT = Verdict(7 * S, VerdictKind.OK, (), None, "calibration verified", 5 * S, None, (), POINT)
REPORT = LineReport(1, 1, 1, {}, None, None, 0, (), VERDICT)
ALARM = AlarmState(State.MONITORING, 0, None, "", True, 5 * S)
STATUS = recorded(**point_known(7 * S, ALARM, VERDICT, Limits(point_mm=3.0), 120 * S))
SUBJECT = Subject(((Path("x.mha"), "ab" * 32),), None, None, (), "probewatch 0", "2026-01-01T00:00:00+00:00")


def terminal(status: dict[str, Any]) -> str:
    stream = io.StringIO()
    Console(file=stream, width=200, highlight=False).print(StatusView().picture(status))
    return stream.getvalue()


def replayed(capsys: pytest.CaptureFixture[str]) -> str:
    print_outcome(Outcome(Path("x.mha"), REPORT, []), SUBJECT)
    return capsys.readouterr().out


def recording_page(path: Path) -> str:
    write_recording_page(path, SUBJECT, "x.mha", Trace(), REPORT, [], None, "")
    return path.read_text(encoding="utf-8")


def metrics(status: dict[str, Any]) -> dict[tuple[str, ...], float]:
    samples = [one for metric in found(status, 0.0) for one in metric.samples if "point_error" in one.name]
    return {(one.name, *one.labels.values()): one.value for one in samples}


def test_whoever_tells_it_in_words_tells_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = "error of a point up to 2.5 mm, of half of them up to 2.0 mm (99.7 %) · at 30 mm depth up to 2.3 mm"
    assert f"{said} · limit 3 mm" in terminal(STATUS)
    assert f"{said} · limit 3 mm" in one_line(STATUS)
    assert room(STATUS)["point"] == f"{said} · limit 3 mm"
    assert said in replayed(capsys)
    assert said in recording_page(tmp_path / "x.html")


def bounds_of_metrics(status: dict[str, Any]) -> dict[str, list[float]]:
    told = metrics(status)
    name = "probewatch_point_error_meters"
    places = {"worst_mm": "worst", "median_mm": "median", "at_depth_mm": "depth"}
    return {key: [1e3 * told[name, place, share] for share in ("0.95", "0.997")] for key, place in places.items()}


NUMBERS: dict[str, Callable[[], dict[str, Any]]] = {
    "status": lambda: STATUS["point"],
    "report": lambda: report_json(REPORT, [])["point"],
    "feed": lambda: verdict_fields(VERDICT)["point"],
    "black box": lambda: fields_of(VERDICT)[1]["point"],
    "OpenIGTLink": lambda: openigtlink_fields(Seen(STATUS, 7 * S))["point"],
    "metrics": lambda: bounds_of_metrics(STATUS),
}


@pytest.mark.parametrize("place", NUMBERS)
def test_whoever_tells_it_in_numbers_tells_the_same(place: str) -> None:
    told = json.loads(json.dumps(NUMBERS[place]()))
    assert told["worst_mm"] == pytest.approx([1.9234, 2.4321], abs=1e-9)
    assert told["median_mm"] == pytest.approx([1.5, 2.0], abs=1e-9)
    assert told["at_depth_mm"] == pytest.approx([1.7, 2.2222], abs=1e-9)


def test_limit_and_age_are_told_beside_it() -> None:
    assert STATUS["point_limit_mm"] == openigtlink_fields(Seen(STATUS, 0))["point_limit_mm"] == 3.0
    assert STATUS["point"]["shown_age_s"] == report_json(REPORT, [])["point"]["shown_age_s"] == 2.0
    told = metrics(STATUS)
    assert told[("probewatch_point_error_limit_meters",)] == 0.003
    assert told[("probewatch_point_error_age_seconds",)] == 2.0


def test_where_it_is_not_known_nobody_tells_a_number() -> None:
    status = recorded(point=None, point_limit_mm=None)
    assert "error of a point" not in terminal(status), "a line that a small terminal has no room for"
    assert "error of a point not known · limit 3 mm" in terminal(recorded(point=None, point_limit_mm=3.0))
    assert room(status)["point"] == "error of a point not known"
    assert metrics(status) == {}
    assert openigtlink_fields(Seen(status, 0))["point"] is None
    assert verdict_of(verdict_fields(Verdict(0, VerdictKind.OK, ()))).point is None


def test_the_page_tells_it_in_the_language_of_the_room() -> None:
    german = room({**STATUS, "language": "de"})["point"]
    assert german == (
        "Fehler eines Punktes bis 2,5 mm, bei der Hälfte bis 2,0 mm (99,7 %) · in 30 mm Tiefe bis 2,3 mm · Grenze 3 mm"
    )
    assert point_text(None, language="de") == "Fehler eines Punktes unbekannt"


@pytest.mark.parametrize(
    ("barrier_ns", "most_s", "known"), [(-1, 120, True), (4 * S, 120, True), (5 * S, 120, False), (-1, 1, False)]
)
def test_the_status_tells_it_only_of_motion_that_verifies(barrier_ns: int, most_s: int, known: bool) -> None:
    alarm = AlarmState(State.MONITORING, 0, None, "", True, 5 * S, barrier_ns=barrier_ns)
    assert (point_known(7 * S, alarm, VERDICT, Limits(), most_s * S)["point"] is not None) == known
    assert point_known(7 * S, alarm, None, Limits(), 120 * S) == {"point": None, "point_limit_mm": None}


@pytest.mark.parametrize(("bound_mm", "said"), [(2.4, "2.4"), (2.4001, "2.5"), (2.999, "3.0"), (0.01, "0.1")])
def test_a_bound_is_rounded_up(bound_mm: float, said: str) -> None:
    assert up_to(bound_mm) == said


def test_an_older_service_knows_of_none() -> None:
    assert point_fields(0, None, Limits().region) is None
    older = {key: one for key, one in STATUS.items() if not key.startswith("point")}
    assert "error of a point" not in terminal(older)
    assert room(older)["point"] == "error of a point not known"
