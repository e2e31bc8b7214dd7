"""One holder of a recalibration at a time; one that is gone is given up once, said, and never for another's silence."""

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from probewatch.appliance.service.control.client import ControlClient
from probewatch.appliance.service.control.hold import LONGEST_S, SHORTEST_S, Hold, hold_s_of
from probewatch.appliance.service.control.server import ControlRefused, ControlServer, Peer
from probewatch.drivers.errors import DeviceLost
from tests.support.polling import until

HELD, OTHER = Peer(7, 1000, 1), Peer(8, 1000, 2)
S_NS = 1_000_000_000


class Bench:
    def __init__(self) -> None:
        self.aborted = 0
        self.noted: list[dict[str, Any]] = []
        self.is_open = True
        self.hold = Hold(
            self._abort, lambda event, **data: self.noted.append({"event": event, **data}), lambda _: self.is_open
        )

    def _abort(self) -> None:
        self.aborted += 1

    def look(self, at_s: float, *, recalibrating: bool = True, is_open: bool = True) -> None:
        self.is_open = is_open
        self.hold.look(round(at_s * S_NS), recalibrating)

    def told(self, at_s: float = 0, recalibrating: bool = False, monitoring: bool = False) -> dict[str, Any] | None:
        return self.hold.fields(HELD, round(at_s * S_NS), recalibrating, monitoring)

    def refusal(self, who: Peer, at_s: float, begins: bool = True) -> str:
        """What who asks is told, empty where he may."""
        try:
            self.hold.refuse_other(who, round(at_s * S_NS), begins)
        except ControlRefused as refused:
            return str(refused)
        return ""


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.hold.begin(HELD, "anna, process 7", 20.0, 0)
    return bench


def test_a_connection_that_is_gone_gives_it_up_once_and_says_who(bench: Bench) -> None:
    bench.look(1)
    told = bench.told(1, recalibrating=True)
    assert (bench.aborted, told["silent_s"], told["since_s"], told["yours"]) == (0, 1.0, 1.0, True)
    for at_s in (2, 3):
        bench.look(at_s, is_open=False)
    assert bench.aborted == 1
    assert [one["event"] for one in bench.noted] == ["recalibration given up"]
    assert "anna, process 7, whose connection is gone" in bench.told()["ended"]
    assert bench.told(monitoring=True) is None


def test_silence_is_counted_from_the_last_word_of_that_connection(bench: Bench) -> None:
    bench.hold.hear(HELD, 15 * S_NS)
    bench.hold.hear(OTHER, 30 * S_NS)
    bench.look(35)
    assert bench.aborted == 0
    bench.look(35.01)
    assert bench.aborted == 1
    assert "silent for 20 s" in bench.told()["ended"]
    bench.hold.hear(HELD, 36 * S_NS)
    bench.look(100)
    assert bench.aborted == 1, "what was given up stays so until it is begun again"


def test_what_was_taken_or_ended_otherwise_hangs_on_nothing(bench: Bench) -> None:
    bench.hold.release()
    bench.look(99, is_open=False)
    bench.hold.begin(HELD, "anna", 20.0, 0)
    bench.look(1, recalibrating=False)
    bench.look(2, is_open=False)
    assert (bench.aborted, bench.noted, bench.told()) == (0, [], None)


def test_without_a_hold_nobody_is_missed_and_who_begins_again_holds(bench: Bench) -> None:
    bench.hold.begin(OTHER, "bert, process 8", None, 0)
    bench.look(10_000, is_open=False)
    told = bench.told(10_000, recalibrating=True)
    assert (bench.aborted, told["who"], told["silent_s"]) == (0, "bert, process 8", None)
    bench.hold.begin(OTHER, "bert, process 8", 1.0, 0)
    bench.look(2)
    assert bench.aborted == 1


HOLDS = (
    "anna, process 7 has recalibrated for 12 s. Wait, or end it there; it is given up once that process is "
    "gone, or silent for 20 s"
)


