"""The relay driver on simulated boards behind a real pseudo-terminal."""

import errno
import json
import os
import re
import select
import signal
import subprocess
import termios
import threading
import time
import tty
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest
import serial
from hypothesis import given, settings
from hypothesis import strategies as st

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError, DeviceLost
from probewatch.drivers.io import shared_port
from probewatch.drivers.io.serial_port import open_serial
from probewatch.drivers.outputs import relay
from probewatch.drivers.outputs.relay import STATUS_QUERY, RelayOutput, _contacts, relay_command
from probewatch.drivers.registry import open_output
from probewatch.drivers.twins.pty_line import PtyLine
from tests.support.boards import running_board
from tests.support.polling import until
from tests.support.simulated import PROBEWATCH
from tests.support.stopwatch import Stopwatch

CLOCK = HostClock(rate=5.0)
SWITCHED_S = 2.0


def test_command_bytes() -> None:
    assert relay_command(1, True) == bytes.fromhex("a00101a2")
    assert relay_command(1, False) == bytes.fromhex("a00100a1")
    assert relay_command(2, True) == bytes.fromhex("a00201a3")


def test_write_returns_after_an_answering_board_has_switched(tmp_path: Path) -> None:
    with running_board(tmp_path / "relay", CLOCK, channels=2) as board:
        with open_output(f"relay:{tmp_path}/relay?channel=2", CLOCK) as output:
            output.write(True)
            assert board.contacts == {1: False, 2: True}
            output.write(False)
            assert board.contacts == {1: False, 2: False}
            output.write(True)
        assert board.contacts == {1: False, 2: False}, "leaving the context de-energises"


def test_silent_board_is_driven_all_the_same(tmp_path: Path) -> None:
    with running_board(tmp_path / "relay", CLOCK, answers=False) as board:
        with open_output(f"relay:{tmp_path}/relay", CLOCK) as output:
            output.write(True)
            until(lambda: board.contacts[1] is True, SWITCHED_S)
        until(lambda: board.contacts[1] is False, SWITCHED_S)


def test_leaving_on_an_error_de_energises(tmp_path: Path) -> None:
    with running_board(tmp_path / "relay", CLOCK) as board:
        with suppress(RuntimeError), open_output(f"relay:{tmp_path}/relay", CLOCK) as output:
            output.write(True)
            raise RuntimeError
        assert board.contacts[1] is False


def test_welded_contact_is_noticed(tmp_path: Path) -> None:
    with running_board(tmp_path / "relay", CLOCK) as board, open_output(f"relay:{tmp_path}/relay", CLOCK) as output:
        output.write(True)
        board.stuck = True
        with pytest.raises(DeviceLost, match="did not switch, its contact is closed"):
            output.write(False)


def test_board_that_must_confirm_but_cannot_is_refused(tmp_path: Path) -> None:
    with running_board(tmp_path / "relay", CLOCK, answers=False), pytest.raises(DeviceLost, match="does not report"):
        open_output(f"relay:{tmp_path}/relay?confirm=yes", CLOCK)


