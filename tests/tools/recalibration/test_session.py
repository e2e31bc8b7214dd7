"""The session of a live recalibration: what it asks the service, and that it takes nothing that nobody signed."""

import itertools
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from probewatch.appliance.service.control.server import ControlRefused, Peer
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.appliance.types import Calibration
from probewatch.drivers.errors import ConfigurationError, ProbewatchError
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Sample, Stamp
from probewatch.drivers.twins.scene.world import World, WorldSettings
from probewatch.tools.recalibration.held_service import Asked, HeldService
from probewatch.tools.recalibration.paperwork import Begin, Signature
from probewatch.tools.recalibration.phase import Phase
from probewatch.tools.recalibration.session import ScanSession
from probewatch.tools.shared.status_watch import StatusWatch
from tests.support.live_scan import RecalibratingService, Scan
from tests.support.polling import until

SIZE_PX = (320, 240)
CHOSEN = Begin("L12-5", "4 cm", "A. Smith", "check", "whole")
SIGNED = Signature("B. Jones", "engineer", "good", unchecked="the tank cannot be moved")


def world() -> World:
    return World(3, "freehand", "cross-wire", WorldSettings(*SIZE_PX))


def truth() -> Calibration:
    return calibration_from_image_to_probe(world().image_to_probe, SIZE_PX)


def wires(frames: int) -> Iterator[Sample]:
    return scanned(world(), range(frames))


def scanned(seen: World, indices: Iterable[int]) -> Iterator[Sample]:
    """A picture and two poses for each index, 20 pictures a second."""
    for index in indices:
        t_s = index / 20
        yield Frame(Stamp(round(t_s * 1e9), 40_000), index, seen.frame(t_s, index))
        for half in range(2):
            pose_s = t_s + (half + 0.5) / 40
            pose = seen.measured_pose(pose_s, 2 * index + half)
            yield Pose(Stamp(round(pose_s * 1e9), 40_000), 2 * index + half, pose, 0.1, PoseStatus.OK)


class Bench:
    """A service, its feed where samples are given, and a session. ahead_s: how far the session's clock runs ahead."""

    def __init__(self, folder: Path, running: ExitStack, reference: Calibration | None = None) -> None:
        self.service = running.enter_context(RecalibratingService(folder, reference or truth()))
        self.watch = watch = running.enter_context(StatusWatch(self.service.path, 0.01))
        watch.want(1)
        self.ahead_s = 0.0
        self._ticks = itertools.count()
        self.session = ScanSession(self.service.path, self.service.feed, folder, watch, self._now_s)
        self._running = running
        running.enter_context(self.session)
        until(lambda: watch.seen().status)

    def _now_s(self) -> float:
        return next(self._ticks) * 1e-3 + self.ahead_s

    def feed(self, samples: Iterator[Sample]) -> None:
        self._running.enter_context(Scan(self.service, samples))

    @property
    def fields(self) -> dict:
        return self.session.fields()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with ExitStack() as running:
        yield Bench(tmp_path, running)


def test_nothing_is_scanned_before_the_service_has_agreed(bench: Bench) -> None:
    bench.service.refuse = True
    with pytest.raises(ControlRefused, match="not possible while monitoring"):
        bench.session.begin(CHOSEN)
    assert bench.session.phase is Phase.IDLE


def test_a_folder_that_cannot_take_the_calibration_is_told_before_the_scan(tmp_path: Path) -> None:
    with ExitStack() as running:
        bench = Bench(tmp_path, running)
        bench.session._folder = tmp_path / "gone"
        with pytest.raises(ConfigurationError, match=r"gone\. Name a file in a folder that exists"):
            bench.session.begin(CHOSEN)
        assert (bench.session.phase, bench.service.asked) == (Phase.IDLE, [])


@pytest.mark.parametrize(
    "chosen",
    [Begin("", "d", "t"), Begin("p", "  ", "t"), Begin("p", "d", ""), Begin("p", "d", "t", wanted="half")],
)
def test_what_is_not_filled_in_begins_nothing(bench: Bench, chosen: Begin) -> None:
    with pytest.raises(ControlRefused):
        bench.session.begin(chosen)
    assert bench.service.asked == []


def test_without_pictures_it_says_so_waits_and_can_be_given_up(bench: Bench) -> None:
    bench.session.begin(CHOSEN)
    until(lambda: "the pictures are lost" in bench.fields["trouble"])
    for request in (bench.session.finish, bench.session.resume, lambda: bench.session.accept(SIGNED)):
        with pytest.raises(ControlRefused):
            request()
    with pytest.raises(ControlRefused, match=r"A\. Smith recalibrates already"):
        bench.session.begin(CHOSEN)
    bench.session.reject("no water")
    assert (bench.session.phase, bench.fields["message"]) == (Phase.ENDED, "rejected: no water")
    assert bench.service.asked == ["begin-recalibration", "abort-recalibration"]
    with pytest.raises(ControlRefused):
        bench.session.reject()
    bench.session.dismiss()
    assert bench.session.phase is Phase.IDLE


