"""Executors of chunks: threads, processes, Dask.

A task consists of a function of this module and plain values, so that any process with the package
can run it. A study is pickled once, and unpickled once by each worker.
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
from contextlib import contextmanager, nullcontext, suppress
from functools import cache, cached_property, lru_cache
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import cloudpickle

from mems_impact._util.ctrl_c import deferring_ctrl_c
from mems_impact._util.formatting import label
from mems_impact._util.progress import Watch
from mems_impact._util.warning_scopes import CollectedWarning, collected_warnings
from mems_impact.errors import InvalidParameter
from mems_impact.studies.engine.study import Chunk, Columns, Study

# --- Stoppable threads


class _Stopped(Exception):
    """Exception that ends a run or a chunk whose result is no longer needed."""


@contextmanager
def stoppable_threads(workers: int) -> Iterator[tuple[ThreadPoolExecutor, Watch]]:
    """Yield an executor, and the `progress` callback of runs in its threads.

    Only the main thread receives Ctrl-C, and an executor waits for its threads. So leaving the
    block for any reason ends the runs and discards queued ones.
    """
    stop = threading.Event()

    def watch(_: float) -> None:
        if stop.is_set():
            raise _Stopped

    with ThreadPoolExecutor(workers) as executor:
        try:
            yield executor, watch
        finally:
            stop.set()
            executor.shutdown(wait=False, cancel_futures=True)


# --- Workers

_log = logging.getLogger("mems_impact")

Result = tuple[Columns, Any, list[CollectedWarning]]
Maker = Callable[[], Executor]

MIN_PENDING_CHUNKS = 16  # pending chunks before the workers of a cluster have started
WORKER_WAIT_SECONDS = 30.0  # s after which a message states that no worker has started
QUERY_INTERVAL_SECONDS = 2.0  # s between two queries of the number of workers of a cluster


class ExecutorLost(Exception):
    """All workers are lost and cannot be replaced."""

    def __init__(self, reason: str, remedy: str = "") -> None:
        super().__init__(reason)
        self.remedy = remedy


def cores() -> int:
    """Return the number of cores available to this process."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def killed_by_its_chunk(error: BaseException) -> bool:
    """Return whether Dask reports that one chunk killed several workers in succession."""
    scheduler: Any = sys.modules.get("distributed.scheduler")
    return scheduler is not None and isinstance(error, scheduler.KilledWorker)


class WorkerPool:
    """Workers that compute parts of a study; own threads by default, as many as are available.

    An executor is not shut down. A function that makes an executor is called again if its workers
    die, and the pool shuts the executor down. `workers` is the number of threads, or of workers of
    the executor.
    """

    def __init__(self, study: Study, executor: Executor | Maker | None, workers: int | None):
        self.study = study
        self.workers = workers
        self._within: dict[int, float] = {}  # completed points of pending parts
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
        self._cluster_threads = (-QUERY_INTERVAL_SECONDS, 0)
        self._check_time = math.inf  # time of the check for workers that have not started
        self._calls = count()

    def __enter__(self) -> Self:
        if self._make is not None:
            self._executor = self._created(self._make)
        if self.is_local:
            with collected_warnings():  # discards warnings of the compilation run
                self.study.prepare()
        self._check_time = time.monotonic() + WORKER_WAIT_SECONDS
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
        """Whether the workers are threads of this process, which can be stopped."""
        return isinstance(self._executor, ThreadPoolExecutor)

    @property
    def window(self) -> int:
        """Number of parts to submit at a time, so that no worker is idle."""
        threads = self.workers or getattr(self._executor, "_max_workers", None)
        if threads is None:
            now, threads = time.monotonic(), self._cluster_threads[1]
            if now - self._cluster_threads[0] >= QUERY_INTERVAL_SECONDS:
                threads = _threads_of_cluster(self._executor)
                self._cluster_threads = now, threads
            return max(MIN_PENDING_CHUNKS, 2 * threads + 1)
        return int(2 * threads + 1)

    def submit(self, number: int, part: Chunk, carried: Any) -> Future[Result]:
        """Submit a part; `ExecutorLost` if the executor does not accept it."""
        location = part.first, part.last, carried
        try:
            with deferring_ctrl_c():
                if self.is_local:
                    return self._executor.submit(
                        _compute_in_thread, self.study, *location, self._watch(number)
                    )
                with ignoring_ctrl_c():  # submission may start processes
                    # Numbered, since Dask identifies calls with equal arguments.
                    return self._executor.submit(
                        _compute_in_process, self._packed, *location, next(self._calls)
                    )
        except (RuntimeError, OSError) as error:
            # RuntimeError: the executor is broken or was shut down. OSError: the queue is closed,
            # since a worker died while another one started, or the system cannot start a process.
            raise ExecutorLost(str(error)) from None

    def report_dead_workers(self) -> None:
        """Let a pool of processes notice a worker that died soon after it had started.

        The pool watches the workers that it had at its last submission or result. A study whose
        parts are all submitted would wait for a newer one forever.
        """
        pool = self._executor
        if not isinstance(pool, ProcessPoolExecutor) or not pool._processes:
            return
        wakeup = pool._executor_manager_thread_wakeup
        if wakeup is not None and not all(p.is_alive() for p in [*pool._processes.values()]):
            # A submission would start a worker, for whose end a pool that ends could wait forever.
            with suppress(OSError), pool._shutdown_lock:
                wakeup.wakeup()

    def warn_of_missing_workers(self) -> None:
        """Report once, after a while, that a cluster has no workers."""
        if time.monotonic() < self._check_time:
            return
        self._check_time = math.inf
        client = getattr(self._executor, "_client", None)
        if client is not None and not client.nthreads():
            _log.warning("waiting for workers: the cluster has none; see its log")

    @property
    def part_done(self) -> float:
        """Number of completed points of pending parts, if known."""
        return sum(list(self._within.values()))

    def forget(self, number: int) -> None:
        """Discard the progress of a part that is no longer pending."""
        self._within.pop(number, None)

    def is_lost(self, error: BaseException) -> bool:
        """Return whether an error means that a worker was lost, not that a point failed."""
        if isinstance(error, KeyboardInterrupt):
            return not self.is_local  # a worker was interrupted
        return isinstance(error, BrokenExecutor | CancelledError) or killed_by_its_chunk(error)

    def renew(self, reason: str) -> None:
        """Replace the executor; `ExecutorLost` if that fails, or if its workers die at once."""
        if self._make is None:
            remedy = "pass as executor a function that makes executors, for a new one after a fault"
            raise ExecutorLost(reason, _guard_remedy(self._executor) or remedy)
        _end(self._executor, at_once=True)
        self._executor = self._created(self._make)
        try:
            if self.is_local:
                self._executor.submit(int).result()
            else:
                with ignoring_ctrl_c():
                    trial = self._executor.submit(_prepared, self._packed)
                trial.result()
        except (BrokenExecutor, CancelledError, OSError) as error:
            remedy = "see that memory suffices for new processes, or use threads"
            reason = f"they die before they compute anything: {error}"
            raise ExecutorLost(reason, _guard_remedy(self._executor) or remedy) from None

    @cached_property
    def _packed(self) -> bytes:
        try:
            packed: bytes = cloudpickle.dumps(self.study)
        except Exception as error:  # pickling of an object may raise any exception
            problem = f"the study cannot go to other processes ({error}); leave executor out"
            raise InvalidParameter("executor", None, "", problem=problem) from error
        return packed

    def _created(self, make: Maker) -> Executor:
        executor = make()
        if not isinstance(executor, Executor):
            allowed = "a function that returns a concurrent.futures.Executor"
            raise InvalidParameter("executor", executor, allowed)
        return executor

    def _watch(self, number: int) -> Watch:
        def watch(done: float) -> None:
            if self._stop.is_set():
                raise _Stopped
            self._within[number] = done

        return watch


