"""Writes the error of a point as text, the same in every output."""

from collections.abc import Mapping
from typing import Any

from probewatch.appliance.core.quality.check_fields import up_to
from probewatch.appliance.supervision.languages import translated

WORDS = {
    "point": "error of a point up to {worst} mm, of half of them up to {median} mm (99.7 %)",
    "point at depth": "at {depth} mm depth up to {deep} mm",
    "point not known": "error of a point not known",
    "point limit": "limit {limit} mm",
}


def point_text(point: Mapping[str, Any] | None, limit_mm: float | None = None, language: str = "en") -> str:
    """Returns the text. `point` is that of the status or a report, None where it is not known; `limit_mm` is the limit
    for an OK, None for none.
    """

    def say(name: str, **numbers: str) -> str:
        return translated(WORDS[name], language).format(**numbers)

    if point is None:
        said = [say("point not known")]
    else:
        said = [say("point", worst=up_to(point["worst_mm"][1]), median=up_to(point["median_mm"][1]))]
        if point["depth_mm"] is not None:
            depth, deep = f"{point['depth_mm']:g}", up_to(point["at_depth_mm"][1])
            said.append(say("point at depth", depth=depth, deep=deep))
    if limit_mm is not None:
        said.append(say("point limit", limit=f"{limit_mm:g}"))
    return " · ".join(said)
