"""The units that only look on, under a real systemd: a user of its own who may read the status and nothing else."""

from tests.cart.bench import show
from tests.cart.cart_in_container import contact, start_service, start_twins
from tests.cart.container import Container
from tests.support.polling import until

AS = "setpriv --reuid probewatch-monitor --regid probewatch-monitor --groups probewatch"
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
