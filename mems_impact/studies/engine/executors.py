"""Executors of chunks: threads, processes, Dask.

A task is a function of this module and plain values, so that it goes to any process that has the
package. A study is pickled once, and unpickled once by each worker.
"""

from __future__ import annotations

import logging
import math
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from contextlib import contextmanager, nullcontext
from functools import cache, cached_property, lru_cache
from itertools import count
from types import TracebackType
from typing import Any, Self

import cloudpickle

from mems_impact._util.progress import Watch
from mems_impact._util.warning_scopes import CollectedWarning, collected_warnings
from mems_impact.errors import InvalidParameter
from mems_impact.studies.engine.study import Chunk, Columns, Study

__all__ = [
    "ExecutorLost",
    "Result",
    "WorkerPool",
    "cores",
    "ctrl_c_for_us_alone",
    "killed_by_its_chunk",
    "stoppable_threads",
]

# --- Threads whose runs end as soon as nobody waits for them any more.


class _ThreadStopped(Exception):
    """Ends a run whose result nobody waits for."""


@contextmanager
def stoppable_threads(workers: int) -> Iterator[tuple[ThreadPoolExecutor, Watch]]:
    """Give an executor, and what every run in its threads is to call as its `progress`.

    Ctrl-C comes to the main thread alone, and an executor waits for what its threads do. So
    leaving the block, however that comes about, ends the runs and drops what waits for a thread.
    """
    stop = threading.Event()

    def watch(_: float) -> None:
        if stop.is_set():
            raise _ThreadStopped

    with ThreadPoolExecutor(workers) as executor:
        try:
            yield executor, watch
        finally:
            stop.set()
            executor.shutdown(wait=False, cancel_futures=True)


# --- Who computes the chunks of a study: threads here, or the workers of any executor.

_log = logging.getLogger("mems_impact")

Result = tuple[Columns, Any, list[CollectedWarning]]
Maker = Callable[[], Executor]

MIN_PENDING_CHUNKS = 16  # chunks under way where the workers are still to come, as of a cluster
WORKER_WAIT_SECONDS = 30.0  # s after which it is said that no worker has come
ASKED = 2.0  # s after which a cluster is asked anew how many it has


class ExecutorLost(Exception):
    """There are no workers any more, and no others can be had."""


class _Stopped(Exception):
    """Ends a chunk that nobody waits for."""


def cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def killed_by_its_chunk(error: BaseException) -> bool:
    """Return whether Dask says that several workers in succession died of one chunk."""
    scheduler: Any = sys.modules.get("distributed.scheduler")
    return scheduler is not None and isinstance(error, scheduler.KilledWorker)


