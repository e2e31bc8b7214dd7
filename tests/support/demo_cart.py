"""The simulated cart of the demo, with what tests need: waiting for states, and a service that trusts every picture."""

import os
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path

from probewatch.tools.simulators.whole_cart import CartSettings, Event, Part, SimulatedCart
from tests.support.polling import until

_LATE_S = 5.0
"""How late this process may look: beside the carts of other tests, which go first, it waits for the processor."""
_TRUSTED_FPS = 10.0
"""A line that trusts every picture sees no more in more of them, and rendering 30 is half of one slow processor."""
PROBEWATCH = Path(sys.executable).parent / "probewatch"


class Cart(SimulatedCart):
    """Twins and service under folder; leave the context to end everything. trusting: see
    tests.support.stand_in_daemon. rate: seconds of the cart per second. fps: pictures per second; None for those of
    the demo, or of a trusting line.
    """

    def __init__(
        self,
        folder: Path,
        seed: int = 3,
        trusting: bool = False,
        served: bool = False,
        rate: float = 1.0,
        fps: float | None = None,
    ) -> None:
        if fps is None:
            fps = _TRUSTED_FPS if trusting else CartSettings().fps
        super().__init__(folder, CartSettings(seed, rate, served, fps))
        self._trusting = trusting
        self.fault = folder / "fault"

    def start_twin(self, name: str) -> None:
        self.launch_twin(name)
        self.await_twin(name)

    def start_daemon(self) -> None:
        if self._trusting:
            os.environ["PROBEWATCH_STAND_IN_FAULT"] = str(self.fault)
            clock = [str(self.settings.rate), str(self.clock.origin_ns)]
            self.daemon = Part(
                "service", [sys.executable, "-m", "tests.support.stand_in_daemon", str(self.config), *clock]
            )
        else:
            super().start_daemon()

    def say(self, fault: str | None) -> None:
        """What the trusting line is to say from now on; None is OK again."""
        if fault is None:
            self.fault.unlink(missing_ok=True)
        else:
            replacement = self.fault.with_suffix(".new")
            replacement.write_text(fault)
            replacement.replace(self.fault)

    def fill_disk(self) -> Callable[[], None]:
        """A file size limit of zero: every write of the service to a file fails, as on a full disk; its undo."""
        assert self.daemon is not None
        pid = self.daemon.process.pid
        before = resource.prlimit(pid, resource.RLIMIT_FSIZE)
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (0, before[1]))

        def make_room() -> None:
            resource.prlimit(pid, resource.RLIMIT_FSIZE, before)

        return make_room

    def estimator_pid(self) -> int:
        """Of that child of the service which is not the feed's."""
        pid = self.daemon.process.pid
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        return next(int(one) for one in children if "feed.process" not in Path(f"/proc/{one}/cmdline").read_text())

    def wait_for(self, state: str, deadline_s: float = 20.0) -> Event:
        """The status in that state; AssertionError unless, by the service's clock, it was entered within deadline_s."""
        began_s = time.monotonic()

        def look() -> tuple[float, Event]:
            asked_s, status = time.monotonic(), self.status()
            return (asked_s, status) if status.get("state") == state else (asked_s, {})

        asked_s, status = until(lambda: (found := look())[1] and found, deadline_s + _LATE_S, otherwise=self.status)
        after_s = asked_s - status["since_s"] - began_s
        assert after_s <= deadline_s, f"'{state}' after {after_s:.2f} s"
        return status

    def contact(self, since_s: float = 0.0) -> bool | None:
        """What the relay board did last since then, by its own clock."""
        switched = self.switched(since_s)
        return switched[-1][1] if switched else None

    def open_contact(self, since_s: float, within_s: float) -> None:
        """AssertionError unless the relay board, by its own clock, opened within that time."""
        until(lambda: self.contact(since_s) is False, within_s + _LATE_S)
        after_s = next(t_s for t_s, energised in self.switched(since_s) if not energised) - since_s
        assert after_s <= within_s, f"the contact opened after {after_s:.2f} s"

    def switched(self, since_s: float = 0.0) -> list[tuple[float, bool]]:
        """(s, whether the contact closed) of every change since then, by the relay board's own clock."""
        events = [event for event in tuple(self.twins["relay_board"].said) if "energised" in event]
        times = [(event["t_ns"] / 1e9, bool(event["energised"])) for event in events]
        return [(t_s, energised) for t_s, energised in times if t_s >= since_s]
