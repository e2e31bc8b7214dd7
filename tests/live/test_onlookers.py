"""One cart and who looks on: nothing that becomes of them is felt.

That what they are told is true at every moment: tests/appliance/service/test_onlookers.py.
"""

import signal
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from probewatch.tools.simulators.whole_cart import Part
from tests.support.demo_cart import PROBEWATCH, Cart
from tests.support.polling import until
from tests.tools.monitoring.test_mqtt import MOSQUITTO, Mosquitto, Program, Reader

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