class WorkerPool:
    """Computes parts of a study.

    Parameters
    ----------
    study : Study
    executor : Executor or callable, optional
        One that is there, and stays; or what makes one, which is made here, ended here, and made
        anew if its workers die. Threads of our own by default.
    workers : int, optional
        How many threads, or how many workers the executor has; as many as there are by default.
    """

    def __init__(self, study: Study, executor: Executor | Maker | None, workers: int | None):
        self.study = study
        self.workers = workers
        self._within: dict[int, float] = {}  # points done, of the parts under way
        self._make: Maker | None = None
        if executor is None:
            threads = (workers or cores()) if study.threaded else 1
            self._make = lambda: ThreadPoolExecutor(threads)
        elif callable(executor):
            self._make = executor
        elif not isinstance(executor, Executor):
            allowed = "a concurrent.futures.Executor, or a function that makes one"
            raise InvalidParameter("executor", executor, allowed)
        self._executor: Any = None if callable(executor) else executor
        self._stop = threading.Event()
        self._asked = (-ASKED, 0)
        self._heard = math.inf  # when it is looked for workers that should have come
        self._calls = count()

    def __enter__(self) -> Self:
        if self._make is not None:
            self._executor = self._made(self._make)
        if self.is_local:
            with collected_warnings():  # of whose motions nothing is told
                self.study.prepare()
        self._heard = time.monotonic() + WORKER_WAIT_SECONDS
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        if self._make is not None:
            _end(self._executor, at_once=error is not None)

    @property
    def is_local(self) -> bool:
        """Whether the workers are threads of this process, which hear when they are to stop."""
        return isinstance(self._executor, ThreadPoolExecutor)

    @property
    def window(self) -> int:
        """How many parts are given out at a time: enough that no worker waits for the next."""
        known = self.workers or getattr(self._executor, "_max_workers", None)
        if known is None:
            now, known = time.monotonic(), self._asked[1]
            if now - self._asked[0] >= ASKED:
                known = _threads_of_cluster(self._executor)
                self._asked = now, known
            return max(MIN_PENDING_CHUNKS, 2 * known + 1)
        return int(2 * known + 1)

    def submit(self, number: int, part: Chunk, carried: Any) -> Future[Result]:
        """Give out a part; `ExecutorLost` if nobody takes it."""
        where = part.first, part.last, carried
        try:
            if self.is_local:
                return self._executor.submit(_here, self.study, *where, self._watch(number))
            with ctrl_c_for_us_alone():  # for processes that are started now
                # Numbered, since Dask takes a second call with the same arguments for the first.
                return self._executor.submit(_there, self._packed, *where, next(self._calls))
        except (RuntimeError, OSError) as error:
            # RuntimeError: broken, or shut down by others. OSError: a pool that starts a worker
            # while another one dies finds its queue closed; or the system starts no process.
            raise ExecutorLost(str(error)) from None

    def say_if_nobody_comes(self) -> None:
        """Say once, after a while, that a cluster has no workers: nothing else would tell."""
        if time.monotonic() < self._heard:
            return
        self._heard = math.inf
        client = getattr(self._executor, "_client", None)
        if client is not None and not client.nthreads():
            _log.warning("waiting for workers: the cluster has none; its own log tells why")

    @property
    def part_done(self) -> float:
        """Points that are done of the parts under way, as far as that can be told."""
        return sum(list(self._within.values()))

    def forget(self, number: int) -> None:
        """Forget what was told of a part that is not under way any more."""
        self._within.pop(number, None)

    def is_lost(self, error: BaseException) -> bool:
        """Return whether an error says that a worker was lost, rather than that a point fails."""
        if isinstance(error, KeyboardInterrupt):
            return not self.is_local  # somebody has interrupted a worker
        return isinstance(error, BrokenExecutor | CancelledError) or killed_by_its_chunk(error)

    def renew(self, reason: str) -> None:
        """Make the executor anew; `ExecutorLost` if that fails, or if its workers die at once."""
        if self._make is None:
            raise ExecutorLost(reason)
        _end(self._executor, at_once=True)
        self._executor = self._made(self._make)
        try:
            if self.is_local:
                self._executor.submit(int).result()
            else:
                with ctrl_c_for_us_alone():
                    trial = self._executor.submit(_ready, self._packed)
                trial.result()
        except (BrokenExecutor, CancelledError, OSError) as error:
            raise ExecutorLost(f"they die before they compute anything: {error}") from None

    @cached_property
    def _packed(self) -> bytes:
        try:
            packed: bytes = cloudpickle.dumps(self.study)
        except Exception as error:  # what an object raises that cannot be pickled may be anything
            problem = f"the study cannot go to other processes ({error}); leave executor out"
            raise InvalidParameter("executor", None, "", problem=problem) from error
        return packed

    def _made(self, make: Maker) -> Executor:
        executor = make()
        if not isinstance(executor, Executor):
            allowed = "a function that returns a concurrent.futures.Executor"
            raise InvalidParameter("executor", executor, allowed)
        return executor

    def _watch(self, number: int) -> Callable[[float], None]:
        def watch(done: float) -> None:
            if self._stop.is_set():
                raise _Stopped
            self._within[number] = done

        return watch


def _threads_of_cluster(executor: Any) -> int:
    """Return how many threads Dask's workers have at present; 0 of an unknown kind of executor."""
    client = getattr(executor, "_client", None)
    return sum(client.nthreads().values()) if client is not None else 0


def _end(executor: Executor, *, at_once: bool) -> None:
    """End an executor of our own; left alone, it would wait for what is being computed."""
    if at_once and isinstance(executor, ProcessPoolExecutor):
        for process in list((executor._processes or {}).values()):
            process.kill()
    threads = isinstance(executor, ThreadPoolExecutor | ProcessPoolExecutor)
    if threads:
        executor.shutdown(cancel_futures=True)
    else:
        executor.shutdown(wait=not at_once)


@contextmanager
def ctrl_c_for_us_alone() -> Iterator[None]:
    """Let processes that are started in the block be deaf to Ctrl-C, which a terminal sends to all.

    They would answer with tracebacks; it is for this process to end them.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


# What workers do.

_preparing = threading.Lock()  # a process may have several threads that compute
_alone = threading.Lock()  # held by what no other thread may compute beside


def _here(
    study: Study, first: int, last: int, carried: Any, watch: Callable[[float], None]
) -> Result:
    """Compute points in a thread of the process that waits for them."""
    with nullcontext() if study.threaded else _alone:
        watch(0.0)
        return _computed(study, first, last, carried, watch)


def _there(packed: bytes, first: int, last: int, carried: Any, _call: int) -> Result:
    """Compute points in another process."""
    _ready(packed)
    study = _unpacked(packed)
    with nullcontext() if study.threaded else _alone:
        return _computed(study, first, last, carried, None)


def _computed(
    study: Study, first: int, last: int, carried: Any, watch: Callable[[float], None] | None
) -> Result:
    """Return what is computed of points, and what is told of them."""
    with collected_warnings() as told:
        columns, carried = study.compute(first, last, carried, watch)
    return columns, carried, told


def _ready(packed: bytes) -> None:
    """Do all that is done once in a process."""
    _end_with_parent(os.getpid())
    with _preparing:
        _unpacked(packed)


@lru_cache(4)
def _unpacked(packed: bytes) -> Study:
    study: Study = pickle.loads(packed)
    with collected_warnings():
        study.prepare()
    return study


@cache
def _end_with_parent(_process: int) -> None:
    """Let this process end when its parent does: a pool's would wait for work forever."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
