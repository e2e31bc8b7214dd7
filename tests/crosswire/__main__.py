"""Tables of what the cross-wire tool keeps of its promises.

Arguments: number of views and of scans without pictures; or `pictures`, number of rendered scans, file to keep them in.
"""

import argparse
from pathlib import Path

from tests.crosswire.rendered_scans import measured, told
from tests.crosswire.scans import scan_score, scanned
from tests.crosswire.views import HELD_OUT, Score, drawn_view, other_view, score, world_view


def main(views: int, scans: int) -> None:
    """Half of the views of each of two renderers, on seeds that set the thresholds and on others; then of a third."""
    half = range(views // 2)
    for name, first in (("seeds that set the thresholds", 0), ("held-out seeds", HELD_OUT)):
        everything = []
        for renderer, view in (("simulated world", world_view), ("drawn otherwise", drawn_view)):
            seen = [view(first + seed) for seed in half]
            everything += seen
            print(f"{name}, {renderer}: {_told(score(seen))}", flush=True)
        print(f"{name}, both: {_told(score(everything))}", flush=True)
    print(
        f"renderer by which nothing was set: {_told(score([other_view(HELD_OUT + seed) for seed in half]))}", flush=True
    )
    found = scan_score([scanned(seed) for seed in range(scans)])
    print(
        f"{found.scans} scans of 120 passages, {found.accepted:.1%} accepted: ζ within 2.5 sigma {found.zeta:.1%} from "
        f"nothing, {found.closed:.1%} in closed form; eight parameters within 1 sigma {found.covered:.1%} "
        f"({', '.join(f'{share:.0%}' for share in found.each)}); ten points elsewhere {found.points_mm:.3f} mm RMS, of "
        f"which the calibration {found.calibration_mm:.3f}"
    )


def _told(one: Score) -> str:
    return (
        f"{one.views} views, found {one.found:.1%}, error {one.error_mm:.3f} mm RMS (lateral {one.axis_mm[0]:.3f}, "
        f"axial {one.axis_mm[1]:.3f}), wrong {one.false:.2%}, within one stated sigma {one.covered:.0%}"
    )


if __name__ == "__main__":
    usage = "python -m tests.crosswire VIEWS SCANS | pictures SCANS FILE"
    parser = argparse.ArgumentParser(usage=usage, description=__doc__)
    parser.add_argument("given", nargs="+", help=argparse.SUPPRESS)
    given = parser.parse_args().given
    if len(given) == 3 and given[0] == "pictures" and given[1].isdecimal():
        print(told(measured(int(given[1]), Path(given[2]))))
    elif len(given) == 2 and all(number.isdecimal() for number in given):
        main(*map(int, given))
    else:
        parser.error("give two numbers, or `pictures`, a number and a file")