def test_a_service_that_forgot_is_asked_again(bench: Bench) -> None:
    bench.session.begin(CHOSEN)
    bench.service.state = "not verified"
    until(lambda: bench.service.asked == ["begin-recalibration"] * 2)
    bench.service.state, bench.service.refuse = "device lost", True
    until(lambda: bench.fields["trouble"].startswith("device lost: ") or "pictures" in bench.fields["trouble"])
    assert bench.session.phase is Phase.SCANNING


@pytest.mark.parametrize("state", ["not verified", "halt", "monitoring"])
def test_a_review_that_nobody_answers_takes_nothing_and_whoever_goes_on_asks_again(bench: Bench, state: str) -> None:
    bench.session.begin(CHOSEN)
    with bench.session._lock:
        bench.session._phase = Phase.REVIEW
        bench.service.state = state
    until(lambda: bench.watch.seen().status["state"] == state)
    for _ in range(3):
        bench.session._look()
    assert "does not wait for this scan" in bench.fields["trouble"]
    assert bench.service.asked == ["begin-recalibration"]
    bench.session.resume()
    assert bench.service.asked == ["begin-recalibration"] * 2
    assert bench.session.phase is Phase.SCANNING


@pytest.mark.parametrize("state", ["monitoring", "recalibrating"])
def test_a_service_that_has_gone_on_without_the_scan_is_not_taken_back(bench: Bench, state: str) -> None:
    """It was verified meanwhile, or recalibrates for somebody else: a scan that lies idle does not open the contact."""
    held = HeldService(bench.service.path)
    held.grasp()
    for now in (state, "not verified"):
        bench.service.state, bench.service.holder = now, Peer(1, 0, 99)
        until(lambda now=now: not held.is_older(seen := bench.watch.seen()) and seen.status["state"] == now)
        seen = bench.watch.seen()
        with pytest.raises(ControlRefused, match="has gone on without this scan"):
            held.hold(seen)
    assert bench.service.asked == ["begin-recalibration"]
    held.hold(seen, wanted=True)
    assert bench.service.asked == ["begin-recalibration"] * 2
    held.let_go()


@pytest.mark.parametrize("unwatched_s", [0.0, 4.0])
def test_a_lost_device_that_is_back_gives_the_service_to_nobody_else(bench: Bench, unwatched_s: float) -> None:
    """Where the scan has looked on all the while, also if it monitors again at once."""
    held = HeldService(bench.service.path)
    held.grasp()

    def look(state: str) -> None:
        bench.service.state, bench.service.refuse = state, state == "device lost"
        bench.service.holder = None
        until(lambda: not held.is_older(seen := bench.watch.seen()) and seen.status["state"] == state)
        held.hold(bench.watch.seen())

    with pytest.raises(ControlRefused, match="goes on by itself"):
        look("device lost")
    held._looked_ns -= round(unwatched_s * 1e9)
    if unwatched_s:
        with pytest.raises(ControlRefused, match="has gone on without this scan"):
            look("monitoring")
    else:
        look("monitoring")
    assert bench.service.asked.count("begin-recalibration") == (1 if unwatched_s else 2)
    held.let_go()


def test_what_the_service_said_before_it_was_killed_is_not_that_it_has_gone_on_without_the_scan(bench: Bench) -> None:
    held = HeldService(bench.service.path)
    held.grasp()
    until(lambda: not held.is_older(seen := bench.watch.seen()) and seen.status["state"] == "recalibrating")
    seen = bench.watch.seen()
    assert seen.status["recalibration"]["yours"]
    bench.service.restart()
    bench.service.state = "not verified"
    held.hold(seen)
    assert bench.service.asked == ["begin-recalibration"] * 2
    held.let_go()


def test_the_service_hangs_on_the_session_and_on_nobody_once_it_has_ended(bench: Bench) -> None:
    """So that a page that is killed leaves no cart behind that waits for it."""
    bench.session.begin(CHOSEN)
    assert bench.service.is_held
    bench.session.reject()
    until(lambda: not bench.service.is_held)


def test_a_browser_that_looked_on_and_went_is_missed(bench: Bench) -> None:
    bench.session.begin(CHOSEN)
    bench.session.attendance.look_on()
    bench.ahead_s = 290.0
    bench.session.attendance.look_on()
    bench.ahead_s = 580.0
    until(lambda: bench.fields["trouble"])
    assert bench.session.phase is Phase.SCANNING
    bench.ahead_s = 600.0
    until(lambda: bench.session.phase is Phase.ENDED)
    assert "no browser" in bench.fields["message"]


