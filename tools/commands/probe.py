"""`probewatch probe URL`: connects to one device and reports what it is and how well it works."""

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import click
import numpy as np

from probewatch.appliance.supervision.timeline import NEAREST_MM
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.device_api import AlarmOutput, Description, Identified, TrackerSource, VideoSource
from probewatch.drivers.errors import ConfigurationError, DeviceLost, ProbewatchError, RecordingError
from probewatch.drivers.recordings.replay import ENDED
from probewatch.drivers.registry import check_options, device_kinds, open_output, open_tracker, open_video
from probewatch.drivers.samples import Frame, Pose, PoseStatus
from probewatch.tools.german.devices import device_text
from probewatch.tools.german.translation import tell_refused
from probewatch.tools.shared.driver_text import any_url, schemes_and_options
from probewatch.tools.shared.named_cart import cart_language
from probewatch.tools.shared.time_quality import LEAST_HZ, MOST_JITTER_MS, TimeQuality, time_quality

_READ_S = 0.2
"""Seconds for which a read waits, and by which the measurement may exceed the requested time."""
_HELD_S = 1.0
"""Seconds for which a contact that is probed stays energised."""
_LOOSE_BOUND_MS = 10.0
"""Limit of the timestamp error, which reduces the margin on either side of the latency's limit, 60 ms as shipped."""
_MANY_LOST = 0.02
"""Share of lost samples from which they are reported. Less complains about a host that was busy once; more is silent
about a line that is too slow. Not measured."""
_POOR_FIT_MM = 0.5
"""Median RMS of the markers: two thirds of the shipped limit, .75 mm, so that a person learns of it before the alarm.
"""

_ALIKE = 10
"""Number of equal pictures that are reported, a third of a second at 30 Hz. Fewer complain about a short look at a
digital picture that does not change; more let a source that repeats only its memory pass as good. Not measured."""
_UNKNOWN = "not to be told"
_NOTHING = "nothing"
"""Last line for a source that yielded nothing usable."""

Row = tuple[str, str]
Open = Callable[[str, HostClock], TrackerSource | VideoSource]
_HALVES = {"poses": "tracker", "pictures": "video"}
_OPENS: dict[str, Open] = {"poses": open_tracker, "pictures": open_video}


@dataclass
class Measured:
    """Holds a measurement. `samples` are in order of arrival; `arrivals_ns` holds the arrival of each, on the clock of
    the stamps. `end` says why reading ended early.
    """

    samples: list[Frame | Pose] = field(default_factory=list)
    arrivals_ns: list[int] = field(default_factory=list)
    end: DeviceLost | None = None

    @property
    def played_out(self) -> bool:
        """Returns whether a recording was read to its end, undamaged and with usable samples."""
        return self.end is not None and self.end.what == ENDED and self.usable > 0

    @property
    def poses(self) -> list[Pose]:
        return [sample for sample in self.samples if isinstance(sample, Pose)]

    @property
    def half(self) -> str:
        """Returns which half of a cart the samples belong to."""
        return "poses" if self.poses else "pictures"

    @property
    def usable(self) -> int:
        """Returns the number of samples with a picture or a valid pose."""
        return sum(isinstance(sample, Frame) or sample.status is PoseStatus.OK for sample in self.samples)


_HELP = """Connect to the device at URL, measure for some seconds, and say what it is and how well it does.

A source that may give both is asked for both, unless --only names one. The last line of each is one word: good;
poor, if lines are marked with "!"; nothing, or lost where something came before, and why.

\b
Examples:
  probewatch probe v4l2:/dev/video0
  probewatch probe 'ndi:/dev/ttyUSB0?probe=/etc/probewatch/probe.rom'
  probewatch probe igtl://plus-host:18944?probe=Probe --only poses
  probewatch probe relay:/dev/ttyUSB1 --click     # only while the contact is not in use

Exit code 0 when it works, poorly too; else that of the fault: 69 the device is lost, or it or its half of a cart
gives nothing to use, 76 it breaks its protocol, 78 the URL can never work, 65 the recording cannot be read.

\b
URL as in the configuration; options follow a "?", separated by "&":
{}
"""


