"""`python -m tests.bench.contact_delay [N]`: from the verdict to the byte on the relay's line, both cores busy.

Two processes spin beside the simulated cart; the service has the priority that its unit gives it, where this user may
set it. Each sample is what the service itself logs: the time from the word FAULT to the last byte of the command.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.progress import track

from tests.support.demo_cart import Cart

_NICE = -10
_SPIN = [sys.executable, "-c", "while True: pass"]


def delays_ms(cart: Cart, samples: int) -> list[float]:
    """One for each fault that opened the contact."""
    assert cart.daemon is not None
    for _ in track(range(samples), description="faults"):
        cart.say("scale")
        cart.wait_for("warning", 30)
        cart.say(None)
        cart.wait_for("monitoring", 30)
    said = [event for event in cart.daemon.said if event.get("event") == "contact" and not event["energised"]]
    return [event["delay_ms"] for event in said[-samples:]]


def restart_for_measuring(cart: Cart) -> None:
    """Short times between samples, writes that wait for no answer of the simulated board, the unit's priority."""
    assert cart.daemon is not None
    text = cart.config.read_text().replace("relay_board?channel=1", "relay_board?channel=1&confirm=no")
    cart.config.write_text(text + "supervisor.probation_s = 0.1\nsupervisor.halt_after_s = 5\n")
    cart.daemon.end()
    cart.start_daemon()
    cart.wait_for("monitoring", 60)
    for process in (cart.daemon.process.pid, cart.estimator_pid()):
        for thread in Path(f"/proc/{process}/task").iterdir():
            os.setpriority(os.PRIO_PROCESS, int(thread.name), _NICE)
    time.sleep(2)


def main() -> None:
    samples = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    spinning = [subprocess.Popen(_SPIN) for _ in range(os.cpu_count() or 1)]
    try:
        with tempfile.TemporaryDirectory() as folder, Cart(Path(folder), trusting=True) as cart:
            cart.wait_for("monitoring", 60)
            restart_for_measuring(cart)
            figures = np.array(delays_ms(cart, samples))
            tick = cart.status()["tick"]
    finally:
        for process in spinning:
            process.kill()
            process.wait()
    quantiles = {f"p{q}_ms": round(float(np.percentile(figures, q)), 2) for q in (50, 90, 99)}
    print(json.dumps({"samples": len(figures), **quantiles, "max_ms": float(figures.max()), "tick": tick}, indent=2))


if __name__ == "__main__":
    main()
