"""`python -m tests.bench.onlookers [N]`: is the contact later with everything on that looks on? Same run, in turns.

Each sample is what the service logs of a switch: from the word FAULT to the last byte of the command. With: metrics and
who scrapes them, MQTT with its broker, OpenIGTLink with ten clients, half of them asleep or hostile, the recorder, the
page with one who looks at it, two viewers of the feed; all idle, as their units are. Quantiles come with the interval
that their order statistics give, their ratio with one by resampling.
"""

import json
import os
import socket
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import numpy as np
from scipy.stats import binom

from probewatch.drivers.openigtlink.message import Message, encode
from probewatch.tools.simulators.whole_cart import Part
from tests.bench.contact_delay import delays_ms, restart_for_measuring
from tests.live.test_feed import LOOKER, READER
from tests.support.demo_cart import PROBEWATCH, Cart
from tests.support.polling import until
from tests.support.web_page import WebPage
from tests.tools.monitoring.test_mqtt import Mosquitto

BLOCKS = 4
"""Turns with and without: what the machine does besides changes over minutes."""
SHARES = (0.5, 0.99)
CONFIDENCE = 0.95
_RESAMPLED = 5000
_IDLE = ["/usr/bin/chrt", "-i", "0"]
_SCRAPER = """
import sys, time, urllib.request
while True:
    with urllib.request.urlopen(sys.argv[1], timeout=10) as answer:
        answer.read()
    time.sleep(1)
"""
READERS, SLEEPERS, FLOODERS = 5, 3, 2
"""Clients of OpenIGTLink: those of them that read see pictures and poses."""
VIEWERS = 5
"""Of the feed: recorder, page, OpenIGTLink and two more."""


def clients(port: int) -> None:
    """Ten of them, for ever."""
    ask = b"".join(encode(Message(kind, "", b"")) for kind in ("STT_IMAGE", "STT_TRANS"))
    lines = [socket.create_connection(("127.0.0.1", port)) for _ in range(READERS + SLEEPERS)]
    for line in lines:
        line.sendall(ask)
        line.setblocking(False)
    hostile: list[socket.socket] = []
    print(json.dumps({"ready": True}), flush=True)
    while True:
        for line in lines[:READERS]:
            with suppress(BlockingIOError):
                while line.recv(1 << 20):
                    pass
        _be_hostile(hostile, port)
        time.sleep(0.01)


def _be_hostile(hostile: list[socket.socket], port: int) -> None:
    """Questions without end and answers that nobody reads, then nonsense; again as soon as the server drops one."""
    while len(hostile) < FLOODERS:
        hostile.append(socket.create_connection(("127.0.0.1", port)))
        hostile[-1].setblocking(False)
    for line in tuple(hostile):
        try:
            line.send(encode(Message("GET_STRING", "", b"")) * 50)
        except BlockingIOError:
            with suppress(OSError):
                line.send(b"\xff" * 100)
        except OSError:
            line.close()
            hostile.remove(line)


@contextmanager
def everything(cart: Cart, folder: Path) -> Iterator[None]:
    """Whoever may look on, at work to the end: DeviceLost where one of them was not."""
    control = ["--socket", str(cart.socket)]
    parts: list[Part] = []
    with ExitStack() as running:

        def start(name: str, *command: object) -> Part:
            part = Part(name, [*_IDLE, *map(str, command)])
            running.callback(part.end, kill=True)
            parts.append(part)
            return part

        def python(name: str, *arguments: object) -> Part:
            return start(name, sys.executable, *arguments)

        metrics = _free_port()
        start("metrics", PROBEWATCH, "metrics", *control, "--listen", f"127.0.0.1:{metrics}")
        until(lambda: _listens(metrics), 60)
        python("scraper", "-c", _SCRAPER, f"http://127.0.0.1:{metrics}/metrics")
        broker = Mosquitto(folder, "allow_anonymous true")
        running.callback(broker.end)
        start("mqtt", PROBEWATCH, "mqtt", *control, "--cart", "bench", "--broker", f"mqtt://127.0.0.1:{broker.port}")
        igtl = _free_port()
        start("openigtlink", PROBEWATCH, "openigtlink", *control, "--port", igtl)
        until(lambda: _listens(igtl), 60)
        python("clients", "-m", "tests.bench.onlookers", "clients", igtl)
        start("recorder", PROBEWATCH, "record", "--config", _recorder_config(cart))
        web = running.enter_context(WebPage(folder, cart.socket, before=_IDLE))
        python("looker", "-c", LOOKER, f"{web.url}picture")
        for every in (1, 2):
            python("viewer", "-c", READER, cart.socket.with_name("feed"), every)

        def viewers() -> int:
            for part in parts:
                part.require()
            return int(cart.status()["feed"]["clients"])

        until(lambda: viewers() >= VIEWERS, 240, otherwise=lambda: f"{viewers()} of {VIEWERS} viewers of the feed")
        yield
        for part in parts:
            part.require()


