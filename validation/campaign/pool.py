"""Cases in worker processes, each under a time limit that a hang cannot evade."""

from __future__ import annotations

import multiprocessing as mp
import time
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any

LIMIT = 120.0  # seconds for one case, judge included, on a busy machine


def _serve(pipe: Connection, work: Callable[[Any], Any]) -> None:
    pipe.send("ready")  # the imports, which may take long, are not the first case's time
    while True:
        item = pipe.recv()
        if item is None:
            return
        pipe.send(work(item))


class _Worker:
    def __init__(self, work: Callable[[Any], Any]) -> None:
        context = mp.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, work), daemon=True)
        self.process.start()
        theirs.close()
        self.pipe.recv()
        self.item: Any = None
        self.since = 0.0

    def give(self, item: Any) -> None:
        self.item, self.since = item, time.monotonic()
        self.pipe.send(item)

    def end(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()


def each(
    work: Callable[[Any], Any],
    items: Sequence[Any],
    workers: int,
    lost: Callable[[Any, str], Any],
    limit: float = LIMIT,
) -> Iterator[Any]:
    """Yield ``work(item)`` for every item, in no order; ``lost(item, why)`` where it hung or died.

    A worker that gives no answer within `limit` seconds is killed and replaced.
    """
    if workers <= 1:
        for item in items:
            yield work(item)
        return
    todo = list(reversed(items))
    pool = [_Worker(work) for _ in range(min(workers, len(items)))]
    busy: list[_Worker] = []
    try:
        while todo or busy:
            for worker in pool:
                if worker.item is None and todo:
                    worker.give(todo.pop())
                    busy.append(worker)
            ready = wait([worker.pipe for worker in busy], timeout=1.0)
            for worker in list(busy):
                why = ""
                if worker.pipe in ready:
                    try:
                        yield worker.pipe.recv()
                    except EOFError:
                        why = "the process died"
                elif time.monotonic() - worker.since > limit:
                    why = f"hung for {limit:g} s"
                else:
                    continue
                busy.remove(worker)
                if why:
                    yield lost(worker.item, why)
                    worker.end()
                    pool[pool.index(worker)] = _Worker(work)
                else:
                    worker.item = None
    finally:
        for worker in pool:
            worker.end()
