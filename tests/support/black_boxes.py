"""Black boxes of simulated sessions: a line runs, and everything is recorded as it is on a cart."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.core.line import Line
from probewatch.appliance.storage.black_box import FORMAT, BlackBoxWriter
from probewatch.appliance.storage.black_box_fields import Begun, Item, Made, State
from probewatch.appliance.types import Verdict
from probewatch.drivers.samples import Sample


def begun(t_ns: int, session: str = "test", part: int = 1, text: str = "kept") -> Begun:
    """The first message of a file."""
    return Begun(FORMAT, "probewatch test", "2026-01-02T03:04:05+00:00", t_ns, session, part, ("sim:test",), text)


def record(
    path: Path,
    settings: EstimatorSettings,
    samples: Iterable[Sample],
    finish: bool = True,
    told: Mapping[int, Mapping[str, Any]] | None = None,
) -> list[Verdict]:
    """A line works while it is recorded; what it said. told: number of a sample → the status that came with it."""
    line, said = Line(settings.reference, settings.limits, settings.stale_ns), list[Verdict]()
    first, *rest = samples
    with path.open("wb") as stream:
        writer = BlackBoxWriter(stream, begun(first.stamp.t_ns))
        writer.put(Made(settings, 0), first.stamp.t_ns)
        for number, sample in enumerate((first, *rest)):
            if told is not None and number in told:
                writer.put(State(told[number]), sample.stamp.t_ns)
            verdicts = line.step(sample)
            items: list[Item] = [sample, *verdicts]
            for item in items:
                writer.put(item, sample.stamp.t_ns)
            said += verdicts
        if finish:
            writer.finish()
    return said