def test_a_board_that_answers_late_must_go_on_from_then_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Deaf when it is opened, as while it starts: it must not pass for one that never answers."""
    monkeypatch.setattr(relay, "_ANSWER_S", 0.1)
    url = f"relay:{tmp_path}/relay"
    with running_board(tmp_path / "relay", CLOCK, answers=False) as board, open_output(url, CLOCK) as output:
        assert isinstance(output, RelayOutput)
        output.write(True)
        assert not output.confirmed
        board._answers = True
        for level in (False, True) * 20:
            output.write(level)
            CLOCK.sleep_until(CLOCK.now_ns() + 50_000_000)
        assert output.confirmed
        board._answers = False
        with pytest.raises(DeviceLost, match="does not answer"):
            output.write(True)


@pytest.mark.parametrize("confirm", ["auto", "no"])
def test_a_board_that_never_answers_is_asked_once_a_second_or_not_at_all(tmp_path: Path, confirm: str) -> None:
    with running_board(tmp_path / "relay", CLOCK, answers=False) as board:
        asked, report = list[int](), board._report
        board._report = lambda: (asked.append(CLOCK.now_ns()), report())[1]  # type: ignore[method-assign]
        with open_output(f"relay:{tmp_path}/relay?confirm={confirm}", CLOCK) as output:
            end_ns = CLOCK.now_ns() + 5_000_000_000
            while CLOCK.now_ns() < end_ns:
                output.write(True)
                CLOCK.sleep_until(CLOCK.now_ns() + 50_000_000)
            assert board.contacts[1]
        assert len(asked) in ((0,) if confirm == "no" else (4, 5, 6))


def test_a_board_that_has_reported_once_must_go_on(tmp_path: Path) -> None:
    """Opened again, a hung board must not pass for one of those that never answer."""
    url = f"relay:{tmp_path}/relay"
    with running_board(tmp_path / "relay", CLOCK), open_output(url, CLOCK) as output:
        output.write(True)
    with running_board(tmp_path / "relay", CLOCK, answers=False):
        with pytest.raises(DeviceLost, match="does not report"):
            open_output(url, CLOCK)
        with open_output(f"{url}?confirm=no", CLOCK) as output:
            output.write(True)


def test_port_in_use_says_so(tmp_path: Path) -> None:
    with running_board(tmp_path / "relay", CLOCK), open_serial(f"{tmp_path}/relay", 9600):
        with pytest.raises(DeviceLost, match="in use by another program") as refusal:
            open_output(f"relay:{tmp_path}/relay", CLOCK)
        assert "Close that program" in str(refusal.value)


@pytest.mark.parametrize("answers", [True, False])
def test_channels_of_one_board_are_driven_at_the_same_time(tmp_path: Path, answers: bool) -> None:
    with running_board(tmp_path / "relay", CLOCK, channels=3, answers=answers) as board, ExitStack() as stack:
        urls = [f"relay:{tmp_path}/relay?channel={channel}" for channel in (1, 2, 3)]
        outputs = [stack.enter_context(open_output(url, CLOCK)) for url in urls]
        with ThreadPoolExecutor() as pool:
            for energised in (True, False) * 10:
                list(pool.map(lambda output, level=energised: output.write(level), outputs))
                until(lambda level=energised: set(board.contacts.values()) == {level}, SWITCHED_S)


def test_a_port_that_hangs_while_it_is_opened_holds_up_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    goes_on, stuck = threading.Event(), tmp_path / "stuck"

    def hanging(path: str, baud: int) -> serial.Serial:
        if path == str(stuck):
            goes_on.wait(10)
        return open_serial(path, baud)

    monkeypatch.setattr(shared_port, "open_serial", hanging)

    def open_stuck() -> None:
        with suppress(DeviceLost):
            shared_port.shared_port(str(stuck), 9600)

    first = threading.Thread(target=open_stuck)
    with running_board(tmp_path / "relay", CLOCK) as board:
        first.start()
        watch = Stopwatch()
        with open_output(f"relay:{tmp_path / 'relay'}", CLOCK) as output:
            output.write(True)
            until(lambda: board.contacts[1] is True, SWITCHED_S)
        assert watch.spent_s() < 5
        goes_on.set()
        first.join()


def test_a_board_that_went_is_lost_for_every_channel_and_can_be_opened_again(tmp_path: Path) -> None:
    with ExitStack() as stack:
        with running_board(tmp_path / "relay", CLOCK, channels=2):
            outputs = [stack.enter_context(open_output(f"relay:{tmp_path}/relay?channel={n}", CLOCK)) for n in (1, 2)]
        for output in outputs:
            with pytest.raises(DeviceLost):
                output.write(True)
        url = f"relay:{tmp_path}/relay?channel=2"
        with running_board(tmp_path / "relay", CLOCK, channels=2) as board, open_output(url, CLOCK) as output:
            output.write(True)
            assert board.contacts[2]


def test_absent_port_says_so(tmp_path: Path) -> None:
    with pytest.raises(DeviceLost, match="no such serial port"):
        open_output(f"relay:{tmp_path}/nothing", CLOCK)


@pytest.mark.parametrize("query", ["channel=0", "channel=x", "confirm=maybe", "chanel=1"])
def test_bad_option_is_a_configuration_error(query: str) -> None:
    with pytest.raises(ConfigurationError):
        open_output(f"relay:/dev/null?{query}", CLOCK)


def test_an_answer_that_came_while_this_host_was_busy_is_no_silence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The host gets no processor time between its question and the end of its timeout."""
    with running_board(tmp_path / "relay", CLOCK) as board, open_output(f"relay:{tmp_path}/relay", CLOCK) as output:
        assert isinstance(output, RelayOutput)
        send = output._port.send

        def send_and_sleep(data: bytes) -> None:
            send(data)
            if data == STATUS_QUERY:
                until(lambda: select.select([output._port._port.fileno()], [], [], 0)[0], SWITCHED_S)
                time.sleep(0.02)
                monkeypatch.setattr(relay, "_ANSWER_S", -1.0)

        monkeypatch.setattr(output._port, "send", send_and_sleep)
        output.write(True)
        assert board.contacts[1]


