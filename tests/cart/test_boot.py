"""From power on to an active service and its first verdict: how long, and the service's own share of it."""

import time
from dataclasses import dataclass

from tests.cart.bench import UNIT, Machine, configure, gpio, journal, show, wait_status
from tests.cart.cart_in_container import URLS, start_twins
from tests.cart.container import Container
from tests.cart.guest import Guest
from tests.support.polling import until

OWN_S, VERDICT_S = 15.0, 60.0
"""Of the start itself at full speed, and until the line has a verdict; a quiet host takes about a third."""
EMULATED_S = 240.0
RTC = "2001-01-01T00:00:00"
FIRST_WORDS = ("waiting", "device lost", "not verified")


@dataclass(frozen=True)
class Start:
    """Seconds since the machine's boot: the unit begins, is active; the service's first state."""

    began_s: float
    active_s: float
    first_state_s: float

    @property
    def own_s(self) -> float:
        return self.active_s - self.began_s

    def __str__(self) -> str:
        own = f"active {self.active_s:.1f} s after the boot, {self.own_s:.1f} s of them its own"
        return f"{own}; its first state is out at {self.first_state_s:.1f} s"


def unit_times(machine: Machine) -> tuple[float, float]:
    """CLOCK_MONOTONIC of the beginning of the unit's last start and of its being active, s."""
    began, active = (int(show(machine, f"{name}TimestampMonotonic")) / 1e6 for name in ("InactiveExit", "ActiveEnter"))
    return began, active


def start_of(machine: Machine) -> Start:
    began_s, active_s = unit_times(machine)
    first = next(one for one in journal(machine) if one.get("PROBEWATCH_EVENT") == "state")
    return Start(began_s, active_s, int(first["__MONOTONIC_TIMESTAMP"]) / 1e6)


def test_at_full_speed_it_is_active_within_seconds_and_has_a_verdict_soon(container: Container) -> None:
    """A container shares the host's monotonic clock, so the unit's times can be counted from its power on."""
    wait_status(container, "not verified", OWN_S)
    on_s = container.began_s
    began_s, active_s = (one - on_s for one in unit_times(container))
    print(f"nspawn: active {active_s:.1f} s after power on, {active_s - began_s:.1f} s of them its own")
    start_twins(container)
    configure(container, URLS["video"], URLS["tracker"], URLS["outputs"])
    container.sh(f"systemctl restart {UNIT}")
    began_s, active_s = unit_times(container)
    wait_status(container, "monitoring", VERDICT_S)
    states = [entry for entry in journal(container) if entry.get("PROBEWATCH_EVENT") == "state"]
    after_s = {one["PROBEWATCH_STATE"]: int(one["__MONOTONIC_TIMESTAMP"]) / 1e6 - began_s for one in reversed(states)}
    told = ", ".join(f"{state} {seconds:.1f} s" for state, seconds in reversed(after_s.items()))
    print(f"configured: its own start {active_s - began_s:.1f} s; from its beginning: {told}")
    assert active_s - began_s < OWN_S
    assert after_s["not verified"] < VERDICT_S


def test_cold_boot_with_a_clock_years_off_that_leaps_afterwards(guest: Guest) -> None:
    """An empty battery of the clock, then the network's time: the alarm is on all the while, and the log says it."""
    guest.restore()
    configure(guest, "sim:/run/no-scanner", "ndi:/dev/ttyUSB0", ["gpio:/dev/gpiochip0?line=relay"])
    guest.sh("sync")
    boot_s = guest.switch_on("-rtc", f"base={RTC}")
    wait_status(guest, FIRST_WORDS, EMULATED_S)
    print(f"emulated: the agent answers {boot_s:.0f} s after power on; {start_of(guest)}")
    off_s = time.time() - float(guest.sh("date +%s").out)
    assert off_s > 30 * 86400, "the machine began in the past"
    before = show(guest, "MainPID")
    guest.sh(f"date -s @{int(time.time())} >/dev/null")
    (said,) = _await_said(guest)
    print(f"leap of {off_s / 86400:.0f} days: '{said['MESSAGE']}'")
    assert abs(float(said["PROBEWATCH_BY_S"]) - off_s) < 60
    wait_status(guest, FIRST_WORDS, EMULATED_S)
    assert show(guest, "MainPID") == before
    assert show(guest, "NRestarts") == "0"
    assert gpio(guest) == 0


def _await_said(guest: Guest) -> list[dict[str, str]]:
    return until(lambda: journal(guest, UNIT, "PROBEWATCH_EVENT='wall clock stepped'"), 30, guest.look_s)
