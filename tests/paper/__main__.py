"""`python -m tests.paper`: Table 1 and Figure 4 of Boctor et al. 2005 on the simulator, as CSV, PNG and
docs/paper.md."""

import argparse
import csv
import re
from dataclasses import astuple, fields
from pathlib import Path

import cv2
import numpy as np
from rich.progress import Progress

from tests.paper import comparison, figure4, plots, table1

RESULTS = Path("results/paper")
PAGE = Path("docs/paper.md")
_SWEEPS = 6
_NOISES_MM = (0.1, 0.25)
_AT = (20, 30, 40, 60, 100)
_COMPARED = ("norm d=1", "norm d=10", "linear d=1", "linear d=10", figure4.CHAIN)


def main(results: Path = RESULTS, page: Path = PAGE) -> None:
    """Everything, with a progress bar; about three minutes on one core."""
    cv2.setNumThreads(1)
    results.mkdir(parents=True, exist_ok=True)
    runs = [(noise, seed) for noise in _NOISES_MM for seed in range(_SWEEPS)]
    with Progress() as progress:
        task = progress.add_task("the paper's figures", total=_steps(len(runs)))
        rows = []
        for row in table1.rows():
            rows.append(row)
            progress.advance(task)
        found: dict[tuple[float, str], list[np.ndarray]] = {}
        for noise, seed in runs:
            for name, curve in figure4.curves(seed + 11, noise):
                found.setdefault((noise, name), []).append(curve)
                progress.advance(task)
        scores = []
        for score in comparison.scores():
            scores.append(score)
            progress.advance(task)
    _write_table_1(results, rows)
    _write_figure_4(results, found)
    shown = {name: curves[0] for (noise, name), curves in found.items() if noise == _NOISES_MM[0]}
    plots.figure_4(shown, results / "figure-4.png")
    _write_solvers(results, scores)
    tables = {"table-1": _table_1(rows), "figure-4": _convergence(found), "reachable": _reachable(found)}
    _into_page(page, {**tables, "solvers": _solvers(scores)})
    print(f"{results}/table-1.csv, figure-4.csv, figure-4.png, solvers.csv; tables in {page}")


def _steps(runs: int) -> int:
    return 5 + runs * (2 * len(figure4.STEPS) + 1) + len(comparison.NOISES_MM) * (len(comparison.METHODS) + 1)


def _write_table_1(results: Path, rows: list[table1.Row]) -> None:
    with (results / "table-1.csv").open("w", newline="") as stream:
        out = csv.writer(stream)
        names = (f"{source}_{what}" for source in ("paper", "norm", "linear") for what in ("rodrigues_rad", "x", "y"))
        out.writerow(["dataset", *names])
        for number, (paper, row) in enumerate(zip(table1.PAPER, rows, strict=True), 1):
            out.writerow([number, *paper, *np.round(row.norm, 4), *np.round(row.linear, 4)])


def _write_figure_4(results: Path, found: dict[tuple[float, str], list[np.ndarray]]) -> None:
    with (results / "figure-4.csv").open("w", newline="") as stream:
        out = csv.writer(stream)
        out.writerow(["tracker_mm", "method", "sweep", "frames", "scale_x_mm_per_px", "scale_y_mm_per_px"])
        for (noise, name), curves in found.items():
            for number, curve in enumerate(curves):
                for frames, scale in zip(figure4.FRAMES, curve, strict=True):
                    out.writerow([noise, name, number, frames, *np.round(scale, 5)])


def _write_solvers(results: Path, scores: list[comparison.Score]) -> None:
    with (results / "solvers.csv").open("w", newline="") as stream:
        out = csv.writer(stream)
        out.writerow([field.name for field in fields(comparison.Score)])
        out.writerows([score.noise_mm, score.method, *np.round(astuple(score)[2:], 4)] for score in scores)


def _solvers(scores: list[comparison.Score]) -> str:
    lines = ["| tracker, method | bias / σ | scales, RMS % | rotation, RMS ° |", "|---|---|---|---|"]
    for s in scores:
        bias = f"{s.bias:.2f}" if np.isfinite(s.bias) else "–"
        lines.append(f"| {s.noise_mm} mm, {s.method} | {bias} | {s.scale_percent:.2f} | {s.rotation_deg:.2f} |")
    return "\n".join(lines)


def _table_1(rows: list[table1.Row]) -> str:
    lines = ["| data set | paper: rotation, λx, λy | norm + Horn | linear | polarity told |", "|---|---|---|---|---|"]
    for number, (paper, row) in enumerate(zip(table1.PAPER, rows, strict=True), 1):
        flipped = " (flipped)" if number == 5 else ""
        ours = (f"{r[0]:.3f}, {r[1]:.3f}, {r[2]:.3f}" for r in (row.norm, row.linear))
        polarity = f"({row.polarity[0]:+d}, {row.polarity[1]:+d})"
        lines.append(
            f"| {number}{flipped} | {paper[0]:.3f}, {paper[1]}, {paper[2]} | {' | '.join(ours)} | {polarity} |"
        )
    return "\n".join(lines)


def _convergence(found: dict[tuple[float, str], list[np.ndarray]]) -> str:
    lines = ["| step | norm + Horn: λx, λy | linear: λx, λy |", "|---|---|---|"]
    for d in figure4.STEPS:
        cells = (_frames(found[_NOISES_MM[0], f"{method} d={d}"]) for method in ("norm", "linear"))
        lines.append(f"| d = {d} | {' | '.join(cells)} |")
    lines.append(f"| keyframe chain | | {_frames(found[_NOISES_MM[0], figure4.CHAIN])} |")
    return "\n".join(lines)


def _frames(curves: list[np.ndarray]) -> str:
    """Median over the sweeps, `never` where most did not settle."""
    after = np.array([figure4.converged_after(curve) for curve in curves])
    median = np.median(np.nan_to_num(after, nan=np.inf), axis=0)
    return ", ".join(f"{frames:.0f}" if np.isfinite(frames) else "never" for frames in median)


def _reachable(found: dict[tuple[float, str], list[np.ndarray]]) -> str:
    lines = [f"| tracker, method | {' | '.join(map(str, _AT))} |", "|---|" + "---|" * len(_AT)]
    rows = [int(np.flatnonzero(frames == figure4.FRAMES)[0]) for frames in _AT]
    for noise in _NOISES_MM:
        for name in _COMPARED:
            rms = figure4.worst_axis_rms_percent(found[noise, name])[rows]
            cells = (f"{value:.1f}" if np.isfinite(value) else "–" for value in rms)
            lines.append(f"| {noise} mm, {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _into_page(file: Path, tables: dict[str, str]) -> None:
    """Replace what stands between the marks of each table."""
    page = file.read_text()
    for name, table in tables.items():
        mark = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end -->)", re.DOTALL)
        page, count = mark.subn(lambda found, table=table: found[1] + table + "\n" + found[2], page)
        assert count == 1, name
    file.write_text(page)


if __name__ == "__main__":
    argparse.ArgumentParser(prog="python -m tests.paper", description=__doc__).parse_args()
    main()
