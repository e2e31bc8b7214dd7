"""A whole simulated cart inside the container: twins as units of their own, the service as it was installed."""

import json
import time

from tests.cart.bench import SEED, UNIT, configure, show, wait_status
from tests.cart.container import Container
from tests.support.polling import until

PLACE = "/run/cart"
TWINS = {
    "scanner": f"probewatch simulate scanner --socket {PLACE}/scanner",
    "polaris": f"probewatch simulate ndi --model polaris-spectra --pty {PLACE}/polaris --rom {PLACE}/probe.rom",
    "relay_board": f"probewatch simulate relay --pty {PLACE}/relay_board",
}
"""The command that starts each."""
PROPERTIES = "-p UMask=0 -p Environment=OMP_NUM_THREADS=1 -p Nice=-5 -p CPUWeight=1000"
"""Devices do not wait for a host that is busy with something else."""
URLS = {
    "video": f"sim:{PLACE}/scanner",
    "tracker": f"ndi:{PLACE}/polaris?probe={PLACE}/probe.rom",
    "outputs": [f"relay:{PLACE}/relay_board"],
}


FPS = 12.0
"""Of the scanner, so that a busy host keeps up as well; the soak runs at 30."""


def start_twins(machine: Container, fps: float = FPS) -> None:
    """They share one origin, so they stay in one world however often one of them is started again."""
    origin_ns = time.monotonic_ns()
    machine.sh(f"mkdir -p -m 755 {PLACE}")
    for name, command in TWINS.items():
        rate = f"--fps {fps}" if name == "scanner" else ""
        world = "" if name == "relay_board" else f"--seed {SEED}"
        machine.sh(
            f"systemd-run --quiet --unit=twin-{name} {PROPERTIES} {command} {rate} {world} --origin-ns {origin_ns}"
        )
    for name in TWINS:
        _await_twin(machine, name)
    machine.sh(f"chmod 666 $(readlink -f {PLACE}/polaris) $(readlink -f {PLACE}/relay_board)")


def _await_twin(machine: Container, name: str) -> None:
    until(
        lambda: any(event.get("ready") for event in said(machine, name)),
        60,
        machine.look_s,
        lambda: f"the {name} twin does not start",
    )


def said(machine: Container, name: str) -> list[dict[str, object]]:
    """What a twin printed, in order."""
    lines = machine.sh(f"journalctl -u twin-{name} -o cat --no-pager").out.splitlines()
    return [json.loads(line) for line in lines if line.startswith("{")]


def contact(machine: Container) -> tuple[bool, float]:
    """(the relay board's contact is closed, CLOCK_MONOTONIC of its last change, s); open before the first."""
    events = [event for event in said(machine, "relay_board") if "energised" in event]
    return (bool(events[-1]["energised"]), int(str(events[-1]["t_ns"])) / 1e9) if events else (False, 0.0)


def start_service(machine: Container, more: str = "") -> None:
    """Configured for the twins; returns when the first verification has closed the contact."""
    configure(machine, URLS["video"], URLS["tracker"], URLS["outputs"], more)
    machine.sh("systemctl restart probewatch")
    wait_status(machine, "monitoring", 90)
    await_contact(machine, True, 5)


def await_contact(machine: Container, closed: bool, deadline_s: float) -> float:
    """CLOCK_MONOTONIC at which the board changed to that state, s."""

    def changed() -> tuple[bool, float] | None:
        state = contact(machine)
        return state if state[0] is closed else None

    stays = f"the contact stays {'open' if closed else 'closed'}"
    return until(changed, deadline_s, machine.look_s, lambda: stays)[1]


def come_first(machine: Container) -> None:
    """Service and devices get the share that their units ask for: where the host's systemd does not manage processor
    time it goes by session, which makes Nice= and CPUWeight= void.
    """
    units = " ".join((UNIT, *(f"twin-{name}" for name in TWINS)))
    machine.sh(
        f"for u in {units}; do p=$(systemctl show -P MainPID $u); "
        "[ ! -e /proc/$p/autogroup ] || echo -10 >/proc/$p/autogroup; done"
    )


def main_pid(machine: Container) -> int:
    """As seen inside."""
    return int(show(machine, "MainPID"))
