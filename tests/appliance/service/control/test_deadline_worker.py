"""What the tick asks of files: a pipe that nobody writes is a disk that does not answer."""

import os
import time
from pathlib import Path

import pytest

from probewatch.appliance.service.control.deadline_worker import DeadlineWorker
from probewatch.appliance.service.control.server import ControlRefused
from probewatch.drivers.errors import ConfigurationError
from tests.support.polling import until
from tests.support.stopwatch import Stopwatch

TICK_MAY_BE_LATE_S = 0.2


def test_what_is_found_or_wrong_comes_back(tmp_path: Path) -> None:
    worker, file = DeadlineWorker(), tmp_path / "file"
    file.write_text("found")
    assert worker.run("file", file.read_text) == "found"

    def refuse() -> None:
        raise ConfigurationError("is no calibration", "file", "Give another")

    with pytest.raises(ConfigurationError, match="is no calibration"):
        worker.run("file", refuse)


def test_a_file_that_does_not_answer_is_named_once_waited_for_and_later_refused_at_once(tmp_path: Path) -> None:
    worker, pipe = DeadlineWorker(), tmp_path / "pipe"
    os.mkfifo(pipe)
    watch = Stopwatch()
    with pytest.raises(ControlRefused, match=f"{pipe} does not answer"):
        worker.run(str(pipe), pipe.read_text)
    assert watch.spent_s() < TICK_MAY_BE_LATE_S
    cpu_s = time.thread_time()
    for _ in range(100):
        with pytest.raises(ControlRefused, match=f"{pipe} still does not answer"):
            worker.run("another", lambda: "found")
    assert time.thread_time() - cpu_s < TICK_MAY_BE_LATE_S
    pipe.write_text("found at last")

    def again() -> str:
        try:
            return worker.run("another", lambda: "found")
        except ControlRefused:
            return ""

    assert until(again) == "found"