@click.command("probe", help=_HELP.format("\n".join(schemes_and_options())))
@click.argument("url", required=False)
@click.option("--seconds", type=click.FloatRange(0.5, 3600), default=10.0, help="how long to measure [10]")
@click.option("--only", type=click.Choice(["poses", "pictures"]), help="of a source of both, what it is to give")
@click.option("--click", "may_click", is_flag=True, help="let an output close and open its contact once")
def command(url: str | None, seconds: float, only: str | None, may_click: bool) -> None:
    if url is None:
        raise click.UsageError(f"Missing argument 'URL', such as {any_url()}. What is connected: probewatch devices")
    kinds = device_kinds(url)
    if only is not None and _HALVES[only] not in kinds:
        raise click.UsageError(f"{url} gives no {only}; leave --only out")
    if kinds == ("output",):
        _probe_output(url, may_click, HostClock())
    elif kinds == ("tracker", "video") and only is None:
        _probe_cart(url, seconds)
    else:
        _probe_source(url, _OPENS[only or ("poses" if kinds == ("tracker",) else "pictures")], seconds)


def _probe_output(url: str, may_click: bool, clock: HostClock) -> None:
    check_options(url, "output")
    if not may_click:
        if url.startswith("tone:"):
            what, remedy = "probing an output sounds its tone", "Add --click while the tone is not in use"
            raise ConfigurationError(what, url, remedy)
        what, remedy = "probing an output moves its contact", "Add --click while the contact is not in use"
        raise ConfigurationError(what, url, remedy)
    with open_output(url, clock) as output:
        _print(_description(output))
        said = [_click(output, energised, url, clock) for energised in (True, False)]
    if None in said:
        _say("no feedback confirms that the contact moved. Watch it, or listen for two clicks", "! ")


def _click(output: AlarmOutput, energised: bool, url: str, clock: HostClock) -> bool | None:
    """Returns the state that the contact reads back. Raises DeviceLost where it differs from the command."""
    asked_ns, word = clock.now_ns(), "energised" if energised else "released"
    output.write(energised)
    took_ms = (clock.now_ns() - asked_ns) / 1e6
    said = output.read_back()
    if said not in (None, energised):
        what = "the contact was commanded released, but reads back closed"
        what = "the contact was commanded energised, but reads back open" if energised else what
        raise DeviceLost(what, url, "Check the wiring of the contact and of what reads it back")
    told = "commanded, not confirmed" if said is None else "confirmed"
    _print([(f"contact {word} in", f"{took_ms:.1f} ms, {told}")])
    time.sleep(_HELD_S * energised)
    return said


def _probe_cart(url: str, seconds: float) -> None:
    """Measures poses, then pictures, each to its end. A recording may hold only one of them.

    Raises DeviceLost where nothing answers; otherwise the error of the first half that yields nothing.
    """
    for each in device_kinds(url):
        check_options(url, each)
    failures: dict[str, ProbewatchError] = {}
    for half, open_source in _OPENS.items():
        _say(half.capitalize())
        if (failure := _half_of_cart(url, open_source, seconds)) is not None:
            failures[half] = failure
        click.echo()
    alone_ok = all(isinstance(error, RecordingError) for error in failures.values()) and len(failures) < len(_OPENS)
    if not failures or alone_ok:
        return
    given = [half for half in _OPENS if half not in failures]
    if given:
        _say(f"If {given[0]} are all that is asked of it: --only {given[0]}")
    raise next(iter(failures.values()))


def _half_of_cart(url: str, open_source: Open, seconds: float) -> ProbewatchError | None:
    """Measures one half of a cart. Prints and returns why it yields nothing usable; None where it does. Raises
    DeviceLost where nothing answers, so that the other half is not tried.
    """
    clock = HostClock()
    try:
        source = open_source(url, clock)
    except (RecordingError, ConfigurationError) as error:
        _say_failed(_NOTHING, error)
        return error
    except DeviceLost:
        _say(_NOTHING)
        raise
    measured = Measured()
    try:
        _tell(source, url, seconds, clock, measured)
    except (RecordingError, DeviceLost, ConfigurationError) as error:
        _say_failed(_word_of_failure(measured), error)
        return error
    return None


def _probe_source(url: str, open_source: Open, seconds: float) -> None:
    clock, measured = HostClock(), Measured()
    try:
        _tell(open_source(url, clock), url, seconds, clock, measured)
    except ConfigurationError:
        raise
    except ProbewatchError:
        _say(_word_of_failure(measured))
        raise


def _word_of_failure(measured: Measured) -> str:
    return "lost" if measured.usable else _NOTHING


