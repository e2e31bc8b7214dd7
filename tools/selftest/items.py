"""Judges each item of the self-test, by a status, by samples of the feed, and by what a person has answered. Pure."""

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Any

import numpy as np

from probewatch.appliance.core.registration.overlay import OverlayMask
from probewatch.appliance.core.registration.pyramid import pyramid
from probewatch.appliance.storage.reference_store import CONFIGURED
from probewatch.appliance.supervision.fault_row import Device
from probewatch.appliance.supervision.faults import of_device
from probewatch.appliance.types import State
from probewatch.drivers.rigid import vector_from_rotation
from probewatch.drivers.samples import Frame, Pose, PoseStatus
from probewatch.tools.shared.status_view import is_recovering
from probewatch.tools.shared.time_quality import LEAST_HZ, MOST_JITTER_MS, TimeQuality, time_quality

_MOST_LOST_PERCENT = 1.0
"""Share, %, of the samples counted by the device that may be lost. A cable that loses more is going to lose all. Not
measured on carts.
"""
_MOST_BOUND_MS = 20.0
"""Median stated error of a stamp, ms: a third of the shipped limit of the latency, 60 ms. Less rejects grabbers that
work; more hides what spoils the latency."""
_MOST_NOISE_MM, _MOST_NOISE_DEG = 0.5, 0.2
"""Standard deviation of a stationary probe, per axis: five and ten times that of a Polaris at 2 m. More makes every
verification late; the item names markers and distance."""
_STILL_MM, _STILL_DEG = 3.0, 1.5
"""Motion between the first and the last fifth of the poses, which is a second each: more is a hand, not noise, and
nothing can be concluded.
"""
_MASK_PERCENT = (1.0, 80.0)
"""Share of the picture, %, that is masked: a scanner shows a frame and text, and more than a fifth of echoes."""
_LEAST_FREE_BYTES = 1_000_000_000
"""Bytes free on the disk of the alarm log: a year of log, and a day of pictures. Less is reported before it is full."""
_LATEST_CHECK_DAYS = 0.0
"""Days beyond the date at which a reference is due that are still green."""

Status = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Item:
    """Represents one item. green: None where it could not be tried, which does not pass. remedy: empty where nothing is
    to be done. figure: what was measured, in unit; None where the item has no figure.
    """

    name: str
    green: bool | None
    what: str
    remedy: str = ""
    figure: float | None = None
    unit: str = ""

    def fields(self) -> dict[str, Any]:
        return asdict(self)


_WHOLE_FROM = 100
"""Value from which decimals mean nothing beside its limit."""


def devices(status: Status) -> list[Item]:
    """Returns the presence of each part, as the service's own watchers judge it, and what the service calls lost."""
    gone = set(_unknown(status["devices"]))
    found = [check for check in status["devices"] if check["value"] is not None or check["verdict"] == "FAULT"]
    items = [_watched(check, gone) for check in found]
    items += [Item(device, False, what, _mend(what)) for device, what in status["lost"].items()]
    return items


def _mend(what: str) -> str:
    """Returns what to do about a lost device; the description of the loss often states it already."""
    return "Mend that first, and repeat" if ". " in what else "Mend it, or its cable"


def _unknown(checks: Sequence[Status]) -> Iterator[str]:
    """Yields the faults that are not looked for as long as their device is gone: its watchers find nothing."""
    found = {check["fault"] for check in checks if check["verdict"] == "FAULT"}
    for device in (Device.SCANNER, Device.TRACKER):
        loss, *others = of_device(device)
        yield from others if loss in found else ()


def _watched(check: Status, gone: Set[str]) -> Item:
    """Returns the item of a check. One that is not verified, such as the line of sight of a probe that is not in view,
    could not be tried.
    """
    good = check["verdict"] == "OK"
    if good and check["fault"] in gone:
        return Item(check["name"], None, "not known, as its device is lost", "Mend that first, and repeat")
    what = "within its limit" if good else _beyond(check)
    remedy = "" if good else "See probewatch status"
    if is_recovering(check):
        what, remedy = "was beyond its limit, and is within it again", "Wait some seconds, and test again"
    return Item(check["name"], None if check["verdict"] == "NOT_VERIFIED" else good, what, remedy)


def _beyond(check: Status) -> str:
    """Returns value and limit in figures that a person reads; a value that is not known is left out."""
    value, limit = check["value"], check["limit"]
    shown = "not known" if value is None else f"{value:.0f}" if abs(value) > _WHOLE_FROM else f"{value:.3g}"
    return f"{shown} {check['unit']}".strip() + f", limit {limit:g}"


