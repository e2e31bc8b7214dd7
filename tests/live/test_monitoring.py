"""A real Prometheus, the rules as they are shipped, and five simulated carts of which one is well."""

import json
import os
import shutil
import signal
import socket
import subprocess
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import yaml

from probewatch.tools.simulators.whole_cart import Part
from tests.support.demo_cart import PROBEWATCH, Cart
from tests.support.polling import until

MONITORING = Path(__file__).parents[2] / "config" / "monitoring"
SLOW = 0.2
"""Seconds of a cart per second, so that five of them find room on two processors."""
KINDLY = ["/usr/bin/nice", "-n", "10"]
"""Who looks on goes last: `Part` starts a process with the priority of the devices."""
NAMES = ("well", "halted", "trackerless", "hung", "gone")


def free_port() -> int:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port: int = taken.getsockname()[1]
        return port


class Fleet:
    """Carts, an exporter beside each, and the Prometheus that scrapes them."""

    def __init__(self, folder: Path, running: ExitStack) -> None:
        self.folder, self.running = folder, running
        self.carts: dict[str, Cart] = {}
        self.exporters: dict[str, Part] = {}
        self.ports = {name: free_port() for name in NAMES}
        self.url = f"http://127.0.0.1:{free_port()}"
        for number, name in enumerate(NAMES):
            (folder / name).mkdir()
            cart = Cart(folder / name, seed=number, trusting=True, rate=SLOW)
            self.carts[name] = running.enter_context(cart)
            self.start_exporter(name)
        for cart in self.carts.values():
            cart.wait_for("monitoring", 120)

    def start_exporter(self, name: str) -> None:
        command = [*KINDLY, str(PROBEWATCH), "metrics", "--socket", str(self.carts[name].socket)]
        part = Part(f"exporter of {name}", [*command, "--listen", f"127.0.0.1:{self.ports[name]}"])
        self.exporters[name] = part
        self.running.callback(part.end)

    def start_prometheus(self) -> None:
        """The files as they are shipped, but for addresses and timeouts."""
        config = yaml.safe_load((MONITORING / "prometheus.yml").read_text())
        config["global"] = {"scrape_interval": "3s", "scrape_timeout": "3s", "evaluation_interval": "1s"}
        targets = [f"127.0.0.1:{port}" for port in self.ports.values()]
        config["scrape_configs"][0]["static_configs"] = [{"targets": targets}]
        rules = yaml.safe_load((MONITORING / "probewatch.rules.yml").read_text())
        for rule in (rule for group in rules["groups"] for rule in group["rules"]):
            if "for" in rule:
                rule["for"] = "1s"
        (self.folder / "prometheus.yml").write_text(yaml.safe_dump(config))
        (self.folder / "probewatch.rules.yml").write_text(yaml.safe_dump(rules))
        command = [*KINDLY, str(shutil.which("prometheus")), f"--config.file={self.folder}/prometheus.yml"]
        command += [
            f"--storage.tsdb.path={self.folder}/data",
            f"--web.listen-address={self.url.removeprefix('http://')}",
        ]
        self.prometheus = Part("prometheus", command)
        self.running.callback(self.prometheus.end)

    def alerts(self) -> dict[str, set[str]]:
        """Cart → names of what fires; empty while Prometheus does not answer."""
        try:
            with urllib.request.urlopen(f"{self.url}/api/v1/alerts", timeout=5) as reply:
                listed = json.load(reply)["data"]["alerts"]
        except OSError:
            return {}
        by_port = {str(port): name for name, port in self.ports.items()}
        fires: dict[str, set[str]] = {}
        for alert in listed:
            if alert["state"] == "firing" and "instance" in alert["labels"]:
                name = by_port[alert["labels"]["instance"].rpartition(":")[2]]
                fires.setdefault(name, set()).add(alert["labels"]["alertname"])
        return fires

    def asked(self, *options: str) -> "subprocess.CompletedProcess[str]":
        command = [str(PROBEWATCH), "fleet", "--prometheus", self.url, *options]
        return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    if shutil.which("prometheus") is None:
        pytest.skip("needs prometheus (prometheus)")
    with ExitStack() as running:
        fleet = Fleet(tmp_path_factory.mktemp("fleet"), running)
        fleet.carts["halted"].say("scale")
        fleet.carts["trackerless"].kill_twin("polaris")
        hung = fleet.carts["hung"].daemon
        assert hung is not None
        os.kill(hung.process.pid, signal.SIGSTOP)
        running.callback(os.kill, hung.process.pid, signal.SIGCONT)
        fleet.exporters["gone"].end(kill=True)
        fleet.start_prometheus()
        yield fleet


WAITED_FOR = {
    "halted": "ProbewatchHalt",
    "trackerless": "ProbewatchDeviceLost",
    "hung": "ProbewatchServiceSilent",
    "gone": "ProbewatchCartUnreachable",
}


def test_the_rules_fire_for_each_cart_that_is_not_well_and_for_no_other(fleet: Fleet) -> None:
    fired = until(
        lambda: (
            (now := fleet.alerts()) and all(alert in now.get(name, ()) for name, alert in WAITED_FOR.items()) and now
        ),
        90,
        0.5,
        fleet.alerts,
    )
    assert isinstance(fired, dict)
    troubles = set(WAITED_FOR.values())
    for name in NAMES:
        assert fired.get(name, set()) & troubles == ({WAITED_FOR[name]} if name in WAITED_FOR else set())
    until(lambda: "ProbewatchSimulated" in fleet.alerts().get("well", ()), 30, 0.5)


def test_one_table_names_who_needs_what(fleet: Fleet) -> None:
    by_port = {str(port): name for name, port in fleet.ports.items()}

    def look() -> dict[str, Any]:
        told = fleet.asked("--json")
        assert told.returncode in (0, 1, 69), told.stderr
        carts = json.loads(told.stdout) if told.returncode != 69 else []
        return {by_port[cart["instance"].rpartition(":")[2]]: cart for cart in carts}

    wanted = {
        "well": [],
        "halted": ["unverified"],
        "trackerless": ["unverified"],
        "hung": ["service silent"],
        "gone": ["unreachable"],
    }
    until(lambda: {name: cart["needs"] for name, cart in look().items()} == wanted, 60, 0.5, look)
    carts = look()
    assert (carts["well"]["state"], carts["well"]["closed"], carts["well"]["reference"]) == ("monitoring", True, "1")
    assert carts["hung"]["state"] is None, "nothing old is told of it"
    assert carts["halted"]["state"] in ("halt", "recalibration requested")
    table = fleet.asked()
    assert table.returncode == 1
    assert "unreachable" in table.stdout
    assert "service silent" in table.stdout


def test_what_was_away_comes_back_by_itself(fleet: Fleet) -> None:
    hung = fleet.carts["hung"].daemon
    assert hung is not None
    os.kill(hung.process.pid, signal.SIGCONT)
    fleet.start_exporter("gone")
    until(lambda: not {"ProbewatchServiceSilent"} & (now := fleet.alerts()).get("hung", set()) and now, 60, 0.5)
    until(lambda: "ProbewatchCartUnreachable" not in fleet.alerts().get("gone", set()), 60, 0.5)


def test_a_prometheus_that_vanishes_is_named_and_comes_back(fleet: Fleet) -> None:
    fleet.prometheus.end(kill=True)
    refused = fleet.asked()
    assert (refused.returncode, refused.stderr.count("\n")) == (69, 1)
    assert "no Prometheus answers" in refused.stderr
    fleet.start_prometheus()
    until(lambda: "ProbewatchHalt" in fleet.alerts().get("halted", set()), 60, 0.5, fleet.alerts)
