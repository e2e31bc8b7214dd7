"""The service with a line that says OK of every picture a pose came with, so that recovery needs no motion.

`-m tests.support.stand_in_daemon CONFIG RATE ORIGIN_NS` is the service on that clock,
`-m tests.support.stand_in_daemon LINK FRAMES POSES` its estimator. While the file that
PROBEWATCH_STAND_IN_FAULT names exists, the line says FAULT of the class written in it.
"""

import os
import sys
from collections.abc import Callable
from pathlib import Path

from probewatch.appliance.configuration.config import load_config
from probewatch.appliance.limits import Limits
from probewatch.appliance.service.control.references import References
from probewatch.appliance.service.estimator.loop import serve as serve_estimator
from probewatch.appliance.service.estimator.process_host import EstimatorHost
from probewatch.appliance.types import Calibration, Fault, Verdict, VerdictKind
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.samples import Frame, Matrix4, PoseStatus, Sample
from probewatch.tools.commands.run import serve

_COMMAND = (sys.executable, "-m", "tests.support.stand_in_daemon")
_NEAR_NS = 200_000_000


def _written() -> str:
    file = Path(os.environ.get("PROBEWATCH_STAND_IN_FAULT", "/nowhere"))
    return file.read_text() if file.exists() else ""


class TrustingLine:
    """OK of a frame that an OK pose came with, as far as the stamps tell. wanted: class of the fault that it is to say
    instead, empty for none.
    """

    def __init__(
        self,
        reference: Calibration,
        limits: Limits,
        stale_ns: int,
        relative_pose: Matrix4 | None = None,
        wanted: Callable[[], str] = _written,
    ) -> None:
        self.relative_pose = relative_pose
        self._pose_ns = 0
        self._verified_ns: int | None = None
        self._wanted = wanted

    def step(self, sample: Sample) -> tuple[Verdict, ...]:
        if isinstance(sample, Frame):
            if fault := self._wanted():
                return (Verdict(sample.stamp.t_ns, VerdictKind.FAULT, (), Fault(fault), "as the test wishes"),)
            t_ns = sample.stamp.t_ns
            near = abs(t_ns - self._pose_ns) < _NEAR_NS
            self._verified_ns = t_ns if near else self._verified_ns
            kind = VerdictKind.OK if near else VerdictKind.NOT_VERIFIED
            return (Verdict(t_ns, kind, (), verified_ns=self._verified_ns),)
        if sample.status is PoseStatus.OK:
            self._pose_ns = sample.stamp.t_ns
        return ()


def main() -> None:
    if len(sys.argv) > 4:
        return serve_estimator(sys.argv[1:], TrustingLine)
    file, rate, origin_ns = Path(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3])
    config, slowness = load_config(file), max(1.0, 1 / rate)
    estimator = EstimatorHost(None, config.limits, config.supervisor.timeouts().stale_ns, _COMMAND, slowness)
    return serve(config, file, References(config), estimator, HostClock(rate, origin_ns))


if __name__ == "__main__":
    main()
