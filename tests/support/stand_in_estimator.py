"""An estimator process whose line obeys the first pixel of each frame, to test what surrounds the real line."""

import sys
import time

from probewatch.appliance.limits import Limits
from probewatch.appliance.service.estimator.loop import serve
from probewatch.appliance.types import Calibration, Check, Fault, Verdict, VerdictKind
from probewatch.drivers.samples import Frame, Matrix4, Sample

OK, FAULT, CRASH, HANG, SILENT, LIMITS = range(1, 7)


class ObedientLine:
    """Says of each frame what its first pixel orders; its check names the lateral scale of the reference, and stale_ns
    as its limit. Asked for its limits, it gives them as its reason."""

    relative_pose: Matrix4 | None = None

    def __init__(
        self, reference: Calibration, limits: Limits, stale_ns: int, relative_pose: Matrix4 | None = None
    ) -> None:
        self._scale, self._limits, self._stale_ns = float(reference.scale_mm_per_px[0]), limits, stale_ns

    def step(self, sample: Sample) -> tuple[Verdict, ...]:
        if not isinstance(sample, Frame):
            return ()
        order = int(sample.image[0, 0])
        if order == CRASH:
            raise RuntimeError("ordered to crash")
        if order == HANG:
            time.sleep(60)
        if order == LIMITS:
            limits = self._limits.model_dump_json(by_alias=True)
            return (Verdict(sample.stamp.t_ns, VerdictKind.NOT_VERIFIED, (), reason=limits),)
        if order not in {OK, FAULT}:
            return ()
        check = Check("scale-lateral", Fault.SCALE, self._scale, 0.0, "mm/px", self._stale_ns, VerdictKind.OK)
        if order == OK:
            return (Verdict(sample.stamp.t_ns, VerdictKind.OK, (check,), verified_ns=sample.stamp.t_ns),)
        return (Verdict(sample.stamp.t_ns, VerdictKind.FAULT, (check,), Fault.POLARITY, "ordered"),)


if __name__ == "__main__":
    serve(sys.argv[1:], ObedientLine)
