"""Runs tasks beside one another: in processes of this computer, or on a Dask cluster that exists already."""

import multiprocessing
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from appliance.service.host.child_process import end_with_parent
from drivers.errors import ConfigurationError, DeviceLost

_T = TypeVar("_T")
_R = TypeVar("_R")

_ANSWER_S = 10
"""For a scheduler to answer: one in the same building does within a second."""


def results(work: Callable[[_T], _R], tasks: Iterable[_T], jobs: int, scheduler: str | None) -> Iterator[_R]:
    """work(task) of every task, in the order in which they end. Raises DeviceLost where a worker died, and what work
    raises.
    """
    return _local(work, list(tasks), jobs) if scheduler is None else _remote(work, list(tasks), scheduler)


def _local(work: Callable[[_T], _R], tasks: list[_T], jobs: int) -> Iterator[_R]:
    context = multiprocessing.get_context("spawn")
    # In order, so that tasks on the same pictures follow one another in one process, which keeps them.
    with ProcessPoolExecutor(jobs, mp_context=context, initializer=end_with_parent, initargs=(signal.SIGKILL,)) as pool:
        futures = [pool.submit(work, task) for task in tasks]
        try:
            for future in as_completed(futures):
                yield future.result()
        except BrokenProcessPool as error:
            remedy = "Too little memory? Give --jobs 1; what is done stays, so start it again"
            raise DeviceLost("a worker process died", "study", remedy) from error
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _remote(work: Callable[[_T], _R], tasks: list[_T], scheduler: str) -> Iterator[_R]:
    try:
        import distributed  # noqa: PLC0415  an extra that a cart does not have
    except ImportError:
        remedy = "Install it: pip install 'probewatch[study]'"
        raise ConfigurationError("needs the package distributed", f"--scheduler {scheduler}", remedy) from None
    try:
        client = distributed.Client(scheduler, timeout=_ANSWER_S)
    except (OSError, ValueError) as error:
        raise DeviceLost(
            f"does not answer: {error}", scheduler, "Start the Dask scheduler, or check the address"
        ) from error
    with client:
        for future in distributed.as_completed(client.map(work, tasks, pure=False)):
            yield future.result()
