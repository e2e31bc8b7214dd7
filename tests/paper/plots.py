"""Figure 4 as a picture."""

from pathlib import Path

import matplotlib as mpl
from matplotlib import pyplot as plt

from tests.paper.figure4 import CHAIN, FRAMES, STEPS, Curves
from tests.paper.sweeps import FPS, SCALE

mpl.use("Agg")


def figure_4(curves: Curves, target: Path) -> None:
    """Two columns: the paper's norm constraint, and the linear form; rows λ_x, λ_y; the keyframe chain in both."""
    figure, panels = plt.subplots(2, 2, figsize=(11, 7), sharex=True, layout="constrained")
    for column, method in enumerate(("norm", "linear")):
        for axis, name in enumerate(("λx", "λy")):
            panel = panels[axis, column]
            for d in STEPS:
                panel.plot(FRAMES, curves[f"{method} d={d}"][:, axis], lw=1, label=f"d = {d}")
            panel.plot(FRAMES, curves[CHAIN][:, axis], "k", lw=2, label="keyframe chain")
            panel.axhline(SCALE[axis], color="0.6", lw=0.8, zorder=0)
            panel.set_ylim(0.5 * SCALE[axis], 1.8 * SCALE[axis])
            panel.set_ylabel(f"{name}, mm/px")
        panels[0, column].set_title({"norm": "norm constraint + Horn (the paper)", "linear": "linear, polar"}[method])
        panels[1, column].set_xlabel(f"frames ({FPS:.0f} a second, 3 mm/s)")
    panels[0, 1].legend(fontsize=8, ncols=2)
    figure.savefig(target, dpi=120)
    plt.close(figure)