def _recorder_config(cart: Cart) -> Path:
    folder, config = cart.folder / "recorder", cart.folder / "recorder.toml"
    own = f'[recorder]\nfolder = "{folder}"\nsocket = "{folder}.socket"\ntext = "keep"\nleave_free_gb = 0.1\n'
    config.write_text(cart.config.read_text() + own)
    return config


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as door:
        return int(door.getsockname()[1])


def _listens(port: int) -> bool:
    with socket.socket() as link:
        return link.connect_ex(("127.0.0.1", port)) == 0


def quantile(values: Sequence[float], share: float) -> tuple[float, float, float]:
    """(value, lower, upper), ms: the order statistics between which the quantile lies with CONFIDENCE; the largest
    value stands where there are too few for an upper one.
    """
    ordered, n = np.sort(values), len(values)
    low, high = (float(binom.ppf(tail, n, share)) for tail in ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2))
    return (
        float(np.quantile(ordered, share)),
        float(ordered[max(int(low) - 1, 0)]),
        float(ordered[min(int(high), n - 1)]),
    )


def ratio(beside: Sequence[float], without: Sequence[float], share: float) -> tuple[float, float, float]:
    """(ratio, lower, upper) of the two quantiles, by resampling each."""
    chance = np.random.default_rng(1)
    drawn = [np.quantile(chance.choice(one, (_RESAMPLED, len(one))), share, axis=1) for one in (beside, without)]
    lower, upper = np.quantile(drawn[0] / drawn[1], [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(np.quantile(beside, share) / np.quantile(without, share)), float(lower), float(upper)


def main() -> None:
    if sys.argv[1:2] == ["clients"]:
        return clients(int(sys.argv[2]))
    samples = int(sys.argv[1]) if len(sys.argv) > 1 else 400
    found: dict[str, list[float]] = {"without": [], "with": []}
    began = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as place, Cart(Path(place), trusting=True) as cart:
        cart.wait_for("monitoring", 60)
        restart_for_measuring(cart)
        for block in range(BLOCKS):
            found["without"] += delays_ms(cart, samples // BLOCKS)
            folder = Path(place) / str(block)
            folder.mkdir()
            with everything(cart, folder):
                found["with"] += delays_ms(cart, samples // BLOCKS)
            until(lambda: cart.status()["feed"]["clients"] == 0, 60)
    told = {name: {f"p{share:.0%}": _told(quantile(one, share)) for share in SHARES} for name, one in found.items()}
    ratios = {f"p{share:.0%}": _told(ratio(found["with"], found["without"], share)) for share in SHARES}
    print(
        json.dumps(
            {"switches": len(found["with"]), "load before": began, "ms": told, "ratio": ratios},
            indent=1,
            ensure_ascii=False,
        )
    )
    return None


def _told(figures: tuple[float, float, float]) -> str:
    value, lower, upper = figures
    return f"{value:.3g} ({lower:.3g} … {upper:.3g})"


if __name__ == "__main__":
    main()
