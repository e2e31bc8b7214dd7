"""States what each check of status, feed and report measures, for the table of docs/alarms.md."""

from collections.abc import Iterator

from probewatch.appliance.supervision.faults import FAULT_ROWS

_BY_MOTION, _SHOWN = "the calibration in force, by motion", "when motion last showed it"
_WAITS = "now, by the host's clock"


def _of_axes(name: str, measured: str, unit: str) -> dict[str, tuple[str, str, str]]:
    """Returns the rows of a parameter with a check for each axis of the picture; {axis} in `measured` is the axis."""
    axes = ("lateral", "axial", "elevational")
    return {f"{name}-{axis}": (measured.format(axis=axis), _BY_MOTION, unit) for axis in axes}


_MEASURED: dict[str, tuple[str, str, str]] = {
    "polarity": ("mirrored axes of the picture", _BY_MOTION, "axes"),
    "picture-flip": ("mirrored axes of the picture, without motion", f"the picture {_SHOWN}", "axes"),
    **{f"scale-{axis}": (f"mm per pixel, {axis}", _BY_MOTION, "%") for axis in ("lateral", "axial")},
    "picture-zoom": (
        "magnification of what is in the picture, the larger of both axes, without motion",
        f"the picture {_SHOWN}",
        "%",
    ),
    "picture-size": ("width or height of the picture", "`image_size_px` of the calibration", "%"),
    "depth-ruler": ("spacing of the ticks of the scanner's depth ruler", f"the ruler {_SHOWN}", "%"),
    "fan-stretch": ("width to height of a convex picture, by its borders", f"the borders {_SHOWN}", "%"),
    "fan-shift": ("place of a convex picture on the screen, by its borders", f"the borders {_SHOWN}", "px"),
    "fan-scale": (
        "mm per pixel, by the arc of the probe's face (`face_radius_mm`)",
        "the calibration in force",
        "%",
    ),
    **_of_axes("rotation", "turn of the marker body about the {axis} axis of the picture", "deg"),
    "marker-turn": ("sum of the sudden turns of the marker body that the picture does not show", f"0 {_SHOWN}", "deg"),
    **_of_axes("offset", "shift of the marker body along the {axis} axis of the picture", "mm"),
    "marker-shift": ("sum of the sudden shifts of the marker body that the picture does not show", f"0 {_SHOWN}", "mm"),
    "marker-elevational": ("the part of these shifts across the picture", f"0 {_SHOWN}", "mm"),
    "latency": ("delay of the poses after the pictures", "`latency_ms`, by motion", "ms"),
    **dict.fromkeys(
        ("poses-inverted", "axes-swapped", "axis-mirrored", "turns-inverted", "quaternion-order"),
        ("by how much poses read so explain motion better than any other reading", "as they are read", "nat"),
    ),
    "exchanged-probe": (
        "the least of rotation, offset and scale, each in multiples of where it says so",
        "the calibration in force",
        "×",
    ),
    "witness-slide": ("shift between the two marker bodies", f"their relative pose {_SHOWN}", "mm"),
    "witness-turn": ("turn between the two marker bodies", f"their relative pose {_SHOWN}", "deg"),
    "undecided": ("by how much motion excludes the calibration, where two classes explain it equally well", "0", "nat"),
    "motion-agreement": ("1 − correlation of the pictures' motion with the tracker's", "0", "1 − r"),
    "fan-motion": ("mm per pixel, by the arc of the probe's face", "the same by motion", "%"),
    "frozen-video": ("age of the picture's content, where the same picture repeats", "0", "ms"),
    "video presence": ("age of the last picture", _WAITS, "ms"),
    "tracker alert": ("time for which the tracker reports a fault of its own", _WAITS, "ms"),
    "marker fit": ("how far the markers lie from the pose that the tracker reports", "0", "mm"),
    "marker geometry": ("how far the markers lie from their places in the tool's definition", "0", "mm"),
    "field indicator": ("indicator value of an electromagnetic tracker", "0", ""),
    "field-distortion": ("by how much errors that depend on the place explain motion better", "0", "nat"),
    "tracker presence": ("age of the last reply for the probe's tool", _WAITS, "ms"),
    "tracker freshness": ("age of the last reply that was not an old one sent again", _WAITS, "ms"),
    "frozen-tracker": ("time for which each pose is the one before, while the picture moves", "0", "ms"),
    "output presence": ("age of the last write that every output has completed", _WAITS, "ms"),
    "estimator presence": ("age of the estimator's last report", _WAITS, "ms"),
    "alarm log integrity": ("kinds of damage of log and memory that nobody has acknowledged", "0", ""),
    "line of sight": ("time without a pose, as where the tool is hidden", _WAITS, "ms"),
    "pose usable": ("time in which no pose could be understood", _WAITS, "ms"),
    "user-freeze": ("age of the picture's content, where the screen around it goes on: a person froze it", "0", "ms"),
    "no-picture": ("time for which nothing of tissue is in the picture", "0", "ms"),
    "alarm log written": ("time for which an entry of the alarm log waits for the disk", _WAITS, "ms"),
    "processor time": ("strain of the computer", "what it bears for long", ""),
    "calibration file": ("1: the configured file is another than was decided about", "the file in force", ""),
    "calibration date": ("1: the date to check the calibration again has passed", "the date of this computer", ""),
}
"""Check → (what is measured, against what, its unit)."""


def check_rows() -> Iterator[tuple[str, str, str, str, str]]:
    """Yields (name, class, what is measured, against what, unit) of every check. Raises KeyError for one that is not
    made any more.
    """
    classes = {name: fault for fault, row in FAULT_ROWS.items() for name in row.checks}
    for name, (measured, against, unit) in _MEASURED.items():
        yield f"`{name}`", f"`{classes[name]}`", measured, against, unit or "–"