def test_a_scan_that_nobody_looks_at_is_given_up(bench: Bench) -> None:
    bench.session.begin(CHOSEN)
    bench.ahead_s = 1000.0
    until(lambda: bench.session.phase is Phase.ENDED)
    assert "abandoned" in bench.fields["message"]
    assert bench.service.asked[-1] == "abort-recalibration"


def test_the_end_of_the_page_gives_the_scan_up(tmp_path: Path) -> None:
    with ExitStack() as running:
        service = running.enter_context(RecalibratingService(tmp_path, None))
        watch = running.enter_context(StatusWatch(service.path, 0.01))
        with ScanSession(service.path, service.feed, tmp_path, watch) as session:
            until(lambda: watch.seen().status)
            session.begin(CHOSEN)
        assert service.asked == ["begin-recalibration", "abort-recalibration"]


@pytest.mark.thorough
def test_a_whole_scan_is_reviewed_signed_taken_and_proved(bench: Bench, tmp_path: Path) -> None:
    bench.feed(wires(600))
    bench.session.begin(CHOSEN)
    until(
        lambda: (scan := bench.fields["scan"]) and scan["result"] and not scan["refusals"],
        60,
        0.1,
        lambda: bench.fields["scan"],
    )
    bench.session.finish()
    found = bench.fields["scan"]
    assert abs(found["result"]["zeta_mm"] - 14) < 3.5 * found["result"]["zeta_sigma_mm"] < 2
    assert bench.session.thumbnail(0).shape == (96, 96)
    assert bench.session.thumbnail(len(found["views"])) is bench.session.thumbnail(-1) is None
    with pytest.raises(ControlRefused):
        bench.session.strike(len(found["views"]))
    with pytest.raises(ControlRefused):
        bench.session.correct(0, (float("nan"), 1.0))
    for index in range(len(found["views"]) - 5):
        bench.session.strike(index)
    assert bench.fields["scan"]["views"][0]["struck"]
    with pytest.raises(ProbewatchError, match="usable views"):
        bench.session.accept(SIGNED)
    for index in range(len(found["views"]) - 5):
        bench.session.strike(index, struck=False)
    assert bench.fields["scan"]["result"] == found["result"]
    for wrong in (Signature("", "role"), Signature("a. SMITH", "role"), Signature("B", " ")):
        with pytest.raises((ControlRefused, ConfigurationError)):
            bench.session.accept(wrong)
    bench.service.proposal["confirm"] = True
    with pytest.raises(Asked) as question:
        bench.session.accept(SIGNED)
    assert question.value.text == "hardly"
    assert list(tmp_path.glob("*.toml")) == []
    assert bench.service.taken is None
    with pytest.raises(ProbewatchError, match="check at another point: it was not made"):
        bench.session.accept(replace(SIGNED, unchecked=" "))
    bench.session.accept(replace(SIGNED, confirm="hardly"))
    assert bench.session.phase is Phase.PROVING
    said = tomllib.loads(bench.service.taken.decode())
    assert said["simulated"]
    assert said["provenance"]["check"] == "not made: the tank cannot be moved"
    assert [said["provenance"][name] for name in ("made_by", "signed_by", "signed_role", "comment")] == [
        "A. Smith",
        "B. Jones",
        "engineer",
        "good",
    ]
    assert Path(bench.fields["file"]).stat().st_mode & 0o777 == 0o640
    bench.service.state = "monitoring"
    until(lambda: bench.session.phase is Phase.DONE)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"water_c": 20.0}, "depths appear 3.9 % too deep; 1.5 % is the most"),
        ({"water_c": float("nan")}, "the water's temperature must be 0 to 95"),
        ({"water_c": 96.0}, "the water's temperature must be 0 to 95"),
        ({"scanner_m_s": float("nan")}, "must be 1400 to 1700 m/s"),
        ({"scanner_m_s": 1480.0, "water_c": 48.0}, "too shallow; 1.5 % is the most"),
        ({"wanted": "zeta", "water_c": 20.0, "correct_sound": True}, "ζ alone does not change the depths"),
    ],
)
def test_water_that_bends_the_depths_begins_nothing(bench: Bench, more: dict[str, Any], said: str) -> None:
    with pytest.raises(ControlRefused, match=said):
        bench.session.begin(replace(CHOSEN, **more))
    assert bench.service.asked == []


@pytest.mark.thorough
def test_a_calibration_that_the_service_went_back_on_is_told(bench: Bench) -> None:
    bench.feed(wires(600))
    bench.session.begin(Begin("p", "d", "t", wanted="zeta"))
    until(
        lambda: (scan := bench.fields["scan"]) and scan["result"] and not scan["refusals"],
        60,
        0.1,
        lambda: bench.fields["scan"],
    )
    bench.session.finish()
    bench.session.accept(SIGNED)
    bench.service.state, bench.service.sha256 = "device lost", "before"
    until(lambda: bench.session.phase is Phase.ENDED)
    assert "the calibration before is in force" in bench.fields["message"]