def _guard_remedy(executor: Any) -> str:
    """Return the remedy for a script that each worker imports and runs again; empty for others."""
    context = getattr(executor, "_mp_context", None)
    file = getattr(sys.modules["__main__"], "__file__", None)
    if context is None or context.get_start_method() == "fork" or file is None:
        return ""
    try:
        is_guarded = b"__main__" in Path(file).read_bytes()
    except OSError:
        return ""
    guard = "call the study under if __name__ == '__main__':, since each worker imports the script"
    return "" if is_guarded else f"{guard} {label(file)}"


def _threads_of_cluster(executor: Any) -> int:
    """Return the present number of threads of Dask's workers; 0 for other executors."""
    client = getattr(executor, "_client", None)
    return sum(client.nthreads().values()) if client is not None else 0


def _end(executor: Executor, *, at_once: bool) -> None:
    """Shut down an own executor, without waiting for running chunks if `at_once`."""
    if at_once and isinstance(executor, ProcessPoolExecutor):
        for process in list((executor._processes or {}).values()):
            process.kill()
    if isinstance(executor, ThreadPoolExecutor | ProcessPoolExecutor):
        executor.shutdown(cancel_futures=True)
    else:
        executor.shutdown(wait=not at_once)


@contextmanager
def ignoring_ctrl_c() -> Iterator[None]:
    """Make processes started in the block ignore Ctrl-C, which a terminal sends to all processes.

    Otherwise they would print tracebacks; this process ends them.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


# --- Functions of workers

_preparing = threading.Lock()  # serializes the preparation among threads of a process
_alone = threading.Lock()  # serializes studies that must not run in parallel threads


def _compute_in_thread(study: Study, first: int, last: int, carried: Any, watch: Watch) -> Result:
    """Compute points in a thread of the main process."""
    with nullcontext() if study.threaded else _alone:
        watch(0.0)
        return _computed(study, first, last, carried, watch)


def _compute_in_process(packed: bytes, first: int, last: int, carried: Any, _call: int) -> Result:
    """Compute points in another process."""
    _prepared(packed)
    study = _unpacked(packed)
    with nullcontext() if study.threaded else _alone:
        return _computed(study, first, last, carried, None)


def _computed(study: Study, first: int, last: int, carried: Any, watch: Watch | None) -> Result:
    """Compute points; return their results and warnings."""
    with collected_warnings() as caught:
        columns, carried = study.compute(first, last, carried, watch)
    return columns, carried, caught


def _prepared(packed: bytes) -> None:
    """Prepare a process, once."""
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
    """End this process with its parent; otherwise a worker of a pool would wait forever."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
