"""Background computation of the latest request."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from mems_impact._util.progress import Watch

Request = TypeVar("Request")


class _GivenUp(Exception):
    """Cancels an outdated computation."""


class LatestOnlyWorker(Generic[Request]):
    """A thread that computes the latest request.

    ``compute(request, watch)`` calls ``watch(progress)`` repeatedly, and an exception from it ends
    the computation. ``deliver(request, result, error)`` is called in the thread, with one of both
    None. A computation begins after `delay` seconds without a newer request, and continues for
    `patience` seconds after one: short computations are completed, so that pictures follow a moving
    slider.
    """

    def __init__(
        self,
        compute: Callable[[Request, Watch], Any],
        deliver: Callable[[Request, Any, Exception | None], None],
        *,
        patience: float = 0.0,
        delay: float = 0.0,
    ) -> None:
        self._compute, self._deliver = compute, deliver
        self._patience, self._delay = patience, delay
        self._changed = threading.Condition()
        self._waiting: tuple[Request] | None = None
        self._stopped = False
        # Compilation cannot be cancelled, and must not delay the end of the process.
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def request(self, request: Request) -> None:
        """Request a computation, which replaces earlier requests."""
        with self._changed:
            self._waiting = (request,)
            self._changed.notify()

    def stop(self) -> None:
        """End the thread at the next call of ``watch``."""
        with self._changed:
            self._stopped = True
            self._changed.notify()

    def join(self, timeout: float) -> None:
        """Wait for the end of the thread."""
        self._thread.join(timeout)

    def _run(self) -> None:
        while (request := self._next()) is not None:
            begin = time.monotonic()

            def watch(_: float, begin: float = begin) -> None:
                late = time.monotonic() - begin >= self._patience
                if self._stopped or (late and self._waiting is not None):
                    raise _GivenUp

            try:
                result, error = self._compute(request[0], watch), None
            except _GivenUp:
                continue
            except Exception as raised:
                result, error = None, raised
            if not self._stopped:
                self._deliver(request[0], result, error)

    def _next(self) -> tuple[Request] | None:
        """Return the next request, after the delay without newer ones."""
        with self._changed:
            while not self._stopped:
                request = self._waiting
                self._changed.wait(self._delay if request else None)
                if request is not None and request is self._waiting:
                    self._waiting = None
                    return request
        return None
