"""Jobs on the cores of this machine, or on any cluster, by dask.distributed.

A worker is a process that does one job at a time. A job whose function raises, whose worker dies, or that takes longer
than its limit is done a second time; then it has failed, and the others go on.
"""

import faulthandler
import importlib.util
import logging
import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count, islice
from typing import Generic, TypeVar
from uuid import uuid4

import dask
from distributed import Client, Future, KilledWorker, LocalCluster, as_completed, get_worker
from distributed.utils import silence_logging_cmgr

Job = TypeVar("Job")
Result = TypeVar("Result")

ATTEMPTS = 2
LIMIT_S = 600.0
"""Wall time of a job."""
_BEGUN = "courier-begun"
"""The scheduler's topic of events that says when each attempt began."""
_LOST = ("pending", "lost")
"""States of a result whose worker died before anybody had it: it is computed again."""
_LOCAL = {
    "distributed.scheduler.allowed-failures": ATTEMPTS - 1,
    "distributed.comm.timeouts.connect": "60s",  # workers load compiled code meanwhile
    # A worker that dies starts anew. dask looks once, so long after each death, and gives up who is away just then.
    "distributed.deploy.lost-worker-timeout": "365 days",
}


class EngineError(Exception):
    """A cluster that can't be used; the text says why."""


@dataclass(frozen=True, slots=True)
class Failed:
    """In place of the result of a job that failed in all attempts."""

    why: str


@dataclass(frozen=True, slots=True)
class Done(Generic[Job, Result]):
    job: Job
    result: Result | Failed


@contextmanager
def cluster(scheduler: str | None = None, workers: int | None = None) -> Iterator[Client]:
    """The cluster of a scheduler's address, as "tcp://10.0.0.1:8786"; without one, workers of this machine, one a core.

    The local cluster listens on loopback alone. It has a dashboard where bokeh is installed. Raises EngineError.
    """
    if scheduler is not None:
        with silence_logging_cmgr(logging.CRITICAL):  # that the scheduler has gone is one line of ours, pages of dask's
            try:
                client = Client(scheduler, timeout="20s")
            except (OSError, ValueError) as error:
                raise EngineError(f"{scheduler}: no scheduler answers ({error})") from error
            except (TypeError, RuntimeError, ImportError) as error:  # of the scheme: no certificates, no such library
                raise EngineError(f"{scheduler}: dask can't use this address here ({error})") from error
            with client:
                yield client
        return
    with (
        dask.config.set(_LOCAL),
        LocalCluster(
            n_workers=workers or os.cpu_count(),
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        ) as local,
        Client(local) as client,
    ):
        yield client


def dashboard(client: Client) -> str | None:
    """The address of the scheduler's dashboard; None without bokeh, by which it draws."""
    return str(client.dashboard_link) if importlib.util.find_spec("bokeh") is not None else None


def slots(client: Client) -> int:
    """Number of jobs that can be done at a time. Raises EngineError for workers that do several in one process."""
    threads: dict[str, int] = client.nthreads()
    if any(each != 1 for each in threads.values()):
        raise EngineError("a worker has more than one thread: start workers with --nthreads 1")
    return len(threads)


def as_they_end(
    client: Client, function: Callable[[Job], Result], jobs: Iterable[Job], limit_s: float = LIMIT_S
) -> Iterator[list[Done[Job, Result]]]:
    """Do jobs; yields what has ended, as soon as anything has. A job is taken when a worker is free for it.

    Raises EngineError if the scheduler goes away.
    """
    todo, run = iter(jobs), uuid4().hex[:8]
    numbers = count()
    flying: dict[Future, Job] = {}
    waiting = as_completed()

    def fill() -> None:
        # no job waits at a worker: those that do would be suspected with the one that kills it
        for job in islice(todo, max(slots(client), 1, len(flying)) - len(flying)):
            key = f"flight-{run}-{next(numbers)}"
            future = client.submit(_limited, function, job, key, limit_s, key=key, pure=False, retries=ATTEMPTS - 1)
            flying[future] = job
            waiting.add(future)

    try:
        fill()
        while flying:
            batch = waiting.next_batch()
            again = [future for future in batch if future.status in _LOST]
            waiting.update(again)
            ended: list[Done[Job, Result]] = [
                Done(flying.pop(future), _result(client, future, limit_s)) for future in batch if future not in again
            ]
            del batch, again  # the scheduler forgets them
            fill()
            if ended:
                yield ended
    finally:
        client.cancel(list(flying), force=True)


def in_order(client: Client, function: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[Result]:
    """The results in the order of the jobs. Raises what the function raises."""
    futures = client.map(function, jobs, pure=False)
    while futures:
        yield futures.pop(0).result()


def on_all_cores(function: Callable[[Job], Result], jobs: Iterable[Job]) -> Iterator[Result]:
    """The same on this machine."""
    with cluster() as client:
        yield from in_order(client, function, list(jobs))


def _limited(function: Callable[[Job], Result], job: Job, key: str, limit_s: float) -> Result:
    """Do a job. After its limit a thread that needs no interpreter ends the process,
    whatever hangs in it, and says on standard error where it hung."""
    get_worker().log_event(_BEGUN, key)
    faulthandler.dump_traceback_later(min(limit_s, threading.TIMEOUT_MAX), exit=True, file=2)
    try:
        return function(job)
    finally:
        faulthandler.cancel_dump_traceback_later()


def _result(client: Client, future: Future, limit_s: float) -> "Result | Failed":
    if future.status == "finished":
        result: Result = future.result()
        return result
    if future.status != "error":
        raise EngineError("the scheduler has gone")
    error = future.exception()
    if not isinstance(error, KilledWorker):
        return Failed(f"raised {error!r}")
    began = max((at for at, key in client.get_events(_BEGUN) if key == future.key), default=time.time())
    return Failed(f"no end after {limit_s:g} s" if time.time() - began >= limit_s else "its worker died")
