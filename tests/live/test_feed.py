"""Who looks on through the feed of a real cart moves neither a verdict nor the alarm."""

import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest

from probewatch.drivers.errors import DeviceLost
from probewatch.tools.shared.feed import Feed
from probewatch.tools.simulators.whole_cart import Part
from tests.support.answers import answered
from tests.support.demo_cart import Cart
from tests.support.polling import until
from tests.support.web_page import WebPage

ALARMS = 24
"""In each half of a run; a turn takes some 1.5 s."""
_MORE_S = 0.05
"""One tick: by how much the delays may differ between two halves of a run on a machine with other work."""
NICE = ["/usr/bin/nice", "-n", "10"]
READER = """
import sys
from pathlib import Path
from probewatch.appliance.service.feed.request import FeedRequest
from probewatch.tools.shared.feed import Feed
for message in Feed(Path(sys.argv[1]), FeedRequest(every=int(sys.argv[2]))):
    pass
"""
SLEEPER = """
import sys, time
from pathlib import Path
from probewatch.tools.shared.feed import Feed
feed = Feed(Path(sys.argv[1]))
time.sleep(600)
"""
LOOKER = """
import sys, urllib.request
while True:
    with urllib.request.urlopen(sys.argv[1], timeout=10) as answer:
        answer.read()
"""


def opened_after_s(cart: Cart) -> float:
    """From the fault until the relay board, by its own clock, has opened; then the cart monitors again."""
    cart.wait_for("monitoring")
    until(cart.contact)
    began_s = time.monotonic()
    cart.say("scale")
    until(lambda: cart.contact(began_s) is False, 5, 0.002)
    after_s = next(t_s for t_s, closed in cart.switched(began_s) if not closed) - began_s
    cart.say(None)
    return after_s


@contextmanager
def onlookers(cart: Cart, web: WebPage) -> Iterator[None]:
    """Two who read, one who never does, and one who looks at the page's picture; niced, where their units are idle."""
    path = str(cart.socket.with_name("feed"))
    with ExitStack() as running:
        for how in ((READER, path, "1"), (READER, path, "2"), (SLEEPER, path), (LOOKER, f"{web.url}picture")):
            viewer = Part("viewer", [*NICE, sys.executable, "-c", *how])
            running.callback(viewer.end, kill=True)
        yield


@pytest.mark.alone
def test_the_alarm_is_not_later_with_two_viewers_a_sleeper_and_the_page(cart: Cart, tmp_path: Path) -> None:
    """Same run, with and without, in turns."""
    without: list[float] = []
    beside: list[float] = []
    with WebPage(tmp_path, cart.socket) as web:
        cart.wait_for("monitoring", 60)
        for _ in range(3):
            without += [opened_after_s(cart) for _ in range(ALARMS // 3)]
            with onlookers(cart, web):
                until(lambda: cart.status()["feed"]["clients"] >= 4, 30)
                beside += [opened_after_s(cart) for _ in range(ALARMS // 3)]
            until(lambda: cart.status()["feed"]["clients"] == 0, 30)
    most = {share: [float(np.quantile(one, share)) for one in (without, beside)] for share in (0.5, 0.9, 1.0)}
    told = "; ".join(f"{share:.0%}: {a * 1e3:.0f} and {b * 1e3:.0f} ms" for share, (a, b) in most.items())
    print(f"\nthe contact opened after, without and with: {told}; {len(without)} alarms each")
    for share in (0.5, 0.9):
        assert most[share][1] <= most[share][0] + _MORE_S, told


def test_a_feed_that_is_killed_or_hangs_is_felt_by_those_who_listen_alone(cart: Cart) -> None:
    cart.wait_for("monitoring", 60)
    until(cart.contact)
    path = cart.socket.with_name("feed")
    began_s = time.monotonic()
    for how in (signal.SIGSTOP, signal.SIGKILL):
        with Feed(path) as feed:
            assert feed.next(10) is not None
            os.kill(feed_pid(cart), how)
            time.sleep(2)
            if how is signal.SIGSTOP:
                os.kill(feed_pid(cart), signal.SIGKILL)
    states = [event for event in cart.daemon.said if event["heard_s"] > began_s and event["event"] == "state"]
    assert cart.switched(began_s) == [], states
    assert cart.status()["state"] == "monitoring"
    until(lambda: reached(path), 30)


def feed_pid(cart: Cart) -> int:
    pid = cart.daemon.process.pid
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return next(int(one) for one in children if "feed.process" in Path(f"/proc/{one}/cmdline").read_text())


def reached(path: Path) -> bool:
    try:
        Feed(path).close()
    except DeviceLost:
        return False
    return True


@pytest.mark.alone
def test_the_self_test_of_a_moving_cart_is_kept_and_names_what_is_not_green(cart: Cart) -> None:
    """The simulated hand never rests, and nobody sees the lamps: everything else is green, or says why."""
    cart.wait_for("monitoring", 60)
    shown = answered("self-test", "--config", cart.config, "--yes", "--lamps", "skip", "--operator", "A. Smith")
    assert shown.returncode == 1
    for name in ("video rate", "tracker rate", "overlay mask", "alarm log", "clock"):
        assert f"✓\t{name}\t" in shown.stdout, shown.stdout
    assert "?\tnoise at rest\t" in shown.stdout, shown.stdout
    assert "✓\tlamps and tone\t" in shown.stdout, "the simulated cart has none"
    (kept,) = (cart.folder / "alarms" / "self-tests").glob("*.json")
    assert '"operator": "A. Smith"' in kept.read_text()
