"""Runs tasks beside one another: in processes of this computer, or on a Dask cluster that exists already."""

import logging
import multiprocessing
import signal
import time
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import CancelledError, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from probewatch.appliance.service.host.child_process import end_with_parent
from probewatch.drivers.errors import ConfigurationError, DeviceLost
from probewatch.tools.study.table import INSTALL

_T = TypeVar("_T")
_R = TypeVar("_R")

_ANSWER_S = 10
"""Seconds for a scheduler to answer: one in the same building does within a second."""
_LOOK_S = 15.0
"""Seconds without a result until the scheduler is asked whether it still answers: its connection outlives one that
hangs. More notices that later, less asks one whose tasks are long. Not measured."""
_POLL_S = 0.02
"""Seconds between two looks for a result; a task takes a second or more."""
_FIRST_WAIT_S, _LONGEST_WAIT_S = 1.0, 30.0
"""Seconds before a scheduler that has gone is tried again, doubled each time. More notices later that it is back, less
tries to connect more often."""

Say = Callable[[str], None]


def results(
    work: Callable[[_T], _R], tasks: Iterable[_T], jobs: int, scheduler: str | None, say: Say = lambda _: None
) -> Generator[_R, None, None]:
    """Yields work(task) of every task, in the order in which they end. Raises DeviceLost where a worker died, or where
    the scheduler did not answer in the first place; one that vanishes or hangs later is reported to `say`, waited for,
    and given again what it had not done. Raises what work raises. Where it raises, or is closed before its end, the
    processes of this computer are killed.
    """
    return _local(work, list(tasks), jobs) if scheduler is None else _remote(work, list(tasks), scheduler, say)


def _local(work: Callable[[_T], _R], tasks: list[_T], jobs: int) -> Generator[_R, None, None]:
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(jobs, mp_context=context, initializer=_begin) as pool:
        try:
            # In order, so that tasks on the same pictures follow one another in one process, which keeps them.
            futures = [pool.submit(work, task) for task in tasks]
            for future in as_completed(futures):
                yield future.result()
        except BaseException as error:
            # Otherwise the pool would wait for the tasks that its workers have begun.
            for worker in set(multiprocessing.active_children()) - others:
                worker.kill()
            if isinstance(error, BrokenProcessPool):
                remedy = "Too little memory? Give --jobs 1; what is done stays, so start it again"
                raise DeviceLost("a worker process died", "study", remedy) from error
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _begin() -> None:
    """Makes a worker end with its parent, which alone decides what Ctrl-C ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent(signal.SIGKILL)


def _remote(work: Callable[[_T], _R], tasks: list[_T], scheduler: str, say: Say) -> Generator[_R, None, None]:
    try:
        import distributed  # noqa: PLC0415  an extra that a cart does not have
    except ImportError:
        remedy = INSTALL
        raise ConfigurationError("needs the package distributed", f"--scheduler {scheduler}", remedy) from None
    try:
        client = distributed.Client(scheduler, timeout=_ANSWER_S)
    except (OSError, ValueError) as error:
        raise DeviceLost(
            f"does not answer: {error}", scheduler, "Start the Dask scheduler, or check the address"
        ) from error
    # It writes tracebacks when a connection ends; the user gets that information in words.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    left = dict(enumerate(tasks))
    while True:
        with client:
            ended = yield from _until_lost(distributed, client, work, left)
        if not left:
            return
        say(f"the scheduler at {scheduler} {ended}; {len(left)} of {len(tasks)} are left; trying again")
        client = _again(distributed, scheduler)
        say(f"the scheduler at {scheduler} is back")


def _until_lost(
    distributed: Any, client: Any, work: Callable[[_T], _R], left: dict[int, _T]
) -> Generator[_R, None, str]:
    """Yields the result of each task, which is taken from `left`, until all are done or the scheduler is lost; returns
    how it was lost, in words. Raises DeviceLost for a task that kills its workers.
    """
    futures = {client.submit(work, task, pure=False): number for number, task in left.items()}
    done, heard_s = distributed.as_completed(list(futures)), time.monotonic()
    while not done.is_empty():
        if not done.has_ready():
            if time.monotonic() - heard_s > _LOOK_S:
                if not _answers(client):
                    return "hangs"
                heard_s = time.monotonic()
            time.sleep(_POLL_S)
            continue
        future, heard_s = next(done), time.monotonic()
        try:
            result = future.result()
        except CancelledError:
            return "has gone"
        except distributed.KilledWorker as error:
            remedy = "Too little memory? What is done stays, so start it again with larger workers"
            raise DeviceLost("a task has ended every worker that tried it", "study", remedy) from error
        del left[futures[future]]
        yield result
    return ""


def _answers(client: Any) -> bool:
    try:
        client.sync(client.scheduler.identity, callback_timeout=_ANSWER_S)
    except (OSError, ValueError):
        return False
    return True


def _again(distributed: Any, scheduler: str) -> Any:
    """Returns a client of the scheduler, once it is back."""
    wait_s = _FIRST_WAIT_S
    while True:
        time.sleep(wait_s)
        wait_s = min(2 * wait_s, _LONGEST_WAIT_S)
        try:
            return distributed.Client(scheduler, timeout=_ANSWER_S)
        except (OSError, ValueError):
            continue