def test_another_neither_begins_nor_ends_what_is_held_and_is_told_who_holds_it(bench: Bench) -> None:
    for begins in (True, False):
        assert bench.refusal(OTHER, 12, begins) == HOLDS
        assert bench.refusal(Peer(7, 1000, 9), 12, begins) == "", "another connection of the same process"
        assert bench.refusal(Peer(7, 1001, 9), 12, begins) == HOLDS
        assert bench.refusal(OTHER, 20.01, begins) == "", "who is silent for too long holds nothing"
    assert not bench.hold.fields(OTHER, 0, recalibrating=True, monitoring=False)["yours"]
    bench.is_open = False
    assert bench.refusal(OTHER, 12) == "", "nor does who is gone, in the tick in which he went"


def test_processes_that_the_kernel_does_not_tell_apart_are_not_taken_for_one(bench: Bench) -> None:
    bench.hold.begin(Peer(0, 1000, 1), "anna, process 0", 20.0, 0)
    assert bench.refusal(Peer(0, 1000, 2), 12)


def test_while_who_gave_a_calibration_waits_for_its_proof_nobody_else_changes_it(bench: Bench) -> None:
    """Who has left leaves it free, and the service proves it by itself: that is not given up."""
    assert bench.hold.scans
    bench.hold.give()
    assert not bench.hold.scans
    assert "anna, process 7 has recalibrated for 12 s, and the new calibration is being ver" in bench.refusal(OTHER, 12)
    bench.look(13, is_open=False)
    assert (bench.aborted, bench.refusal(OTHER, 13), bench.told(13, recalibrating=True)) == (0, "", None)


def test_what_hangs_on_no_connection_may_be_ended_by_anybody_and_begun_twice_by_nobody(bench: Bench) -> None:
    bench.hold.begin(HELD, "anna, process 7", None, 0)
    bench.look(10_000, is_open=False)
    said = "anna, process 7 has recalibrated for 10000 s. Wait, or end that first: abort-recalibration"
    assert (bench.refusal(OTHER, 10_000), bench.refusal(OTHER, 10_000, begins=False)) == (said, "")
    bench.hold.give()
    assert bench.refusal(OTHER, 10_001) == ""


@pytest.mark.parametrize("asked", [0, -1, 0.99, 3601, float("nan"), float("inf"), True, "20", [20], {}])
def test_senseless_times_are_refused(asked: object) -> None:
    with pytest.raises(ControlRefused, match=f"hold_s must be {SHORTEST_S:g} to {LONGEST_S:g} seconds"):
        hold_s_of(asked)
    assert (hold_s_of(None), hold_s_of(20)) == (None, 20.0)


def test_the_server_knows_which_connections_are_open(tmp_path: Path) -> None:
    """Over a real socket: each connection has a number of its own, and is known to be closed by the next poll."""
    asked: list[Peer] = []

    def answer(_do: str, _body: dict[str, Any], who: Peer) -> dict[str, Any]:
        asked.append(who)
        return {}

    with ControlServer(tmp_path / "control") as server:
        first, second = (ControlClient(tmp_path / "control", 0.01) for _ in range(2))
        for client in (first, second):
            with pytest.raises(DeviceLost):
                client.test_lamps()  # which nobody has heard yet
        until(lambda: server.poll(answer) or len(asked) == 2)
        assert asked[0].link != asked[1].link
        assert all(server.is_open(who.link) for who in asked)
        first.close()
        until(lambda: server.poll(answer) or not server.is_open(asked[0].link))
        assert server.is_open(asked[1].link)
        second.close()


def test_a_crowd_that_asks_does_not_end_what_hangs_on_a_silent_connection(tmp_path: Path) -> None:
    """It leaves its place to nobody, though all others have asked since; whoever else is idle does."""
    asked: list[Peer] = []

    def answer(_do: str, _body: dict[str, Any], who: Peer) -> dict[str, Any]:
        if not asked:
            hold.begin(who, "anna, process 7", 20.0, 0)
        asked.append(who)
        return {}

    with ControlServer(tmp_path / "control") as server, ExitStack() as crowd:
        hold = Hold(lambda: None, lambda *_, **__: None, server.is_open)
        for count in range(1, 40):
            client = crowd.enter_context(ControlClient(tmp_path / "control", 0.001))
            with pytest.raises(DeviceLost):
                client.test_lamps()  # which nobody has heard yet
            until(lambda count=count: server.poll(answer, hold.link) or len(asked) == count)
        assert server.dropped_clients > 0
        hold.look(S_NS, recalibrating=True)
        assert hold.link == asked[0].link
        assert sum(server.is_open(who.link) for who in asked) == 16
