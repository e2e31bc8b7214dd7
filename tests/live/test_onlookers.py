"""One cart and who looks on: what they are told is true at every moment, and nothing that becomes of them is felt."""

import os
import signal
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.support.answering import RECORDED
from tests.support.demo_cart import PROBEWATCH, Cart
from tests.support.polling import until
from tests.tools.monitoring.test_mqtt import MOSQUITTO, Mosquitto, Program, Reader
from tools.monitoring.reading import Exposition
from tools.simulators.whole_cart import Part

pytestmark = pytest.mark.alone

NICE = "/usr/bin/nice"


@pytest.mark.skipif(not Path(MOSQUITTO).exists(), reason="needs mosquitto (mosquitto)")
def test_who_looks_on_may_vanish_hang_and_die_and_moves_no_contact(tmp_path: Path) -> None:
    """Broker, publisher and exporter."""
    with Cart(tmp_path, trusting=True) as cart, ExitStack() as running:
        cart.wait_for("monitoring")
        until(cart.contact)
        broker = Mosquitto(tmp_path, "allow_anonymous true")
        running.callback(broker.end)
        program = Program(cart.socket, "--broker", f"mqtt://127.0.0.1:{broker.port}")
        running.enter_context(program)
        exporter = Part(
            "exporter", [NICE, str(PROBEWATCH), "metrics", "--socket", str(cart.socket), "--listen", "[::1]:0"]
        )
        running.callback(exporter.end)
        with Reader(broker.port) as reader:
            until(lambda: reader.state().get("verified"), 60)
        began_s = time.monotonic()
        broker.end()
        until(lambda: any("no broker" in line for line in program.said), 20)
        time.sleep(2)
        broker.start()
        until(lambda: program.said[-1].startswith("telling "), 60)
        program.process.send_signal(signal.SIGSTOP)
        time.sleep(2)
        program.process.kill()
        exporter.end(kill=True)
        time.sleep(1)
        status = cart.status()
        assert (status["state"], status["energised"]) == ("monitoring", True)
        assert cart.switched(began_s) == []


def moments_closed(switched: list[tuple[float, bool]], from_s: float, to_s: float) -> bool:
    """Whether the contact was closed at some time between the two."""
    closed = False
    for t_s, energised in switched:
        if t_s > to_s:
            break
        closed = energised if t_s <= from_s else closed or energised
    return closed


def test_the_metrics_never_say_closed_while_the_contact_is_open(tmp_path: Path) -> None:
    """Over a run with faults, by the relay board's own clock, however often it is asked; and it changes nothing."""
    seen: list[tuple[float, float, bool]] = []
    ended = threading.Event()
    with Cart(tmp_path, trusting=True) as cart:
        exposition = Exposition(cart.socket)

        def ask() -> None:
            while not ended.is_set():
                from_s = time.monotonic()
                text = exposition.text()
                seen.append((from_s, time.monotonic(), b"\nprobewatch_contact_closed 1.0\n" in text))

        def said_closed() -> int:
            return sum(one[2] for one in tuple(seen))

        asking = [threading.Thread(target=ask) for _ in range(2)]
        for thread in asking:
            thread.start()
        try:
            for fault in ("scale", "polarity", None):
                cart.wait_for("monitoring")
                enough = said_closed() + 10
                until(lambda enough=enough: said_closed() >= enough, 20)
                cart.say(fault)
                if fault is not None:
                    cart.wait_for("halt")
                    cart.say(None)
                    until(cart.acknowledge, 10, 0.1)
            cart.wait_for("monitoring")
            killed_s = time.monotonic()
            os.kill(cart.estimator_pid(), signal.SIGKILL)
            until(lambda: cart.contact(killed_s) is False, 10)
            cart.wait_for("monitoring", 30)
            cart.twins["scanner"].end(kill=True)
            cart.wait_for("device lost")
            assert RECORDED.keys() == cart.status().keys(), "tests/data/status.json is of another version"
        finally:
            ended.set()
            for thread in asking:
                thread.join()
        switched = cart.switched()
    said = [one for one in seen if one[2]]
    wrong = [one for one in said if not moments_closed(switched, one[0], one[1])]
    assert not wrong, f"{len(wrong)} of {len(seen)}: {wrong[:3]}, {switched}"
    assert len(said) > 20
    assert len(seen) - len(said) > 20
    assert sum(not energised for _, energised in switched) >= 4, "the contact opened in each of the faults"