def _tell(opened: TrackerSource | VideoSource, url: str, seconds: float, clock: HostClock, measured: Measured) -> None:
    """Measures the source, prints the result and closes it. `clock` was created before the source was opened, and
    `measured` is empty.
    """
    with opened as source:
        _say(f"connected in {(clock.now_ns() - clock.origin_ns) / 1e9:.2f} s, measuring for {seconds:g} s")
        measure(source, seconds, clock, measured)
        told = source.describe() if isinstance(source, Identified) else None
    _print([*_rows(told), *findings(measured)])
    absent = "" if told is None or measured.usable else told.absent
    remedy = "" if told is None else told.time_remedy
    found = [absent] if absent else [*complaints(measured, remedy), *_too_few(measured, seconds)]
    for complaint in found:
        _say(complaint, "! ")
    if measured.end is not None:
        if not measured.played_out:
            raise measured.end
        _say(measured.end.what)
    if not measured.usable:
        what = f"nothing to use came within {seconds:g} s"
        remedy = told.remedy if told is not None and absent else _MEND[_usual_status(measured)]
        raise DeviceLost(f"{what}: {absent}" if absent else what, url, remedy)
    _say("poor, see the lines marked with !" if found else "good")


def measure(
    source: TrackerSource | VideoSource, seconds: float, clock: HostClock, measured: Measured | None = None
) -> Measured:
    """Returns what arrives in that time, or until the device is lost; it is added to `measured` where that is given."""
    measured = measured or Measured()
    end_ns = clock.now_ns() + round(seconds * 1e9)
    while clock.now_ns() < end_ns:
        try:
            sample = source.read(_READ_S)
        except DeviceLost as error:
            measured.end = error
            return measured
        if sample is not None:
            measured.samples.append(sample)
            measured.arrivals_ns.append(clock.now_ns())
    return measured


def _description(device: object) -> list[Row]:
    """Returns the rows of the device's own description; empty for a device without one."""
    return _rows(device.describe() if isinstance(device, Identified) else None)


def _rows(told: Description | None) -> list[Row]:
    if told is None:
        return []
    rate = "" if math.isnan(told.rate_hz) else f"{told.rate_hz:.4g} measurements per second"
    rows = [
        ("model", told.model),
        ("firmware", told.firmware),
        ("serial number", told.serial_number),
        ("tools", "; ".join(told.tools)),
        ("device rate", rate),
        *(("remark", remark) for remark in told.remarks),
    ]
    return [(name, text) for name, text in rows if text]


def findings(measured: Measured) -> list[Row]:
    """Returns the measurements as text and figures."""
    rows = [("samples", f"{len(measured.samples)}, of which {measured.usable} can be used")]
    frames = [sample for sample in measured.samples if isinstance(sample, Frame)]
    if frames:
        height, width = frames[-1].image.shape
        rows.append(("picture", f"{width} x {height} pixels"))
    fits_mm = _fits_mm(measured)
    if fits_mm:
        rows.append(("marker fit", f"median {np.median(fits_mm):.3g}, worst {max(fits_mm):.3g} mm RMS or indicator"))
    quality = time_quality(measured.samples, measured.arrivals_ns)
    return rows if quality is None else rows + _time_rows(quality)


def _time_rows(quality: TimeQuality) -> list[Row]:
    jitter = _UNKNOWN if math.isnan(quality.jitter_ms) else f"{quality.jitter_ms:.2f} ms"
    bound = f"median ± {quality.bound_ms:.2f} ms, at worst ± {quality.worst_bound_ms:.2f} ms"
    delay = f"{quality.delay_ms:.1f} ms from measurement to arrival, at worst {quality.worst_delay_ms:.1f} ms"
    measured = not math.isnan(quality.bound_ms)
    return [
        ("rate", f"{quality.rate_hz:.2f} per second, the device counts {quality.step} for each"),
        ("timestamp error", bound if measured else _UNKNOWN),
        ("timestamp jitter", jitter),
        ("delay", delay if measured else _UNKNOWN),
        ("gaps", f"{quality.gaps}, {quality.lost} samples lost in them; longest step {quality.longest_ms:.0f} ms"),
    ]