def test_a_signal_while_the_last_byte_leaves_is_no_failure_of_the_port(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the reload of the configuration, or SIGCONT, may interrupt tcdrain(3)."""
    with running_board(tmp_path / "relay", CLOCK) as board, open_output(f"relay:{tmp_path}/relay", CLOCK) as output:
        assert isinstance(output, RelayOutput)
        port, interrupted = output._port._port, [termios.error(errno.EINTR, "Interrupted system call")] * 2
        flush = port.flush

        def flush_interrupted() -> None:
            if interrupted:
                raise interrupted.pop()
            flush()

        monkeypatch.setattr(port, "flush", flush_interrupted)
        output.write(True)
        assert board.contacts[1]
        interrupted.append(termios.error(errno.EIO, "Input/output error"))
        with pytest.raises(DeviceLost, match="Input/output error"):
            output.write(False)


def test_unplugged_board_is_lost(tmp_path: Path) -> None:
    with PtyLine(tmp_path / "relay", CLOCK) as line:
        output = open_output(f"relay:{tmp_path}/relay?confirm=no", CLOCK)
        line.unplug()
        with output, pytest.raises(DeviceLost, match="port failed"):
            output.write(True)


def test_board_process_reports_its_contact_and_a_killed_one_loses_the_output(tmp_path: Path) -> None:
    link = tmp_path / "relay"
    command = [*PROBEWATCH, "simulate", "relay", "--pty", str(link), "--origin-ns"]
    with subprocess.Popen([*command, str(time.monotonic_ns())], stdout=subprocess.PIPE, text=True) as board:
        assert board.stdout is not None
        try:
            assert json.loads(board.stdout.readline()) == {"ready": True, "url": f"relay:{link}?channel=1"}
            with open_output(f"relay:{link}", HostClock()) as output:
                before_ns = time.monotonic_ns()
                output.write(True)
                event = json.loads(board.stdout.readline())
                assert event["energised"] is True
                assert before_ns <= event["t_ns"] <= time.monotonic_ns()
                os.kill(board.pid, signal.SIGKILL)
                board.wait()
                with pytest.raises(DeviceLost):
                    output.write(True)
        finally:
            board.kill()


REPORTS = st.lists(
    st.sampled_from(
        [b"CH1: ON\r\n", b"CH1: OFF\r\n", b"CH2: ON\r\n", b"CH11: ON\r\n", b"CH1: O", b"N\r\n", b"\xff\x1b"]
    )
    | st.binary(max_size=8),
    max_size=6,
).map(b"".join)


@settings(max_examples=300, deadline=None)
@given(report=REPORTS)
def test_whatever_a_board_answers_is_closed_open_or_not_said(report: bytes) -> None:
    """A contact that is called closed and open in one answer is neither."""
    found = _contacts(report)
    for channel, closed in found.items():
        word, other = (b"ON", b"OFF") if closed else (b"OFF", b"ON")
        assert re.search(rb"CH *0?%d *: *%s\s" % (channel, word), report)
        assert not re.search(rb"CH *0?%d *: *%s\s" % (channel, other), report)


@contextmanager
def answering(*reports: bytes, pause_s: float = 0.0) -> Iterator[tuple[str, list[bytes]]]:
    """A board on a pseudo-terminal that reports the last of these, in two halves where there is a pause: its path, and
    the reports."""
    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    replies, stop = [*reports], threading.Event()

    def board() -> None:
        while not stop.is_set():
            if select.select([master], [], [], 0.05)[0] and STATUS_QUERY in os.read(master, 64):
                report, halved = replies[-1], pause_s > 0 and len(replies) > 1
                half = len(report) // 2 if halved else 0
                with suppress(BlockingIOError):
                    if halved:
                        os.write(master, report[:half])
                        stop.wait(pause_s)
                    os.write(master, report[half:])

    thread = threading.Thread(target=board)
    thread.start()
    try:
        yield os.ttyname(slave), replies
    finally:
        stop.set()
        thread.join()
        os.close(master)
        os.close(slave)


@pytest.mark.parametrize(
    "answer", [b"CH1: ON\r\nCH1: OFF\r\n", b"CH2: ON\r\n", b"\x1b[2JCH1:", b"CH1: ON" * 10_000, b""]
)
def test_no_answer_but_a_clear_one_counts(tmp_path: Path, answer: bytes) -> None:
    """A board that has reported once and then says something else is lost within a second, and nothing worse."""
    with answering(b"CH1: OFF\r\n") as (path, replies), open_output(f"relay:{path}", HostClock()) as output:
        replies.append(answer)
        watch = Stopwatch()
        with pytest.raises(DeviceLost) as refusal:
            output.write(True)
        assert watch.spent_s() < 5
        assert str(refusal.value).isprintable()


def test_a_report_that_a_busy_host_delivers_in_two_halves_is_one() -> None:
    with (
        answering(b"CH1: OFF\r\n", pause_s=0.15) as (path, replies),
        open_output(f"relay:{path}", HostClock()) as output,
    ):
        replies.append(b"CH1: ON\r\n")
        output.write(True)
        replies.append(b"CH1: OFF\r\n")
        output.write(False)
