"""A black box says again what was said live, bit for bit; where it cannot, it says so and why."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.core.exact_fields import verdict_fields
from probewatch.appliance.limits import Limits
from probewatch.appliance.storage.black_box import BlackBox, BlackBoxWriter, Series, series_of
from probewatch.appliance.storage.black_box_fields import Gap
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.appliance.types import Verdict, VerdictKind
from probewatch.drivers.samples import Frame, Pose
from probewatch.drivers.twins.faults import Schedule
from probewatch.drivers.twins.scene.world import WorldSettings
from probewatch.tools.shared.rerun import Comparison, Rerun
from tests.support.black_boxes import begun, record
from tests.support.sessions import kept, session

SMALL = WorldSettings(width_px=400, height_px=300, scale_mm_per_px=(0.09, 0.08))
FLIP = '[{"fault": "flip-lateral", "from_s": 11.0, "to_s": null}]'


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Verdict]]:
    """Twelve seconds, in which a picture is verified and then mirrored."""
    world = kept(3, settings=SMALL)
    reference = calibration_from_image_to_probe(world.image_to_probe, (400, 300))
    path = tmp_path_factory.mktemp("box") / "session.mcap"
    return path, record(
        path, EstimatorSettings(1, reference, Limits(), 500_000_000), session(world, 12.0, Schedule.parse(FLIP))
    )


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Verdict]]:
    """Four seconds, for what needs no verification."""
    world = kept(3, settings=SMALL)
    reference = calibration_from_image_to_probe(world.image_to_probe, (400, 300))
    path = tmp_path_factory.mktemp("box") / "short.mcap"
    return path, record(path, EstimatorSettings(1, reference, Limits(), 500_000_000), session(world, 4.0))


def rerun(*paths: Path) -> tuple[Comparison, list[Verdict]]:
    run = Rerun(Series([BlackBox(path) for path in paths]))
    again = [verdict for step in run.steps() for verdict in step.verdicts]
    return run.comparison, again


@pytest.mark.thorough
def test_the_same_verdicts_come_again_bit_for_bit(recorded: tuple[Path, list[Verdict]]) -> None:
    path, live = recorded
    comparison, again = rerun(path)
    assert [json.dumps(verdict_fields(one)) for one in again] == [json.dumps(verdict_fields(one)) for one in live]
    assert comparison.exact
    assert (comparison.recorded, comparison.equal) == (len(live), len(live))
    assert {one.kind for one in live} == set(VerdictKind), "the session shows every kind"
    assert "bit for bit" in comparison.sentence


@pytest.mark.thorough
def test_a_file_that_was_cut_says_the_same_up_to_the_cut(short: tuple[Path, list[Verdict]], tmp_path: Path) -> None:
    path, live = short
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[: path.stat().st_size * 3 // 5])
    series = Series([BlackBox(cut)])
    run = Rerun(series)
    for _ in run.steps():
        pass
    assert run.comparison.exact
    assert 0 < run.comparison.recorded < len(live)
    assert "ends at byte" in series.damage_text


def rewritten(path: Path, target: Path, change) -> Path:
    """change: (told items) → items to write."""
    with target.open("wb") as stream:
        first, *rest = BlackBox(path).items()
        writer = BlackBoxWriter(stream, first.item)
        for item, now_ns in change(rest):
            writer.put(item, now_ns)
        writer.finish()
    return target


@pytest.mark.thorough
def test_a_picture_that_is_missing_is_told_as_the_cause(short: tuple[Path, list[Verdict]], tmp_path: Path) -> None:
    def without_some(rest):
        frames = [k for k, told in enumerate(rest) if isinstance(told.item, Frame)]
        lost = frames[100]
        return [*rest[:lost], (Gap("slow disk", 1), rest[lost].now_ns), *rest[lost + 1 :]]

    comparison, _ = rerun(rewritten(short[0], tmp_path / "gap.mcap", without_some))
    assert comparison.recorded == comparison.equal == 100, "up to the gap"
    assert comparison.without_past == 120 - comparison.recorded
    assert comparison.equal_anyway < comparison.without_past
    assert "gaps: 1" in comparison.sentence


@pytest.mark.thorough
def test_one_bit_of_one_verdict_is_seen(short: tuple[Path, list[Verdict]], tmp_path: Path) -> None:
    def spoiled(rest):
        measured = [
            (k, place)
            for k, told in enumerate(rest)
            if isinstance(told.item, Verdict)
            for place, check in enumerate(told.item.checks)
            if check.sigma > 0
        ]
        last, place = measured[-1]
        verdict = rest[last].item
        check = verdict.checks[place]
        nudged = replace(check, sigma=check.sigma * (1 + 2**-52))
        checks = (*verdict.checks[:place], nudged, *verdict.checks[place + 1 :])
        rest[last] = replace(verdict, checks=checks), rest[last].now_ns
        return rest

    comparison, _ = rerun(rewritten(short[0], tmp_path / "bit.mcap", spoiled))
    assert comparison.equal == comparison.recorded - 1
    assert "sigma of" in comparison.difference


def parts(path: Path, folder: Path) -> list[Path]:
    """The same as three files of one session, each of which begins with what it needs to be read alone."""
    _, (made, _), *rest = BlackBox(path).items()
    third = len(rest) // 3
    found = []
    for part in (1, 2, 3):
        found.append(folder / f"part-{part}.mcap")
        mine = rest[(part - 1) * third : part * third if part < 3 else None]
        with found[-1].open("wb") as stream:
            writer = BlackBoxWriter(stream, begun(mine[0].now_ns, part=part))
            step = sum(isinstance(told.item, Frame | Pose) for told in rest[: (part - 1) * third])
            for item, now_ns in ((replace(made, step=step), mine[0].now_ns), *mine):
                writer.put(item, now_ns)
            writer.finish()
    return found


@pytest.mark.thorough
def test_parts_of_a_session_are_one_recording(short: tuple[Path, list[Verdict]], tmp_path: Path) -> None:
    first, second, third = parts(short[0], tmp_path)
    (series,) = series_of([BlackBox(third), BlackBox(first), BlackBox(second)])
    run = Rerun(series)
    assert sum(len(step.verdicts) for step in run.steps()) == len(short[1])
    assert run.comparison.exact
    assert len(run.settings) == 1


@pytest.mark.thorough
def test_a_missing_part_and_a_late_beginning_are_told(short: tuple[Path, list[Verdict]], tmp_path: Path) -> None:
    first, second, third = parts(short[0], tmp_path)
    comparison, _ = rerun(first, third)
    assert comparison.gaps == ["a part of the recording is missing or damaged"]
    assert 0 < comparison.recorded == comparison.equal
    assert comparison.without_past > 0
    comparison, _ = rerun(second)
    assert comparison.recorded == 0
    assert "amid" in comparison.sentence
