"""`probewatch probe`: what it prints of devices that work, and of devices that do not; its figures by hand."""

import json
import math
import re
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.openigtlink.image import Image
from probewatch.drivers.openigtlink.message import Message, encode
from probewatch.drivers.recordings.metaimage_writing import SequenceItem, write_metaimage
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp
from probewatch.drivers.twins.pty_line import PtyLine
from probewatch.drivers.twins.relay_board import RelayBoard
from probewatch.tools.commands.probe import Measured, _time_rows, findings
from probewatch.tools.selftest.items import timing
from probewatch.tools.shared.time_quality import time_quality
from tests.support import simulated_igtl
from tests.support.answers import answered
from tests.support.boards import running_board
from tests.support.recordings import SIZE_PX, items
from tests.support.simulated_optotrak import bench

PROBEWATCH = Path(sys.executable).parent / "probewatch"
MS = 1_000_000


def probed(url: str, *options: str, seconds: str = "1") -> tuple[int, str, str]:
    """Exit code, standard output, standard error."""
    ended = answered("probe", url, "--seconds", seconds, *options)
    assert "Traceback" not in ended.stderr
    return ended.returncode, ended.stdout, ended.stderr


def test_a_tracker_that_works(tmp_path: Path) -> None:
    with bench() as cart:
        code, output, errors = probed(f"optotrak://{cart.target}?reference=2&deadline_ms=1000")
    assert (code, errors) == (0, "")
    told = dict(line.split(":", 1) for line in output.splitlines() if ":" in line)
    assert "First Principles" in told["model"]
    assert told["firmware"].strip() == "Version 1.0 (simulated)"
    assert told["tools"].strip() == "rigid body 1; rigid body 2 (reference)"
    assert told["marker fit"].split()[1] == "0.21,"
    assert told["timestamp error"].strip().startswith("median ± "), "which of both figures is the one to be compared"
    assert {"rate", "timestamp error", "timestamp jitter", "delay", "gaps"} <= set(told)