def service(status: Status) -> list[Item]:
    """Returns the items of the service's state, of what it remembers, and of how short of time it is."""
    state = status["state"]
    bad = state in (State.INTERNAL_FAULT.value, State.DEVICE_LOST.value, State.SELF_TEST.value)
    items = [Item("service", not bad, f"{state}, version {status['software']}", status["remedy"] if bad else "")]
    latched = status["latched"]
    known = "acknowledged" if status["acknowledged"] else "not acknowledged"
    what = "none" if latched is None else f"{latched}, {known}"
    items.append(Item("latched alarm", latched is None, what, "" if latched is None else "Mend the cause; acknowledge"))
    restarts = status["counters"]["estimator_restarts"]
    remedy = "" if restarts == 0 else "probewatch log, journalctl -u probewatch"
    items.append(Item("estimator restarts", restarts == 0, str(restarts), remedy))
    return items


def disk(status: Status) -> list[Item]:
    """Returns the items of the alarm log and its disk."""
    log = status["log"]
    writing = log["failing"] is None
    free = log["free_bytes"]
    room = None if free is None else free >= _LEAST_FREE_BYTES
    told = "not known" if free is None else f"{free / 1e9:.1f} GB free"
    return [
        Item(
            "alarm log", writing, "is written" if writing else str(log["failing"]), "" if writing else "Check the disk"
        ),
        Item("disk", room, told, "" if room else "Make room on the disk of the alarm log"),
    ]


def clock(utc: datetime, built: datetime, synchronised: bool | None) -> Item:
    """Returns the item of the clock. built: when this program was built; no wall clock can be earlier. synchronised: as
    the kernel reports it.
    """
    told = f"{utc.isoformat(timespec='seconds')}, " + (
        "not known whether synchronised" if synchronised is None else "synchronised" if synchronised else "free-running"
    )
    right = utc >= built
    return Item("clock", right, told, "" if right else "Set the clock: the log's dates are wrong")


def reference(status: Status, utc: datetime) -> list[Item]:
    """Returns the items of the reference: whether there is one, was ever verified, and is due for its check."""
    known = status["reference"]
    if known is None:
        return [Item("reference", False, str(status["reference_waits"]), "Calibrate: docs/first-calibration.md")]
    verified = known["verified_utc"] is not None
    told = f"number {known['number']} of {known['utc']}"
    items = [Item("reference", verified, told, "" if verified else "Move the probe over tissue until it is verified")]
    if overdue := status.get("reference_overdue"):
        items.append(Item("reference in time", False, overdue, "Recalibrate; where the clock is wrong, set it"))
    due = status["reference_due_utc"]
    if due is None:
        items.append(Item("reference due", True, "no date asked for ([calibration] due_days)"))
    else:
        late_days = (utc - datetime.fromisoformat(due)).total_seconds() / 86_400
        good = late_days <= _LATEST_CHECK_DAYS
        items.append(Item("reference due", good, due, "" if good else "Recalibrate, or check it with the cross-wire"))
    changed = status["calibration_changed"]
    items.append(
        Item(
            "configured calibration",
            changed is None,
            changed or _in_force(known),
            "" if changed is None else "probewatch calibration",
        )
    )
    return items


def _in_force(known: Mapping[str, Any]) -> str:
    """Returns what is in force of the configured calibration, where nobody has to decide about it."""
    if known["origin"] == CONFIGURED:
        return "is in force"
    return f"reference {known['number']} is in force, as was decided later"


def timing(name: str, samples: Sequence[Frame | Pose], arrivals_ns: Sequence[int], silence_ms: float) -> list[Item]:
    """Returns rate, losses and time quality of one source. name: video or tracker. silence_ms: silence after which the
    service calls it lost.
    """
    found = time_quality(samples, arrivals_ns)
    if found is None:
        return [Item(f"{name} rate", False, f"{len(samples)} samples came", "See that it runs and is connected")]
    return [*_rate(name, found), *_time(name, found, silence_ms)]


def silence_ms(status: Status, name: str) -> float:
    """Returns how long, ms, the service lets a source be silent: video or tracker."""
    return next(float(check["limit"]) for check in status["devices"] if check["name"] == f"{name} presence")


def _rate(name: str, found: TimeQuality) -> list[Item]:
    fast = found.rate_hz >= LEAST_HZ[name]
    lost_percent = 100 * found.lost / (found.lost + found.samples)
    whole = lost_percent <= _MOST_LOST_PERCENT
    least = f"{LEAST_HZ[name]:g} / s at least"
    slow = "" if fast else "Raise the device's rate"
    cable = "" if whole else "Check its cable, and what else runs"
    return [
        Item(f"{name} rate", fast, f"{found.rate_hz:.1f} / s, {least}", slow, found.rate_hz, "/ s"),
        Item(
            f"{name} losses", whole, f"{lost_percent:.2f} %, at most {_MOST_LOST_PERCENT:g} %", cable, lost_percent, "%"
        ),
    ]


