"""`probewatch study` as people use it: rendered sessions, real files, processes, a Dask cluster, bad input."""

import csv
import os
import signal
from contextlib import contextmanager

import numpy as np
import pytest

from probewatch.appliance.limits import NAMED_NATS, WITHDRAWN_NATS
from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.appliance.types import PARAMETERS, Calibration
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from probewatch.drivers.recordings.replay import open_recording
from probewatch.drivers.samples import Pose
from probewatch.tools.study import workers
from probewatch.tools.study.hazard import Hazard
from probewatch.tools.study.metal import distorted
from probewatch.tools.study.outcome import run
from probewatch.tools.study.plan import Task, planned, tasks
from probewatch.tools.study.samples import KEYS, WITHOUT_OFFSETS, Conditions, rendered, samples
from probewatch.tools.study.session import Session
from probewatch.tools.study.table import StudyTable
from probewatch.tools.study.workers import results
from tests.support.answers import answered
from tests.support.kept_pictures import sessions
from tests.support.recordings import items

SHORT = Session("in-plane", "still", 1, 10.0)


def outcome(hazard="none"):
    return run(Conditions(SHORT, Hazard.parse(hazard), asked=WITHOUT_OFFSETS), rendered(SHORT, sessions()))


@pytest.mark.thorough
def test_a_healthy_sweep_is_verified_and_its_figures_are_near_the_truth():
    told = outcome()
    assert (told.frames, told.faults, told.warnings) == (300, "", 0)
    assert told.closed > 0.6
    assert told.nats < WITHDRAWN_NATS
    assert 0 < told.closed_s < 4
    assert 0 < told.cost_ms <= told.cost_99_ms
    scale = told.scores["scale-lateral"]
    assert abs(scale.last) < 5 * scale.sigma
    assert 0.5 * scale.bound < scale.sigma
    row = told.row()
    assert row["scale-lateral last"]
    assert not {"nan", "inf"} & set(row.values())


@pytest.mark.thorough
@pytest.mark.parametrize("tissue", ["still", "breathing"])
def test_the_gesture_alone_shows_everything_that_can_be_asked_for(tissue):
    session = Session("gesture", tissue, 1, 8.0)
    told = run(Conditions(session), rendered(session, sessions()))
    assert (told.faults, told.closed_s <= 6.0) == ("", True)
    assert all(told.scores[name].shown for name in PARAMETERS)
    assert all(abs(told.scores[name].last) < 4 * told.scores[name].sigma for name in PARAMETERS)


@pytest.mark.thorough
@pytest.mark.parametrize(("hazard", "fault"), [("flip-lateral@start", "polarity"), ("depth=-10@start", "scale")])
def test_what_is_wrong_from_the_start_is_named_and_never_told_ok(hazard, fault):
    told = outcome(hazard)
    assert told.faults.split()[0] == fault
    assert told.fault_s < 8
    assert fault == "polarity" or told.nats > NAMED_NATS, "the sequential test does not weigh mirrors"
    assert (told.ok_gross_s, told.closed_gross_s) == (0, 0)


@pytest.mark.thorough
def test_a_rendered_session_is_a_recording_and_is_taken_from_there(tmp_path):
    rendered(SHORT, tmp_path)
    (path,) = tmp_path.iterdir()
    recording = open_recording(path)
    assert (recording.size_px, len(recording.frame_order)) == ((400, 300), 300)
    rendered.cache_clear()
    before = path.stat().st_mtime_ns
    pictures = rendered(SHORT, tmp_path)
    assert path.stat().st_mtime_ns == before
    assert np.array_equal(pictures[7], SHORT.world.frame_at(SHORT.pictures(np.array([7 / 30]))[0], 7))


def test_a_plan_is_every_run_once_and_what_is_done_is_left_out():
    hazards = [Hazard(), *(Hazard("latency", float(size)) for size in range(100, 106))]
    plan = planned(("hold", "fan"), ("still", "breathing"), 3, (0.1, 0.25), hazards, draws=2)
    assert len(plan) == len({one.key for one in plan}) == 2 * 2 * 3 * 2 * 2 * 7
    left = list(tasks(plan, {plan[0].key}, None))
    assert [run for task in left for run in task.runs] == plan[1:]
    assert all(len({run.session for run in task.runs}) == 1 for task in left)


