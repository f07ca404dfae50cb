"""Scheduling of chunks: distribution, retries, quarantine."""

from __future__ import annotations

import math
import os
from collections import Counter, deque
from collections.abc import Callable
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any

from mems_impact._util.warning_scopes import CollectedWarning
from mems_impact.errors import StudyInterrupted, WorkersLost
from mems_impact.studies.engine.executors import (
    ExecutorLost,
    Result,
    WorkerPool,
    cores,
    killed_by_its_chunk,
)
from mems_impact.studies.engine.progress import Progress, StudyProgress, study_progress, warned
from mems_impact.studies.engine.store import ChunkStore, MemoryStore
from mems_impact.studies.engine.study import Columns, Study
from mems_impact.systems.state import whole

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["run_study"]

TICK = 0.25  # s between two looks at what is done
BREAKING = 10.0  # s within which all that a broken executor has is given up by it
DEATHS = 3  # of workers, after which a chunk is given up
PER_WORKER = 4  # chunks that each worker has at least, so that none is idle for long at the end


def run_study(
    study: Study,
    *,
    store: str | os.PathLike[str] | None = None,
    executor: Executor | Callable[[], Executor] | None = None,
    workers: int | None = None,
    progress: Progress = False,
    chunk: int | None = None,
) -> pd.DataFrame:
    """Compute all points of a study. Nothing but `study` makes a difference to any number.

    Parameters
    ----------
    study : Study
    store : str or os.PathLike, optional
        A directory in which chunks are kept as they are done: a study that was interrupted or
        killed goes on from there. Needs pyarrow.
    executor : concurrent.futures.Executor or callable, optional
        Threads by default. A function that makes an executor is called again if its workers die.
    workers : int, optional
        How many threads; with an executor, how many workers it has, where it does not tell.
    progress : bool or callable, optional
        Show how far it is: a bar on a terminal, else a line every 10 % or 30 s. A function is
        called several times a second with the points done.
    chunk : int, optional
        How many points are computed together. A store goes on with the chunks it has.

    Returns
    -------
    DataFrame
        The rows of the points in their order. A point that failed has its reason in ``status``.

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or pyarrow is missing.
    InvalidFile, FileNotWritten
        If the store is another study's, in use, damaged, or cannot be written.
    StudyInterrupted
        On Ctrl-C, which is heard at once; its ``table`` holds the chunks done.
    WorkersLost
        If the workers died and no others can be had; its ``table`` holds the chunks done.

    Notes
    -----
    A chunk whose worker dies is tried again, at last by itself. One that has killed three workers
    is given up: its points are rows that say so. Any other exception of a point comes as it
    is, with the table of what was done as its attribute ``table``.
    """
    crew = WorkerPool(study, executor, None if workers is None else whole("workers", workers, 1))
    size = _default(study, workers) if chunk is None else whole("chunk", chunk, 1)
    with _keeping(study, store, size) as kept:
        if kept.done < study.points:
            _compute(study, kept, crew, progress)
        return kept.table()


def _keeping(
    study: Study, store: str | os.PathLike[str] | None, chunk: int
) -> AbstractContextManager[ChunkStore]:
    if store is None:
        return nullcontext(MemoryStore(study, chunk))
    from mems_impact.studies.engine.store import open_store

    return open_store(store, study, chunk)


def _default(study: Study, workers: int | None) -> int:
    if study.chains:
        return study.chunk
    share = math.ceil(study.points / (PER_WORKER * (workers or cores())))
    return max(1, min(study.chunk, share))


def _compute(study: Study, kept: ChunkStore, crew: WorkerPool, progress: Progress) -> None:
    """Compute what is missing; whatever ends it early says what is done."""
    try:
        with (
            warned(study) as told,
            crew,
            study_progress(progress, study.kind, kept.done, study.points) as notice,
        ):
            Scheduler(study, kept, crew, notice, told).run()
    except KeyboardInterrupt:
        kept.scan_completed()
        raise StudyInterrupted(kept.table(), kept.done, study.points) from None
    except ExecutorLost as error:
        raise WorkersLost(str(error), kept.table(), kept.done, study.points) from None
    except Exception as error:
        error.table = kept.table()  # type: ignore[attr-defined]
        error.add_note(f"{kept.done} of {study.points} points are done")
        raise


