"""The measured figures as tables that a plain terminal can show."""

from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from tests.bench.accuracy import FAILED_PX, METHODS

_WIDTH = 124


def show(result: dict[str, Any]) -> None:
    """Head with what the figures depend on, then one table for each kind of figure."""
    console = _console()
    for name, value in result["environment"].items():
        console.print(f"{name}: {value}", highlight=False, soft_wrap=True)
    _print(console, _errors(result), _times(result), _coverage(result), _line(result))
    show_handover(result["handover"])
    checked = result["self-check"]
    console.print(
        f"self-check: {_percent(checked['diverged refused'])} of {checked['diverged']} diverged registrations refused, "
        f"{_percent(checked['good refused'])} of {checked['good']} good ones",
        highlight=False,
        soft_wrap=True,
    )


def show_handover(found: dict[str, Any]) -> None:
    """What a frame costs on its way to the estimator, and when it is there."""
    _print(_console(), _hops(found), _delays(found), _idle(found))


def _console() -> Console:
    console = Console()
    return console if console.is_terminal else Console(width=_WIDTH)


def _print(console: Console, *tables: Table) -> None:
    for table in tables:
        console.print(f"\n{table.title}", highlight=False, soft_wrap=True)
        table.title = None
        console.print(table)


def _hops(found: dict[str, Any]) -> Table:
    title = f"way of a frame from the driver's buffer; checksums went over {found['checksums']:g} pictures"
    table = _table(title, "hop", "written by", "pictures written", "median ms", "÷ one copy")
    for walk in found["hops"]:
        width, height = walk["size_px"]
        for row in walk["hops"]:
            shares = f"{row['written']:.2f}", f"{row['median_ms']:.3f}", f"{row['median_ms'] / walk['copy_ms']:.1f}"
            table.add_row(f"{row['hop']} {width} × {height}", row["who"], *shares)
    return table


def _delays(found: dict[str, Any]) -> Table:
    names = ("p50_ms", "p90_ms", "p99_ms", "max_ms")
    table = _table("delay until another process holds a picture of 640 × 480", "method", *names)
    for row in found["delays"]:
        table.add_row(row["method"], *(f"{row[name]:.2f}" for name in names))
    return table


def _idle(found: dict[str, Any]) -> Table:
    table = _table("without samples", "process", "processor ms a second", "switches a second")
    for row in found["idle"]:
        table.add_row(row["process"], f"{row['ms_per_s']:.2f}", f"{row['switches_per_s']:.0f}")
    return table


def _errors(result: dict[str, Any]) -> Table:
    table = _table(
        f"RMS error px of what did not fail, and the share that failed: gave up, or more than {FAILED_PX:g} px off",
        *("scene", "bound", "reached", *METHODS),
    )
    table.columns[0].no_wrap = True
    cells = {(row["scene"], row["method"]): row for row in result["errors"]}
    for scene in dict.fromkeys(row["scene"] for row in result["errors"]):
        known = (result[name].get(scene) for name in ("bounds_px", "reached_px"))
        limits = ("" if px is None else f"{px:.4f}" for px in known)
        table.add_row(scene, *limits, *(_cell(cells[scene, name]) for name in METHODS))
    return table


def _cell(row: dict[str, Any]) -> str:
    error = "–" if row["rms_px"] is None else f"{row['rms_px']:.3f}"
    return error + (f" {100 * row['failed']:.0f}%" if row["failed"] else "")


def _times(result: dict[str, Any]) -> Table:
    title = "processor time a pair, over all scenes; ratios: median of time ÷ ours on the same pair"
    table = _table(title, "method", "median ms", "90 % ms", "÷ ours, cold", "÷ keyframe", "÷ accurate")
    for row in result["times"]:
        figures = (f"{row[name]:.1f}" for name in ("median_ms", "p90_ms"))
        ratios = (f"{row[name]:.2f}" for name in ("of_cold", "of_keyframe", "of_accurate"))
        table.add_row(row["method"], *figures, *ratios)
    return table


def _coverage(result: dict[str, Any]) -> Table:
    table = _table(
        "errors of u within the stated sigma (68 % and 95 % are due)", "pairs", "errors", "1 sigma", "2 sigma"
    )
    for row in result["coverage"]:
        table.add_row(row["pairs"], str(row["n"]), _percent(row["within_1_sigma"]), _percent(row["within_2_sigma"]))
    return table


def _line(result: dict[str, Any]) -> Table:
    table = _table("processor time a picture", "stage", "median ms", "mean ms", "95 % ms", "99 % ms")
    for line in result["line"]:
        width, height = line["size_px"]
        figures = (f"{line[name]:.2f}" for name in ("median_ms", "mean_ms", "p95_ms", "p99_ms"))
        table.add_row(f"whole line {width} × {height}", *figures)
    table.add_row("simulated picture 640 × 480", "", f"{result['world_ms']:.2f}", "", "")
    return table


def _table(title: str, *columns: str) -> Table:
    """The first column holds names, the others figures."""
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for at, name in enumerate(columns):
        table.add_column(name, justify="right" if at else "left")
    return table


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.0f} %"
