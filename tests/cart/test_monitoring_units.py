"""The units that only look on, under a real systemd: users of their own who may do what they need and nothing else."""

import json
from pathlib import Path

from tests.cart.bench import configure, show
from tests.cart.cart_in_container import URLS, contact, start_service, start_twins
from tests.cart.container import Container
from tests.support import rights
from tests.support.polling import until
from tests.systemd.test_rights import MAY

AS = "setpriv --reuid probewatch-monitor --regid probewatch-monitor --clear-groups"
ASKED = """import urllib.request as u; print(u.urlopen('http://127.0.0.1:9797/metrics', timeout=5).read().decode())"""


def metrics(machine: Container) -> list[str]:
    return machine.sh(f'python3 -c "{ASKED}"', check=False).out.splitlines()


def test_the_exporter_is_off_until_a_person_starts_it_and_then_tells_the_truth(container: Container) -> None:
    start_twins(container)
    start_service(container)
    for unit in ("probewatch-metrics", "probewatch-mqtt"):
        assert container.sh(f"systemctl is-active {unit}", check=False).out.strip() == "inactive"
    container.sh("systemctl enable --now probewatch-metrics")
    until(lambda: "probewatch_contact_closed 1.0" in metrics(container), 60, 0.5, lambda: metrics(container))
    user = container.sh("ps -o user:32= -p $(systemctl show -P MainPID probewatch-metrics)").out.strip()
    assert user == "probewatch-monitor"
    refused = container.sh(f"{AS} probewatch calibration back 1 --yes", check=False)
    assert "may ask for the status and nothing else" in refused.out, refused.out
    container.sh("systemctl kill --signal=KILL probewatch-metrics")
    assert contact(container)[0]
    until(lambda: "probewatch_up 1.0" in metrics(container), 60, 0.5)
    container.sh("systemctl stop probewatch")
    until(lambda: "probewatch_up 0.0" in metrics(container), 30, 0.5)
    assert not any(line.startswith("probewatch_contact_closed") for line in metrics(container))
    assert show(container, "ActiveState") == "inactive"


TRIED = "/usr/local/lib/rights.py"
INSTEAD = f"[Service]\nType=oneshot\nRestart=no\nExecStart=\nExecStart=/opt/probewatch/bin/python3 {TRIED}\n"


def test_each_unit_that_looks_on_may_do_what_it_needs_in_its_sandbox_and_nothing_else(container: Container) -> None:
    """Each is started with a program that tries everything instead of its own."""
    start_twins(container)
    configure(container, URLS["video"], URLS["tracker"], URLS["outputs"])
    container.sh(
        "systemctl restart probewatch && systemctl start probewatch-page probewatch-recorder probewatch-report"
    )
    until(lambda: container.sh(f"test -S /{rights.DOOR} -a -S /{rights.FEED}", check=False).code == 0, 60, 0.5)
    for place in rights.PLACES:
        container.sh(f"cd -P {place}/ && echo > {rights.CONTENT} && chown --reference=. {rights.CONTENT}")
        container.sh(f"chmod {'644' if place.startswith('/etc') else '640'} {place}/{rights.CONTENT}")
    container.put(TRIED, Path(rights.__file__).read_text())
    container.sh("touch /etc/default/probewatch-mqtt; systemctl stop probewatch-recorder")
    for unit in sorted(MAY.keys() - {"probewatch", "probewatch-page"}):
        assert tried(container, unit) == MAY[unit], unit


def tried(machine: Container, unit: str) -> set[str]:
    """What a process in the unit's place can do."""
    machine.sh(f"mkdir -p /run/systemd/system/{unit}.service.d")
    machine.put(f"/run/systemd/system/{unit}.service.d/tried.conf", INSTEAD)
    machine.sh(f"systemctl daemon-reload && systemctl start {unit}")
    said = machine.sh(f"journalctl -u {unit} -o cat --no-pager").out.splitlines()
    return set(json.loads(next(line for line in reversed(said) if line.startswith("["))))
