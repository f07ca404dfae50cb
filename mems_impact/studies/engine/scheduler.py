"""Scheduling of chunks: distribution, retries, quarantine."""

from __future__ import annotations

import math
import os
from collections import Counter, deque
from collections.abc import Callable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TYPE_CHECKING, Any

from mems_impact._util.ctrl_c import deferring_ctrl_c
from mems_impact._util.progress import Progress, Report, progress_bar
from mems_impact._util.warning_scopes import CollectedWarning, first_of_each, warn
from mems_impact.errors import Interrupted, StartWarning, WorkersLost
from mems_impact.studies.engine.executors import (
    ExecutorLost,
    Result,
    WorkerPool,
    cores,
    killed_by_its_chunk,
)
from mems_impact.studies.engine.store import ChunkStore, MemoryStore, open_store
from mems_impact.studies.engine.study import Columns, Study
from mems_impact.systems.state import whole

if TYPE_CHECKING:
    import pandas as pd

POLL_SECONDS = 0.25  # s between two checks for completed parts
RECOVERY_SECONDS = 10.0  # s in which a broken executor returns its parts
MAX_WORKER_DEATHS = 3  # deaths of workers after which a chunk is abandoned
MIN_CHUNKS_PER_WORKER = 4  # least number of chunks per worker, which bounds idle time at the end


def run_study(
    study: Study,
    *,
    store: str | os.PathLike[str] | None = None,
    executor: Executor | Callable[[], Executor] | None = None,
    workers: int | None = None,
    progress: Progress = False,
    chunk: int | None = None,
) -> pd.DataFrame:
    """Compute all points of a study, as rows in their order. The numbers depend on `study` only.

    A directory `store`, which requires pyarrow, keeps completed chunks, from which an interrupted
    or killed study continues; it keeps the size of its chunks. A function that makes an executor is
    called again if its workers die; `workers` is the number of workers of an executor that does not
    provide it. `progress` is as in `progress_bar`; a function is called several times a second with
    the points done.

    A failed point has its reason in ``status``. A chunk whose worker dies is computed again,
    finally without others beside it; after three deaths of workers its points become failed rows.
    Any other exception of a point is raised unchanged. Its attribute ``partial`` is the completed
    table, as that of Interrupted, raised at once on Ctrl-C, and of WorkersLost, if the workers
    cannot be replaced. Raises InvalidParameter if an argument is out of range or pyarrow is
    missing; InvalidFile or FileNotWritten if the store belongs to another study, is in use or
    damaged, or cannot be written.
    """
    crew = WorkerPool(study, executor, None if workers is None else whole("workers", workers, 1))
    size = _default(study, workers) if chunk is None else whole("chunk", chunk, 1)
    with _keeping(study, store, size) as chunks:
        if chunks.done < study.points:
            _compute(study, chunks, crew, progress)
        return chunks.table()


@contextmanager
def completed_study(study: Study, table: pd.DataFrame) -> Iterator[None]:
    """Keep the table of a completed study if Ctrl-C interrupts the block that evaluates it."""
    try:
        yield
    except KeyboardInterrupt:
        raise Interrupted(study.kind, _progress(study.points, study), table) from None


def _progress(done: int, study: Study) -> str:
    return f"{done} of {study.points} points"


def _keeping(
    study: Study, store: str | os.PathLike[str] | None, chunk: int
) -> AbstractContextManager[ChunkStore]:
    if store is None:
        return nullcontext(MemoryStore(study, chunk))
    return open_store(store, study, chunk)


def _default(study: Study, workers: int | None) -> int:
    if study.chains:
        return study.chunk
    share = math.ceil(study.points / (MIN_CHUNKS_PER_WORKER * (workers or cores())))
    return max(1, min(study.chunk, share))


def _compute(study: Study, chunks: ChunkStore, crew: WorkerPool, progress: Progress) -> None:
    """Compute the missing parts; an exception holds the completed table."""
    try:
        with (
            warned(study) as caught,
            crew,
            progress_bar(progress, "points", study.points, study.kind, chunks.done) as notice,
        ):
            Scheduler(study, chunks, crew, notice, caught).run()
    except KeyboardInterrupt:
        chunks.scan_completed()
        raise Interrupted(study.kind, _progress(chunks.done, study), chunks.table()) from None
    except ExecutorLost as error:
        after, table = _progress(chunks.done, study), chunks.table()
        raise WorkersLost(str(error), error.remedy, after, table) from None
    except Exception as error:
        error.partial = chunks.table()  # type: ignore[attr-defined]
        error.add_note(f"{_progress(chunks.done, study)} are done")
        raise


@contextmanager
def warned(study: Study) -> Iterator[list[CollectedWarning]]:
    """Yield a list for warnings of points; each subject is reported once, with its first point."""
    caught: list[CollectedWarning] = []
    try:
        yield caught
    finally:
        caught.sort(key=lambda each: each.point)
        for first in first_of_each(caught):
            alike = (first.category, first.subject)
            points = {each.point for each in caught if (each.category, each.subject) == alike}
            label = study.point_label(first.point)
            if first.category is StartWarning:  # all starts are checked, jumps only occasionally
                count = f"{len(points)} of {study.points} points"
                label = f"{count}, first {label}" if len(points) > 1 else f"{count}, {label}"
            message = f"{study.kind} ({label}): {first.message}"
            warn(message, first.category, first.subject)