def test_an_ndi_tracker_tells_of_its_tools_and_markers(tmp_path: Path) -> None:
    options = ["--model", "polaris-vicra", "--pty", str(tmp_path / "tracker"), "--rom", str(tmp_path / "probe.rom")]
    command = [PROBEWATCH, "simulate", "ndi", *options, "--fault", "marker-drift"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as twin:
        assert twin.stdout is not None
        code, output, errors = probed(f"{json.loads(twin.stdout.readline())['url']}&deadline_ms=1000", seconds="2")
        twin.terminate()
    assert (code, errors) == (0, "")
    assert "Polaris Vicra" in output
    assert "P6-00000" in output
    assert "marker C LOOSE by" in output
    assert "! the marker fit is poor" in output


def test_a_tracker_that_sees_nothing_is_an_error_in_plain_words() -> None:
    with bench() as cart:
        cart.show("missing")
        code, output, errors = probed(f"optotrak://{cart.target}?deadline_ms=1000", seconds="0.5")
    assert code == 69
    assert "! 100 % of the poses: missing (the tracker does not see the probe's rigid body)" in output
    assert "nothing to use came within 0.5 s. Bring the tool into view" in errors
    assert output.splitlines()[-1] == "nothing"


def test_a_tracker_that_falls_silent_is_an_error_after_what_was_measured() -> None:
    with bench() as cart:
        fault = threading.Timer(1.5, cart.show, ["lose-tracker"])
        fault.start()
        code, output, errors = probed(f"optotrak://{cart.target}", seconds="20")
        fault.join()
    assert code == 69
    assert "can be used" in output
    assert output.splitlines()[-1] == "lost"
    assert "sent no frame for 200 ms" in errors


@pytest.mark.parametrize(
    ("url", "code", "words"),
    [
        ("optotrak://127.0.0.1:1", 69, "nothing listens there"),
        ("optotrak://127.0.0.1:1?bode=1", 78, "unknown option 'bode'"),
        ("ndi:/dev/no-such-port", 69, "no such serial port"),
        ("sim:/no/such/socket", 69, "no video"),
        ("replay:/no/such/file.mha", 65, "cannot be read"),
        ("vicon://host", 78, "'vicon:' is not a known device kind"),
        ("optotrak:", 78, "names no device"),
        ("igtl://127.0.0.1:1?colour=yes", 78, "unknown option 'colour'"),
        ("relay:/dev/no-such-port?channel=300", 78, "channel=300"),
        ("serialpin:/dev/no-such-port?pin=rst", 78, "pin=rst is not a line that can be driven"),
        ("gpio:/dev/no-such-chip", 78, "line"),
        ("relay:/dev/no-such-port", 78, "Add --click while the contact is not in use"),
    ],
)
def test_what_is_wrong_is_said_with_its_exit_code(url: str, code: int, words: str) -> None:
    ended, _, errors = probed(url)
    assert ended == code
    assert words in errors
    assert errors.count("\n") == 1


@contextmanager
def relay_board(link: Path) -> Iterator[RelayBoard]:
    clock, stop = HostClock(), threading.Event()
    with PtyLine(link, clock) as line:
        board = RelayBoard(line, clock)
        thread = threading.Thread(target=board.run, args=(stop,))
        thread.start()
        try:
            yield board
        finally:
            stop.set()
            thread.join()


def test_an_output_clicks_once_and_only_when_told_to(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with relay_board(tmp_path / "relay") as board:
        assert probed(f"relay:{tmp_path}/relay")[0] == 78
        assert capsys.readouterr().out == ""
        click = [PROBEWATCH, "probe", f"relay:{tmp_path}/relay", "--click"]  # a process: the board prints in this one
        ended = subprocess.run(click, stdout=subprocess.PIPE, text=True, check=False)
        code, output = ended.returncode, ended.stdout
        switched = [json.loads(line)["energised"] for line in capsys.readouterr().out.splitlines()]
        assert board.contacts == {1: False}
    assert code == 0
    assert switched == [True, False]
    assert "it reports its contacts" in output
    assert re.search(r"contact energised in: +[\d.]+ ms, confirmed", output)
    assert "no feedback confirms" not in output


def test_a_click_that_nobody_confirms_says_so(tmp_path: Path) -> None:
    with running_board(tmp_path / "relay", HostClock(), answers=False):
        code, output, _ = probed(f"relay:{tmp_path}/relay", "--click")
    assert code == 0
    assert "ms, commanded, not confirmed" in output
    assert "! no feedback confirms that the contact moved. Watch it, or listen for two clicks" in output


def test_a_click_of_a_contact_that_the_board_does_not_have_is_refused(tmp_path: Path) -> None:
    with running_board(tmp_path / "relay", HostClock(), channels=4):
        code, output, errors = probed(f"relay:{tmp_path}/relay?channel=7", "--click")
    assert code == 69
    assert "has no contact 7, it reports 1, 2, 3, 4. Correct channel= in the URL" in errors
    assert "energised" not in output


def test_a_recording_gives_poses_and_pictures_until_its_end(tmp_path: Path) -> None:
    write_metaimage(tmp_path / "a.mha", items(5), SIZE_PX)
    code, output, errors = probed(f"replay:{tmp_path}/a.mha?start_s=0.3", seconds="5")
    assert (code, errors) == (0, "")
    assert output.count("5, of which 5 can be used") == 2
    assert output.count("the recording has ended") == 2
    assert f"{SIZE_PX[0]} x {SIZE_PX[1]} pixels" in output
    assert [line for line in output.splitlines() if line in ("Poses", "Pictures")] == ["Poses", "Pictures"]
    assert len([line for line in output.splitlines() if line.startswith(("good", "poor"))]) == 2


@pytest.mark.parametrize(
    ("made", "code", "words"),
    [
        (lambda item: replace(item, image=None), 0, ["good", "nothing: "]),
        (lambda item: replace(item, transforms={"ProbeToTracker": None}), 69, ["nothing: ", "good"]),
    ],
    ids=["poses alone", "no pose that can be used"],
)
def test_half_of_a_cart_is_said_in_one_word_each(
    tmp_path: Path, made: Callable[[SequenceItem], SequenceItem], code: int, words: list[str]
) -> None:
    """A recording may hold poses alone; of what ought to be there and cannot be used the exit code tells."""
    whole = [made(replace(item, t_ns=item.t_ns - n * 30_000_000)) for n, item in enumerate(items(5))]
    write_metaimage(tmp_path / "a.mha", whole, SIZE_PX if whole[0].image is not None else None)
    found, output, _ = probed(f"replay:{tmp_path}/a.mha?start_s=0.3", seconds="5")
    assert found == code, output
    told = [line for line in output.splitlines() if line.startswith(("good", "poor", "nothing: "))]
    assert [line.startswith(word) for line, word in zip(told, words, strict=True)] == [True, True], output


def pose(number: int, t_ms: float, status: PoseStatus = PoseStatus.OK, **fields: object) -> Pose:
    matrix = np.eye(4) if status is PoseStatus.OK else None
    return Pose(Stamp(round(t_ms * MS), round(0.5 * MS)), number, matrix, 0.2, status, **fields)  # type: ignore[arg-type]


def test_time_quality_by_hand() -> None:
    """A 20 Hz unit that steps a counter by three, once two measurements late."""
    numbers = [0, 3, 6, 15, 18, 21, 24]
    samples = [pose(number, 100 + number * 50 / 3) for number in numbers]
    quality = time_quality(samples, [sample.stamp.t_ns + 4 * MS for sample in samples])
    assert quality is not None
    assert (quality.samples, quality.step, quality.gaps, quality.lost) == (7, 3, 1, 2)
    assert quality.rate_hz == pytest.approx(6 / 0.4)
    assert quality.longest_ms == pytest.approx(150, abs=1e-3)
    assert quality.jitter_ms == pytest.approx(0, abs=1e-3)
    assert (quality.bound_ms, quality.worst_bound_ms) == (0.5, 0.5)
    assert (quality.delay_ms, quality.worst_delay_ms) == pytest.approx((4, 4))


def test_what_a_driver_says_where_nothing_came_tells_no_bound_of_the_times() -> None:
    """OpenIGTLink without the probe's transform: "timestamp error: median ± 0.00 ms", green in a self-test."""
    said = [replace(pose(n, 50 * n, PoseStatus.MISSING), stamp=Stamp(50 * n * MS, 0)) for n in range(30)]
    arrivals = [one.stamp.t_ns for one in said]
    quality = time_quality(said, arrivals)
    assert quality is not None
    assert np.isnan([quality.bound_ms, quality.worst_bound_ms, quality.delay_ms, quality.worst_delay_ms]).all()
    assert dict(_time_rows(quality))["timestamp error"] == dict(_time_rows(quality))["delay"] == "not to be told"
    stamps = next(item for item in timing("tracker", said, arrivals, 250.0) if item.name == "tracker stamps")
    assert (stamps.green, stamps.what) == (None, "no pose came")
    some = [*said, *(pose(number, 50 * number) for number in range(30, 40))]
    mixed = time_quality(some, [one.stamp.t_ns + 4 * MS for one in some])
    assert mixed is not None
    assert (mixed.bound_ms, mixed.delay_ms) == (0.5, 4.0), "the median was 0, as most of them were missing"


def test_jitter_is_the_spread_about_the_line() -> None:
    samples = [pose(number, number * 10 + (1 if number % 2 else -1)) for number in range(100)]
    quality = time_quality(samples, [0] * 100)
    assert quality is not None
    assert quality.jitter_ms == pytest.approx(1.0, rel=0.01)


def test_a_counter_that_stands_still_says_nothing_of_jitter() -> None:
    quality = time_quality([pose(5, t_ms) for t_ms in (0, 10, 20)], [0, 0, 0])
    assert quality is not None
    assert math.isnan(quality.jitter_ms)
    assert (
        "not to be told"
        in dict(findings(Measured([pose(5, t_ms) for t_ms in (0, 10, 20)], [0] * 3)))["timestamp jitter"]
    )


def test_too_few_samples_have_no_quality() -> None:
    assert time_quality([pose(1, 0), pose(2, 10)], [0, 0]) is None


def placed(one: Pose, place_mm: tuple[float, float, float]) -> Pose:
    assert one.matrix is not None
    matrix = one.matrix.copy()
    matrix[:3, 3] = place_mm
    return replace(one, matrix=matrix)


def test_pictures_are_described() -> None:
    frames = [Frame(Stamp(n * 40 * MS, 1000), n, np.zeros((24, 32), np.uint8)) for n in range(10)]
    told = dict(findings(Measured(list(frames), [frame.stamp.t_ns for frame in frames])))
    assert told["picture"] == "32 x 24 pixels"
    assert told["rate"].startswith("25.00 per second")


def test_where_the_name_is_wrong_the_remedy_is_the_name() -> None:
    with simulated_igtl.bench() as one:
        code, out, err = probed(f"igtl://{one.target}?probe=Needle&image=Reference", seconds="0.6")
    poses, _, pictures = out.partition("Pictures")
    assert code == 69
    assert "nothing to use came within 0.6 s: no transform 'NeedleToTracker' came; the server sends" in err
    assert "TRANSFORM 'ProbeToTracker'" in err
    assert "TRANSFORM 'WitnessToTracker'. Name one that it sends by probe= in the URL" in err
    assert "! no transform 'NeedleToTracker' came; the server sends" in poses
    assert "Bring the tool into view" not in poses
    assert "no IMAGE 'Reference' came; the server sends" in pictures
    assert "Have the server send its pictures as IMAGE" in pictures


@contextmanager
def serving(message: Message) -> Iterator[str]:
    """A server's URL that sends one message to each client, and then is there."""
    with socket.create_server(("127.0.0.1", 0)) as door, ExitStack() as lines:

        def serve() -> None:
            with suppress(OSError):
                while True:
                    lines.enter_context(line := door.accept()[0])
                    line.sendall(encode(message))

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield f"igtl://127.0.0.1:{door.getsockname()[1]}"
        finally:
            door.shutdown(socket.SHUT_RDWR)
            thread.join()


def test_where_no_pose_is_sent_there_is_none_to_name() -> None:
    picture = Message("IMAGE", "Image", Image((16, 16, 1), bytes(16 * 16)).content)
    with serving(picture) as url:
        code, _, err = probed(f"{url}?deadline_ms=5000", "--only", "poses", seconds="0.5")
    assert (code, "sends IMAGE 'Image'. Have the server send the tool's pose as TRANSFORM" in err) == (69, True), err


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("relay:/dev/null", "/dev/null: is no serial port. Correct the path"),
        ("relay:/dev", "/dev: is no serial port. Correct the path"),
        ("gpio:/dev/null?line=3", "gpio:/dev/null line 3: is no GPIO chip. Correct the path"),
        ("gpio:/dev?line=3", "gpio:/dev line 3: is no GPIO chip. Correct the path"),
    ],
)
def test_what_is_no_device_has_no_cable_to_check(url: str, words: str) -> None:
    code, _, err = probed(url, "--click")
    assert (code, words in err) == (69, True), err