def test_another_draw_is_another_noise_on_the_same_pictures():
    session = Session("hold", "still", 1, 1.0)
    pictures = [np.zeros((300, 400), np.uint8)] * 30
    first, second = ([*samples(Conditions(session, draw=draw), pictures)] for draw in (1, 2))
    apart = [a.matrix[:3, 3] - b.matrix[:3, 3] for a, b in zip(first, second, strict=True) if isinstance(a, Pose)]
    assert np.std(apart) == pytest.approx(0.1 * np.sqrt(2), rel=0.3)
    assert np.linalg.norm(np.mean(apart, axis=0)) < 0.1


def _dies(task):
    os.kill(os.getpid(), signal.SIGKILL)


def _half(task):
    return task / 2


@pytest.mark.thorough
def test_a_worker_that_dies_ends_the_study_with_a_way_on():
    with pytest.raises(DeviceLost, match="a worker process died"):
        list(results(_dies, [1, 2], 1, None))


SMALL_PLAN = planned(("in-plane", "hold"), ("still",), 2, (0.1,), [Hazard(), Hazard.parse("latency=450@start")], 1.0)
OF_THIS_COMPUTER = {"cost_ms", "cost_99_ms"}
"""Columns that no two runs share."""


def told(rows):
    """Rows of a table, in any order, without what depends on the computer."""
    kept = [{name: cell for name, cell in row.items() if name not in OF_THIS_COMPUTER} for row in rows]
    return sorted(kept, key=lambda row: [row[name] for name in KEYS])


def table_of(path, scheduler=None, between=lambda count: None):
    """The table that a study of the small plan writes; between: called after so many tasks."""
    table = StudyTable(path, KEYS)
    for count, rows in enumerate(results(Task.rows, list(tasks(SMALL_PLAN, table.done, None)), 1, scheduler), 1):
        table.add(rows)
        between(count)
    return StudyTable(path, KEYS).rows


@contextmanager
def dask(workers):
    """(address, worker processes) of a scheduler with workers of its own, as a cluster has them."""
    from distributed import LocalCluster  # noqa: PLC0415  takes a second that other tests need not wait for

    options = {"threads_per_worker": 1, "processes": True, "dashboard_address": ":0"}
    with LocalCluster(n_workers=workers, **options) as cluster:
        yield cluster.scheduler_address, [worker.process.process for worker in cluster.workers.values()]


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_two_dask_workers_write_the_table_of_one_process_and_one_that_is_killed_loses_nothing(tmp_path):
    alone = told(table_of(tmp_path / "alone.csv"))
    assert len(alone) == len(SMALL_PLAN) == 8
    with dask(2) as (address, workers):
        assert told(table_of(tmp_path / "cluster.csv", address)) == alone

        def kill(count):
            if count == 1:
                os.kill(workers[0].pid, signal.SIGKILL)

        assert told(table_of(tmp_path / "killed.csv", address, kill)) == alone


def test_a_scheduler_that_is_not_there_is_named(monkeypatch):
    monkeypatch.setattr(workers, "_ANSWER_S", 1)
    with pytest.raises(DeviceLost, match=r"tcp://127\.0\.0\.1:9"):
        list(results(_half, [1], 1, "tcp://127.0.0.1:9"))


def study(*arguments):
    return answered("study", *(str(one) for one in arguments))


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (("--sessions", "walk"), "'walk' is none of in-plane"),
        (("--tissues", "dead"), "no part 'dead'"),
        (("--noise-mm", "0"), "not a list of .001 to 5 mm"),
        (("--noise-mm", "some"), "not a list of .001 to 5 mm"),
        (("--hazards", "bend"), "'bend' is not a known hazard"),
        (("--seeds", "0"), "not in the range"),
        (("--duration", "12", "--hazards", "depth=10@sudden"), "begins at 20 s, and the session ends at 12 s"),
        (("--profiles", "coarse,finer"), "'finer' is none of coarse, clinical, fine"),
        (("x.mha",), "x.mha: cannot be read: No such file"),
        ((__file__,), "RECORDINGs need --calibration"),
        ((__file__, "--seeds", "4"), "--seeds has no effect with RECORDINGs"),
        (("--calibration", "probe.toml"), "--calibration is of RECORDINGs"),
    ],
)
def test_bad_input_is_refused_by_name(tmp_path, arguments, what):
    answer = study(*arguments, "--output", tmp_path / "out")
    assert answer.returncode != 0
    assert what in answer.stderr


def test_an_output_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "out").write_text("mine")
    answer = study("--output", tmp_path / "out")
    assert answer.returncode != 0
    assert "out" in answer.stderr
    assert (tmp_path / "out").read_text() == "mine"