def _time(name: str, found: TimeQuality, silence_ms: float) -> list[Item]:
    regularity = _regularity(f"{name} regularity", found, silence_ms)
    if np.isnan(found.bound_ms):
        return [Item(f"{name} stamps", None, "no pose came", "Bring the probe into view, and repeat"), *regularity]
    bound = found.bound_ms <= _MOST_BOUND_MS
    probe = "" if bound else "probewatch probe URL"
    within = f"± {found.bound_ms:.1f} ms, at most {_MOST_BOUND_MS:g} ms"
    return [
        Item(f"{name} stamps", bound, within, probe, found.bound_ms, "ms"),
        *regularity,
    ]


def _regularity(name: str, found: TimeQuality, silence_ms: float) -> list[Item]:
    """Returns how regular the samples are; nothing where the device's counter, against which the scatter is measured,
    did not advance and no pause was long.
    """
    known, short = np.isfinite(found.jitter_ms), found.longest_ms <= silence_ms
    if not known and short:
        return []
    steady = short and found.jitter_ms <= MOST_JITTER_MS
    scatter = f"scatter {found.jitter_ms:.1f} ms, at most {MOST_JITTER_MS:g} ms; " if known else ""
    what = f"{scatter}longest pause {np.ceil(found.longest_ms):.0f} ms, at most {silence_ms:g} ms"
    cable = "" if steady else "Check its cable, and what else runs"
    return [Item(name, steady, what, cable, found.jitter_ms if known else None, "ms")]


def noise(poses: Sequence[Pose]) -> Item:
    """Returns the noise of a stationary probe in view of the tracker."""
    good = [pose.matrix for pose in poses if pose.status is PoseStatus.OK and pose.matrix is not None]
    if len(good) < 30:
        what = f"{len(good)} of {len(poses)} poses saw the probe"
        return Item("noise at rest", None, what, "Lay the probe still in view of the tracker, and repeat")
    places = np.array([matrix[:3, 3] for matrix in good])
    turns = np.array([np.degrees(vector_from_rotation(good[0][:3, :3].T @ matrix[:3, :3])) for matrix in good])
    part = max(1, len(good) // 5)
    moved_mm = float(np.linalg.norm(places[-part:].mean(axis=0) - places[:part].mean(axis=0)))
    turned_deg = float(np.linalg.norm(turns[-part:].mean(axis=0) - turns[:part].mean(axis=0)))
    if moved_mm > _STILL_MM or turned_deg > _STILL_DEG:
        what = f"the probe moved by {moved_mm:.1f} mm and {turned_deg:.1f}°"
        return Item("noise at rest", None, what, "Lay it down, do not hold it, and repeat")
    noise_mm, noise_deg = float(places.std(axis=0).max()), float(turns.std(axis=0).max())
    quiet = noise_mm <= _MOST_NOISE_MM and noise_deg <= _MOST_NOISE_DEG
    remedy = "" if quiet else "Clean the markers; bring the probe nearer to the middle of the tracker's volume"
    most = f"at most {_MOST_NOISE_MM:g} mm, {_MOST_NOISE_DEG:g}°"
    what = f"{noise_mm:.2f} mm, {noise_deg:.2f}° (standard deviation, worst axis), {most}"
    return Item("noise at rest", quiet, what, remedy, noise_mm, "mm")


def overlay(frames: Sequence[Frame]) -> Item:
    """Returns the item of the overlay, which never moves while the probe does: text and frame, which are kept out of
    the registration.
    """
    mask = OverlayMask()
    for frame in frames:
        mask.step(pyramid(frame.image))
    if mask.mask is None or not mask.settled:
        what = "not learnt: the picture has hardly changed"
        return Item("overlay mask", None, what, "Move the probe over tissue while it is asked for, and repeat")
    percent = 100 * (1 - float(mask.mask.mean()))
    least, most = _MASK_PERCENT
    good = least <= percent <= most
    remedy = "" if good else "Look at the picture: is it the scanner's, whole, and live?"
    return Item("overlay mask", good, f"{percent:.0f} % of the picture is drawn or dark", remedy, percent, "%")


def outputs(status: Status, seen: bool | None) -> Item:
    """Returns the item of the lamps and the tone. seen: a person's answer about every lamp and the tone after a lamp
    test; None where nobody was asked.
    """
    shown = [output["signal"] for output in status["outputs"] if output["signal"] != "contact"]
    if not shown:
        return Item("lamps and tone", True, "this cart has none, only the contact")
    what = {None: "no operator confirmed them", True: "seen and heard by the operator", False: "not all seen or heard"}[
        seen
    ]
    return Item("lamps and tone", seen, f"{', '.join(shown)}: {what}", "" if seen else "Check lamps, tone and cables")
