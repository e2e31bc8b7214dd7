"""The demo's whole timeline, told to an OpenIGTLink client: never OK of a time at which the contact was open."""

import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import pytest

from probewatch.appliance.supervision.supervisor import LATCHED
from probewatch.appliance.types import State
from probewatch.drivers.openigtlink.content import OK, parse_status
from probewatch.drivers.openigtlink.message import Message
from probewatch.tools.demo.director import Director
from probewatch.tools.demo.script import default_plan
from tests.support.demo_cart import PROBEWATCH, Cart
from tests.support.igtl_listener import Listener
from tests.support.polling import until

TICK_S = 0.05
"""Of the service: within it the board takes what the tick has decided."""
LONGEST_S = 420.0
"""Of the run, which takes some 150 s on a free machine."""


class Heard:
    """Every message of the server, read by a thread of its own, and the poses and pictures that were asked for."""

    def __init__(self, port: int) -> None:
        self._listener, self._ended = Listener(("127.0.0.1", port)), threading.Event()
        self._listener.ask("STT_TRANS")
        self._listener.ask("STT_IMAGE")
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        with self._listener:
            while not self._ended.is_set():
                self._listener.listen(0.2)
                self._drop_pictures()

    def _drop_pictures(self) -> None:
        """All but their number: a run has a gigabyte of them."""
        kept = [Message(one.kind, one.device, b"", one.time) if one.kind == "IMAGE" else one for one in self.messages]
        self._listener.heard[:] = kept

    @property
    def messages(self) -> list[Message]:
        return self._listener.heard

    def end(self) -> list[Message]:
        self._ended.set()
        self._thread.join()
        return self.messages


@contextmanager
def told(cart: Cart) -> Iterator[Heard]:
    command = [str(PROBEWATCH), "openigtlink", "--socket", str(cart.socket), "--port", "0", "--every", "0.05"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        heard = Heard(int(process.stdout.readline().rpartition(":")[2]))
        try:
            yield heard
        finally:
            heard.end()
            process.send_signal(signal.SIGTERM)
            assert process.wait(30) == 0


def play(cart: Cart, director: Director) -> list[tuple[float, str]]:
    """As `probewatch demo` does: one fault after the other, each acknowledged once it has been removed. (s, reason) of
    every change.
    """
    end_s = time.monotonic() + LONGEST_S
    seen = [(0.0, "")]
    while not director.finished(cart.now_s()) and time.monotonic() < end_s:
        cart.require_alive()
        status, t_s = cart.status(), cart.now_s()
        if status:
            if seen[-1][1] != status["reason"]:
                seen.append((t_s, status["reason"]))
            if director.step(t_s, State(status["state"])):
                cart.show_faults(director.orders)
            if State(status["state"]) in LATCHED and director.on(t_s) is None and not status["acknowledged"]:
                cart.acknowledge()
        time.sleep(TICK_S)
    return seen


@pytest.mark.slow
def test_ok_is_never_said_of_a_time_at_which_the_contact_was_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the time that each STATUS is true for, and the relay board's own clock, through every fault of the demo."""
    for timeout in ("_FIRST_S", "LONGEST_RECOVERY_S"):  # how soon it verifies is not asked here
        monkeypatch.setattr(f"probewatch.tools.demo.director.{timeout}", LONGEST_S)
    plan = default_plan()
    director = Director(plan)
    with Cart(tmp_path, seed=1) as cart:
        cart.wait_for("not verified", 60)
        with told(cart) as heard:
            until(lambda: heard.messages, 20)
            seen = play(cart, director)
        utc_ns = time.time_ns() - time.monotonic_ns()
        switched = [*cart.switched(), (float("inf"), False)]
    assert [one.fault for one in director.shown] == [one.fault for one in plan], seen
    messages = heard.messages
    statuses = [one for one in messages if (one.kind, one.device) == ("STATUS", "Probewatch")]
    said_ok = [(one.time_ns - utc_ns) / 1e9 for one in statuses if parse_status(one.content).code == OK]
    was_closed = [(a_s, b_s) for (a_s, energised), (b_s, _) in pairwise(switched) if energised]
    wrong = [t_s for t_s in said_ok if not any(a_s <= t_s + TICK_S and t_s <= b_s for a_s, b_s in was_closed)]
    assert not wrong, f"{len(wrong)} of {len(said_ok)}: {wrong[:5]}, {was_closed}"
    assert len(was_closed) > len(plan) / 2
    assert len(said_ok) > 200
    assert len(statuses) - len(said_ok) > 200
    kinds = [(one.kind, one.device) for one in messages]
    passed = {name: kinds.count(name) for name in (("IMAGE", "Image"), ("TRANSFORM", "ProbeToTracker"))}
    print(f"\n{len(statuses)} STATUS, {len(said_ok)} of them OK, {len(was_closed)} times closed, {passed}")
    assert min(passed.values()) > 1000
    assert ("TRANSFORM", "ImageToProbeEstimate") in kinds