@pytest.mark.thorough
def test_an_archive_goes_on_past_a_recording_that_cannot_be_read(tmp_path):
    size_px = (48, 32)
    write_metaimage(tmp_path / "good.igs.mha", items(40, size_px), size_px)
    (tmp_path / "cut.igs.mha").write_bytes((tmp_path / "good.igs.mha").read_bytes()[:5000])
    reference = Calibration(np.eye(3), (1, 1), np.array([0.2, 0.2]), np.zeros(3), size_px)
    write_calibration(tmp_path / "probe.toml", reference, {})
    recordings = [tmp_path / "cut.igs.mha", tmp_path / "good.igs.mha"]
    arguments = (*recordings, "--calibration", tmp_path / "probe.toml", "--output", tmp_path / "out", "--jobs", 1)
    answer = study(*arguments)
    assert answer.returncode == 0, answer.stderr
    rows = list(csv.DictReader((tmp_path / "out/recordings.csv").read_text().splitlines()))
    assert [bool(row["error"]) for row in rows] == [True, False]
    assert (rows[1]["verdict"], rows[1]["frames"]) == ("NOT_VERIFIED", "40")
    assert "scale-lateral" in rows[1]["missing"]
    again = study(*arguments)
    assert (again.returncode, "2 of 2 recordings are in" in again.stdout) == (0, True)


@pytest.mark.thorough
def test_a_study_from_the_command_line_is_taken_up_again(tmp_path):
    arguments = ("--sessions", "in-plane,hold", "--tissues", "still", "--duration", 6, "--output", tmp_path)
    answer = study(*arguments, "--seeds", 1)
    assert answer.returncode == 0, answer.stderr
    assert "in-plane" in answer.stdout
    assert (tmp_path / "study.html").stat().st_size > 10_000
    answer = study(*arguments, "--seeds", 2)
    assert answer.returncode == 0, answer.stderr
    assert "2 of 4 runs are in" in answer.stdout
    rows = list(csv.DictReader((tmp_path / "study.csv").read_text().splitlines()))
    assert {(row["session"], row["seed"]) for row in rows} == {(s, k) for s in ("in-plane", "hold") for k in "12"}


@pytest.mark.thorough
def test_tasks_give_rows_with_the_names_of_their_runs():
    (row,) = Task((Conditions(SHORT),), sessions()).rows()
    assert (row["session"], row["tissue"], row["duration_s"], row["hazard"]) == ("in-plane", "still", "10", "none")


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [1, 2])
def test_another_probe_is_named_first_and_never_ok(seed):
    gesture = Session("gesture", "still", seed, 8.0)
    told = run(Conditions(gesture, Hazard.parse("exchanged-probe@start")), rendered(gesture, sessions()))
    assert told.faults.split()[0] == "exchanged-probe"
    assert told.fault_s < 8
    assert (told.ok, told.closed) == (0.0, 0.0)


@pytest.mark.thorough
def test_metal_that_bends_the_field_is_named_and_never_ok():
    gesture = Session("gesture", "still", 1, 15.0)
    told = run(Conditions(gesture, Hazard.parse("metal=6@start")), rendered(gesture, sessions()))
    assert told.faults.split()[0] == "field-distortion"
    assert (told.ok, told.closed) == (0.0, 0.0)


@pytest.mark.parametrize("most_mm", [3.0, -3.0])
def test_metal_displaces_by_what_is_asked_for_at_most_and_by_less_farther_off(most_mm):
    t_s = np.arange(0, 30, 1 / 30)
    session = Session("gesture", "still", 1, 30.0)
    poses = session.sensor(t_s, session.world.sensor_to_picture)
    seen = distorted(poses, most_mm, np.ones(t_s.size))
    error_mm = np.linalg.norm((seen - poses)[:, :3, 3], axis=1)
    assert error_mm.max() == pytest.approx(abs(most_mm))
    assert error_mm.min() < 0.8 * error_mm.max()
    assert np.allclose(seen[:, :3, :3] @ seen[:, :3, :3].transpose(0, 2, 1), np.eye(3))
    half = distorted(poses, most_mm, np.full(t_s.size, 0.5))
    assert np.allclose((half - poses)[:, :3, 3], (seen - poses)[:, :3, 3] / 2)


@pytest.mark.thorough
@pytest.mark.parametrize("beside", ["bend-lateral=6", "slide-axial=8"])
def test_a_second_fault_beside_a_late_tracker_is_named_from_pictures_to_contact_and_never_ok(beside):
    gesture = Session("gesture", "still", 1, 15.0)
    told = run(Conditions(gesture, Hazard.parse(f"latency=120@start/{beside}@start")), rendered(gesture, sessions()))
    assert told.named_s < 15
    assert (told.ok, told.closed) == (0.0, 0.0)