class Scheduler:
    """Scheduler of the missing parts of a study, with a bounded number of pending parts.

    At most one part of a chain is pending. When a worker dies, its executor does not report the
    part, so each pending part counts one death. From the second death on a part is computed alone;
    if the worker dies again, this part is the cause.
    """

    def __init__(
        self,
        study: Study,
        chunks: ChunkStore,
        crew: WorkerPool,
        notice: Report | None,
        caught: list[CollectedWarning],
    ) -> None:
        self.study, self.chunks, self.crew, self.notice = study, chunks, crew, notice
        self.caught = caught
        self.ready = deque(number for number in chunks.missing if chunks.is_ready(number))
        self.quarantined: deque[int] = deque()
        self.trial: int | None = None  # the suspect that is computed alone
        self.worker_deaths: Counter[int] = Counter()
        self.pending: dict[Future[Result], int] = {}
        self.broken = ""  # reason for which the executor is unusable

    def run(self) -> None:
        """Compute all parts."""
        try:
            while self.ready or self.quarantined or self.pending:
                self.submit_parts()
                with deferring_ctrl_c():
                    self.take(wait(self.pending, POLL_SECONDS, FIRST_COMPLETED).done)
                    self.crew.report_dead_workers()
                if self.broken:
                    self.recover()
                self.crew.warn_of_missing_workers()
                if self.notice is not None:
                    done = self.chunks.done + self.crew.part_done
                    self.notice(done, f"{self.chunks.failed} failed")
        finally:
            with deferring_ctrl_c():
                for future in self.pending:
                    future.cancel()

    def submit_parts(self) -> None:
        """Submit enough parts to keep all workers busy; a suspect alone."""
        while not self.broken and self.trial is None:
            if self.quarantined and not self.pending:
                number = self.trial = self.quarantined.popleft()
            elif self.ready and not self.quarantined and len(self.pending) < self.crew.window:
                number = self.ready.popleft()
            else:
                return
            try:
                future = self.crew.submit(
                    number, self.chunks.parts[number], self.chunks.carried(number)
                )
            except ExecutorLost as error:
                self.again(number)
                self.broken = str(error) or "the executor takes no work"
            else:
                self.pending[future] = number

    def take(self, done: set[Future[Result]]) -> None:
        """Store completed parts, then raise errors of failed parts."""
        failed: BaseException | None = None
        for future in sorted(done, key=self.pending.__getitem__):
            number = self.pending.pop(future)
            self.crew.forget(number)
            error = _error_of(future)
            if error is None:
                self.trial = None
                columns, carried, caught = future.result()
                self.caught += caught
                self.keep(number, columns, carried)
            elif self.crew.is_lost(error):
                self.handle_worker_loss(number, error)
            else:
                failed = failed or error
        if failed is not None:
            raise failed

    def keep(self, number: int, columns: Columns, carried: Any) -> None:
        """Store a part; the next one of its chain becomes ready."""
        self.chunks.put(number, columns, carried)
        after = number + 1
        if self.chunks.is_missing(after) and self.chunks.parts[after].follows:
            self.ready.appendleft(after)

    def handle_worker_loss(self, number: int, error: BaseException) -> None:
        """Repeat a part whose worker died; abandon it after three deaths."""
        alone = number == self.trial
        # Dask has computed such a part on several workers, but together with other parts.
        self.worker_deaths[number] += MAX_WORKER_DEATHS - 1 if killed_by_its_chunk(error) else 1
        if isinstance(error, BrokenExecutor | CancelledError):
            self.broken = _one_line(error)
        if alone and self.worker_deaths[number] >= MAX_WORKER_DEATHS:
            self.trial = None
            part, carried = self.chunks.parts[number], self.chunks.carried(number)
            reason = f"its chunk killed {MAX_WORKER_DEATHS} workers ({_one_line(error)})"
            self.keep(number, self.study.failed(part.first, part.last, reason), carried)
        else:
            self.again(number)

    def again(self, number: int) -> None:
        """Queue a part again."""
        self.trial = None if number == self.trial else self.trial
        if self.worker_deaths[number] >= MAX_WORKER_DEATHS - 1:
            self.quarantined.append(number)
        else:
            self.ready.appendleft(number)

    def recover(self) -> None:
        """Store the completed parts of a broken executor, and replace it."""
        self.take(wait(self.pending, RECOVERY_SECONDS).done)
        for future, number in self.pending.items():
            future.cancel()
            self.again(number)
        self.pending.clear()
        self.crew.renew(self.broken)
        self.broken = ""


def _error_of(future: Future[Result]) -> BaseException | None:
    try:
        return future.exception()
    except CancelledError as error:
        return error


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()).rstrip(".") or type(error).__name__
