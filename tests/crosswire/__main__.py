"""Tables of what the cross-wire tool keeps of its promises. Arguments: number of views, number of scans."""

import sys

from tests.crosswire.scans import scan_score, scanned
from tests.crosswire.views import drawn_view, score, world_view


def main(views: int, scans: int) -> None:
    everything = []
    for name, view in (("simulated world", world_view), ("drawn otherwise", drawn_view)):
        seen = [view(seed) for seed in range(views // 2)]
        everything += seen
        print(f"{name}: {_told(score(seen))}", flush=True)
    print(f"both: {_told(score(everything))}", flush=True)
    found = scan_score([scanned(seed) for seed in range(scans)])
    print(
        f"{found.scans} scans of 120 passages, {found.accepted:.1%} accepted: ζ within 2.5 sigma {found.zeta:.1%} from "
        f"nothing, {found.closed:.1%} in closed form; eight parameters within 1 sigma {found.covered:.1%} "
        f"({', '.join(f'{share:.0%}' for share in found.each)}); ten points elsewhere {found.points_mm:.3f} mm RMS, of "
        f"which the calibration {found.calibration_mm:.3f}"
    )


def _told(one) -> str:
    return (
        f"{one.views} views, found {one.found:.1%}, error {one.error_mm:.3f} mm RMS (lateral {one.axis_mm[0]:.3f}, "
        f"axial {one.axis_mm[1]:.3f}), wrong {one.false:.2%}, within one stated sigma {one.covered:.0%}"
    )


main(*map(int, sys.argv[1:3]))
