"""Makes tables of a cross-wire scan's results, for the person who accepts them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from probewatch.appliance.core.parameters import PER_UNIT
from probewatch.appliance.crosswire.running import Running
from probewatch.appliance.crosswire.whole import WholeSolution
from probewatch.appliance.types import PARAMETERS, Calibration, Vector
from probewatch.drivers.rigid import vector_from_rotation
from probewatch.tools.german.translation import recognised, told
from probewatch.tools.shared.tables import FittingTable

_UNITS = ("°",) * 3 + ("%",) * 2 + ("mm",) * 3
"""Units of PARAMETERS, as people read them."""
_AGREES_SIGMAS = 3.0
"""Difference in combined standard deviations beyond which two calibrations disagree: one in 50 good scans has one of
its eight parameters there. Fewer accuse good scans; more accept wrong ones."""
_WORST = 8
"""Number of views shown where not all are requested: those that a person would strike out are among them."""


def difference_in_sigmas(new: Calibration, other: Calibration) -> tuple[Vector, Vector]:
    """Returns the (8,) differences other minus new in the units of PARAMETERS, and the same divided by the combined
    sigmas; NaN where neither calibration has sigmas.
    """
    change = np.concatenate(
        [
            vector_from_rotation(other.rotation @ new.rotation.T),
            other.scale_mm_per_px / new.scale_mm_per_px - 1,
            other.offset_mm - new.offset_mm,
        ]
    )
    known = [one.covariance for one in (new, other) if one.covariance is not None]
    variance = np.sum([np.diag(covariance) for covariance in known], axis=0) if known else np.zeros(8)
    with np.errstate(divide="ignore", invalid="ignore"):
        return change, np.where(variance > 0, change / np.sqrt(variance), np.nan)


def compared(whole: WholeSolution, apart: Mapping[str, tuple[Vector, Vector]]) -> list[dict[str, Any]]:
    """Returns name, value, sigma and unit of the eight parameters, and how far each other calibration is from the new
    one, in the unit and in sigmas; None where that is not known. `apart` maps the name of each other calibration to its
    result of `difference_in_sigmas`.
    """
    new = whole.calibration
    values = [*vector_from_rotation(new.rotation) * np.degrees(1.0), *new.scale_mm_per_px, *new.offset_mm]
    return [
        {
            "name": name,
            "value": float(values[index]),
            "sigma": float(whole.sigma[index] * PER_UNIT[index]),
            "unit": _UNITS[index],
            "others": {
                who: {
                    "off": None if np.isnan(change[index]) else float(change[index] * PER_UNIT[index]),
                    "sigmas": None if np.isnan(sigmas[index]) else float(sigmas[index]),
                }
                for who, (change, sigmas) in apart.items()
            },
        }
        for index, name in enumerate(PARAMETERS)
    ]


def parameter_table(whole: WholeSolution, others: Mapping[str, Calibration]) -> FittingTable:
    """Returns the eight parameters with their sigmas, and how far the other calibrations are from them, in sigmas."""
    return comparison_table(
        compared(whole, {name: difference_in_sigmas(whole.calibration, other) for name, other in others.items()})
    )


def disagreements(whole: WholeSolution, others: Mapping[str, Calibration]) -> list[str]:
    """Returns a sentence for each other calibration that differs by more than the sigmas allow. It names the parameters
    that do.
    """
    found = []
    for name, other in others.items():
        change, sigmas = difference_in_sigmas(whole.calibration, other)
        far = [index for index in range(len(PARAMETERS)) if abs(sigmas[index]) > _AGREES_SIGMAS]
        words = (
            f"{PARAMETERS[index]} by {change[index] * PER_UNIT[index]:+.2f} {_UNITS[index]} ({sigmas[index]:+.1f}σ)"
            for index in far
        )
        if far:
            found.append(
                f"this scan and '{name}' disagree: {', '.join(words)}. Which of the two is wrong, or whether the marker"
                " body has moved, only another scan tells: give it as --check, or solve it and compare"
            )
    return found


def comparison_table(lines: Sequence[Mapping[str, Any]], language: str = "en") -> FittingTable:
    """Returns the result of `compared` as a table."""
    rows = []
    for one in lines:
        cells = [
            recognised(one["name"], language),
            f"{one['value']:.4f}" if one["unit"] == "%" else f"{one['value']:.2f}",
        ]
        cells.append(f"{one['sigma']:.3f} {one['unit']}")
        for other in one["others"].values():
            apart = "" if other["sigmas"] is None else f" ({other['sigmas']:+.1f}σ)"
            cells.append("" if other["off"] is None else f"{other['off']:+.2f} {one['unit']}{apart}")
        rows.append(tuple(cells))
    headings = [recognised(f"{name} less new", language) for name in (lines[0]["others"] if lines else ())]
    return FittingTable((told("parameter", language), told("new", language), "± 1σ", *headings), rows)


def view_table(state: Running, views_px: Vector, all_of_them: bool) -> FittingTable:
    """Returns the views by number, from 1 as in the live review; where only some are shown, those with the largest
    error. `views_px` is (N, 2).
    """
    length = np.linalg.norm(state.cloud_mm, axis=1)
    order = list(range(state.views))
    if not all_of_them:
        order = sorted(order, key=lambda index: -np.nan_to_num(length[index], nan=-1.0))[:_WORST]
    rows = []
    for index in order:
        status = "struck out" if index in state.struck else "rejected" if index in state.rejected else ""
        off = "" if np.isnan(length[index]) else f"{length[index]:.2f}"
        rows.append((str(index + 1), f"{views_px[index, 0]:.1f}", f"{views_px[index, 1]:.1f}", off, status))
    return FittingTable(("view", "column px", "row px", "off mm", ""), rows)