class Scheduler:
    """Gives out the parts that are missing, a bounded number at a time, and takes what comes back.

    Of a chain one part is under way at most. When a worker dies, its executor cannot say of which
    part: so all that were under way count one death, and from the second on a part is tried by
    itself. If the worker dies then, it was that part which killed it.
    """

    def __init__(
        self,
        study: Study,
        kept: ChunkStore,
        crew: WorkerPool,
        notice: StudyProgress | None,
        told: list[CollectedWarning],
    ) -> None:
        self.study, self.kept, self.crew, self.notice = study, kept, crew, notice
        self.told = told
        self.ready = deque(number for number in kept.missing if kept.is_ready(number))
        self.quarantined: deque[int] = deque()
        self.trial: int | None = None  # the suspect that is under way, with nothing beside it
        self.worker_deaths: Counter[int] = Counter()
        self.under_way: dict[Future[Result], int] = {}
        self.broken = ""  # why the executor is of no use any more

    def run(self) -> None:
        """Compute all parts."""
        try:
            while self.ready or self.quarantined or self.under_way:
                self.give_out()
                self.take(wait(self.under_way, TICK, FIRST_COMPLETED).done)
                if self.broken:
                    self.recover()
                self.crew.say_if_nobody_comes()
                if self.notice is not None:
                    self.notice(self.kept.done + self.crew.part_done, self.kept.failed)
        finally:
            for future in self.under_way:
                future.cancel()

    def give_out(self) -> None:
        """Give out parts, as many as keep all workers busy; a suspect by itself."""
        while not self.broken and self.trial is None:
            if self.quarantined and not self.under_way:
                number = self.trial = self.quarantined.popleft()
            elif self.ready and not self.quarantined and len(self.under_way) < self.crew.window:
                number = self.ready.popleft()
            else:
                return
            try:
                future = self.crew.submit(
                    number, self.kept.parts[number], self.kept.carried(number)
                )
            except ExecutorLost as error:
                self.again(number)
                self.broken = str(error) or "the executor takes no work"
            else:
                self.under_way[future] = number

    def take(self, done: set[Future[Result]]) -> None:
        """Keep what is done, and only then say what has failed."""
        failed: BaseException | None = None
        for future in sorted(done, key=self.under_way.__getitem__):
            number = self.under_way.pop(future)
            self.crew.forget(number)
            error = _error_of(future)
            if error is None:
                self.trial = None
                columns, carried, told = future.result()
                self.told += told
                self.keep(number, columns, carried)
            elif self.crew.is_lost(error):
                self.lose(number, error)
            else:
                failed = failed or error
        if failed is not None:
            raise failed

    def keep(self, number: int, columns: Columns, carried: Any) -> None:
        """Keep a part; the next one of its chain may go on."""
        self.kept.put(number, columns, carried)
        after = number + 1
        if self.kept.is_missing(after) and self.kept.parts[after].follows:
            self.ready.appendleft(after)

    def lose(self, number: int, error: BaseException) -> None:
        """Try a part again whose worker may have died of it; give up one that has killed three."""
        alone = number == self.trial
        # Dask has tried such a part on several workers already, but with others beside it.
        self.worker_deaths[number] += DEATHS - 1 if killed_by_its_chunk(error) else 1
        if isinstance(error, BrokenExecutor | CancelledError):
            self.broken = _one_line(error)
        if alone and self.worker_deaths[number] >= DEATHS:
            self.trial = None
            part, carried = self.kept.parts[number], self.kept.carried(number)
            reason = f"its chunk killed {DEATHS} workers ({_one_line(error)})"
            self.keep(number, self.study.failed(part.first, part.last, reason), carried)
        else:
            self.again(number)

    def again(self, number: int) -> None:
        """Let a part be given out again."""
        self.trial = None if number == self.trial else self.trial
        if self.worker_deaths[number] >= DEATHS - 1:
            self.quarantined.append(number)
        else:
            self.ready.appendleft(number)

    def recover(self) -> None:
        """Take what the broken executor has done, and have it made anew."""
        self.take(wait(self.under_way, BREAKING).done)
        for future, number in self.under_way.items():
            future.cancel()
            self.again(number)
        self.under_way.clear()
        self.crew.renew(self.broken)
        self.broken = ""


def _error_of(future: Future[Result]) -> BaseException | None:
    try:
        return future.exception()
    except CancelledError as error:
        return error


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()).rstrip(".") or type(error).__name__
