"""Threads whose runs end as soon as nobody waits for them any more."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

__all__ = ["Watch", "stoppable_threads"]

Watch = Callable[[float], None]


class _Stopped(Exception):
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
            raise _Stopped

    with ThreadPoolExecutor(workers) as executor:
        try:
            yield executor, watch
        finally:
            stop.set()
            executor.shutdown(wait=False, cancel_futures=True)