def test_a_tone_has_no_contact_to_move() -> None:
    code, _, err = probed("tone:default")
    assert (code, "sounds its tone. Add --click while the tone is not in use" in err) == (78, True), err


@pytest.mark.parametrize("options", [(), ("--only", "pictures")])
def test_a_server_of_volumes_gives_nothing_and_the_remedy_fits_one_that_has_no_other(options: tuple[str, ...]) -> None:
    volume = Message("IMAGE", "Volume", Image((16, 16, 3), bytes(16 * 16 * 3)).content)
    with serving(volume) as url:
        code, out, err = probed(url, *options, seconds="0.5")
    what = "'Volume' sends volumes of 16 x 16 x 3 instead of pictures. Name a picture of it by image=, or have it send"
    assert code == 69
    assert what in out + err
    last = [line for line in out.splitlines() if line][-1]
    assert last == "nothing" if options else last.startswith("nothing: ") and what in last


def test_a_server_that_is_not_there_is_told_once() -> None:
    code, out, err = probed("igtl://127.0.0.1:1", seconds="0.5")
    assert (code, (out + err).count("127.0.0.1:1")) == (69, 1), out + err
    assert "Pictures" not in out
    assert out.splitlines()[-1] == "nothing"


def test_a_server_of_poses_alone_is_good_where_no_more_is_asked() -> None:
    with simulated_igtl.bench() as one:
        url = f"igtl://{one.target}?image=None"
        code, out, _ = probed(url, seconds="0.6")
        assert (code, "--only poses" in out) == (69, True), out
        code, out, err = probed(url, "--only", "poses", seconds="0.6")
        word = out.splitlines()[-1].split()[0].strip(",")  # so short a look knows the time badly
        assert (code, err, word in ("good", "poor")) == (0, "", True), out
        assert "Pictures" not in out
        assert probed(url, "--only", "pictures", seconds="0.6")[0] == 69
    code, _, err = probed("v4l2:/dev/video0", "--only", "poses")
    assert (code, "gives no poses; leave --only out" in err) == (2, True)


@pytest.mark.parametrize(
    ("typed", "said"), [((), "igtl://host"), (("v4l2",), "Write v4l2: and then"), (("x:y",), "v4l2:")]
)
def test_what_it_takes_is_listed_where_none_of_it_was_given(typed: tuple[str, ...], said: str) -> None:
    ended = answered("probe", *typed)
    assert ended.returncode in (2, 78)
    assert said in ended.stderr
    assert "ndi+tcp://v4l2" not in ended.stderr