def complaints(measured: Measured, time_remedy: str = "") -> Iterator[str]:
    """Yields the defects of a device that answers. `time_remedy` is the device's remedy for imprecise stamps."""
    found = Counter((pose.status, pose.reason) for pose in measured.poses if pose.status is not PoseStatus.OK)
    for (status, reason), number in found.most_common(5):
        share = 100 * number / len(measured.samples)
        yield f"{share:.0f} % of the poses: {status.value} ({reason}). {_MEND[status]}"
    fits_mm = _fits_mm(measured)
    if fits_mm and np.median(fits_mm) > _POOR_FIT_MM:
        yield f"the marker fit is poor ({np.median(fits_mm):.2g}). Clean the markers and compare body and definition"
    places_mm = [float(np.linalg.norm(pose.matrix[:3, 3])) for pose in measured.poses if pose.matrix is not None]
    far_mm = max(places_mm, default=math.inf)
    if far_mm <= NEAREST_MM:
        yield f"all poses lie within {far_mm:.2g} mm of the origin. Have the sender use mm; it may use metres"
    images = [sample.image for sample in measured.samples if isinstance(sample, Frame)]
    if len(images) >= _ALIKE and all(np.array_equal(image, images[0]) for image in images):
        what = f"all {len(images)} pictures are the same"
        yield f"{what}. Move the probe, end the scanner's freeze; of an interlaced stream OpenCV decodes no picture"
    quality = time_quality(measured.samples, measured.arrivals_ns)
    if quality is not None and quality.bound_ms > _LOOSE_BOUND_MS:
        known = f"the time is known only to ± {quality.bound_ms:.0f} ms in the median"
        yield f"{known}. {time_remedy or 'Measure longer, or look for what delays the line'}"
    if quality is not None:
        yield from _complaints_of_times(quality, measured.half)


def _too_few(measured: Measured, seconds: float) -> Iterator[str]:
    """Yields a complaint about a source that gave too few samples for a rate; a recording may be as short."""
    if measured.end is None and time_quality(measured.samples, measured.arrivals_ns) is None:
        yield from _complaint_of_rate(measured.usable / seconds, measured.half)


def _complaint_of_rate(rate_hz: float, half: str) -> Iterator[str]:
    least_hz = LEAST_HZ[_HALVES[half]]
    if rate_hz < least_hz:
        what = f"{rate_hz:.3g} {half} come per second, {least_hz:g} are needed"
        yield f"{what}. Have the device or the sender give each one that it measures"


def _complaints_of_times(quality: TimeQuality, half: str) -> Iterator[str]:
    yield from _complaint_of_rate(quality.rate_hz, half)
    if quality.jitter_ms > MOST_JITTER_MS:
        yield f"the times scatter by {quality.jitter_ms:.0f} ms. Look for a slow line, or a sender that stamps late"
    if quality.lost > _MANY_LOST * quality.samples:
        yield f"{quality.lost} samples were lost. Look for a slow line, or a busy host"


def _fits_mm(measured: Measured) -> list[float]:
    return [pose.rms_mm for pose in measured.poses if pose.status is PoseStatus.OK and not math.isnan(pose.rms_mm)]


def _usual_status(measured: Measured) -> PoseStatus | None:
    found = Counter(pose.status for pose in measured.poses)
    return found.most_common(1)[0][0] if found else None


_MEND: dict[PoseStatus | None, str] = {
    None: "Check that the device is switched on and measures",
    PoseStatus.PARTIAL: "Bring the tool further into the measurement volume",
    PoseStatus.OUT_OF_VOLUME: "Bring the tool into the measurement volume",
    PoseStatus.MISSING: "Bring the tool into view, and clear the way between it and the tracker",
    PoseStatus.STALE: "Check that the tracker measures; start it again if it does",
    PoseStatus.DISABLED: "Plug the tool in, or correct its number or definition in the URL",
    PoseStatus.FAULT: "Clear the condition that the tracker reports",
    PoseStatus.NOT_UNDERSTOOD: "Check the transform that the sender computes for this tool: it must be rigid, in mm",
}


def _print(rows: list[Row]) -> None:
    language = cart_language()
    for name, text in rows:
        parts = text.split("; ") if name == "tools" else [text]
        told = "; ".join(device_text(part, language) for part in parts)
        click.echo(f"{device_text(name, language) + ':':<22}{told}")


def _say(text: str, mark: str = "") -> None:
    click.echo(f"{mark}{device_text(text, cart_language())}")


def _say_failed(word: str, error: ProbewatchError) -> None:
    """Prints in a word how it ended, and why, in the language of the cart as far as the error has a translation."""
    tell_refused(error, cart_language())
    click.echo(f"{device_text(word, cart_language())}: {error}")
