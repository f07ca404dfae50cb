"""Background computation of the latest request, and its warnings."""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Generic, TypeVar

from mems_impact._util.progress import Watch
from mems_impact.errors import (
    DiscontinuityWarning,
    ScaleWarning,
    StartWarning,
    StiffnessWarning,
    UnitsWarning,
    ValidityWarning,
)

__all__ = ["LatestOnlyWorker", "capture_warnings", "route_warnings"]

# --- Computing beside the page: what was asked last counts, what nobody waits for is given up.

Asked = TypeVar("Asked")


class _GivenUp(Exception):
    """Ends work whose result nobody waits for."""


class LatestOnlyWorker(Generic[Asked]):
    """A thread that computes what was asked last.

    Parameters
    ----------
    compute : callable
        ``compute(asked, watch)``, which calls ``watch(anything)`` now and then while it works;
        what that raises ends it.
    deliver : callable
        ``deliver(asked, result, error)`` is called in the thread, with one of both None.
    patience : float, optional
        Seconds that work may go on though something else has been asked since. Pictures are to
        follow a slider that moves without rest, so that short work is done to its end.
    delay : float, optional
        Seconds in which nothing else is asked, before work begins.
    """

    def __init__(
        self,
        compute: Callable[[Asked, Watch], Any],
        deliver: Callable[[Asked, Any, Exception | None], None],
        *,
        patience: float = 0.0,
        delay: float = 0.0,
    ) -> None:
        self._compute, self._deliver = compute, deliver
        self._patience, self._delay = patience, delay
        self._changed = threading.Condition()
        self._waiting: tuple[Asked] | None = None
        self._stopped = False
        # Compiling hears nobody: a process that ends shall not wait for it.
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def ask(self, asked: Asked) -> None:
        """Ask for something, in place of all that was asked before."""
        with self._changed:
            self._waiting = (asked,)
            self._changed.notify()

    def stop(self) -> None:
        """End the thread, as soon as its work listens."""
        with self._changed:
            self._stopped = True
            self._changed.notify()

    def join(self, timeout: float) -> None:
        """Wait for the thread that was stopped."""
        self._thread.join(timeout)

    def _run(self) -> None:
        while (asked := self._next()) is not None:
            begin = time.monotonic()

            def watch(_: float, begin: float = begin) -> None:
                late = time.monotonic() - begin >= self._patience
                if self._stopped or (late and self._waiting is not None):
                    raise _GivenUp

            try:
                result, error = self._compute(asked[0], watch), None
            except _GivenUp:
                continue
            except Exception as raised:
                result, error = None, raised
            if not self._stopped:
                self._deliver(asked[0], result, error)

    def _next(self) -> tuple[Asked] | None:
        """Return what is to be computed next, when it has been left alone long enough."""
        with self._changed:
            while not self._stopped:
                asked = self._waiting
                self._changed.wait(self._delay if asked else None)
                if asked is not None and asked is self._waiting:
                    self._waiting = None
                    return asked
        return None


# --- Warnings of the package, each to the page whose run gave it.

TOLD = (
    DiscontinuityWarning,
    ScaleWarning,
    StartWarning,
    StiffnessWarning,
    UnitsWarning,
    ValidityWarning,
)
_here = threading.local()


@contextmanager
def route_warnings() -> Iterator[None]:
    """Let `capture_warnings` hear warnings, of each thread its own, each time that they are given.

    Python's own recorder changes what the whole process does with warnings, and here pictures of
    several pages are computed side by side.
    """
    with warnings.catch_warnings():
        for kind in TOLD:
            warnings.simplefilter("always", kind)
        shown = warnings.showwarning

        def show(message: Any, category: Any, *rest: Any, **more: Any) -> None:
            messages = getattr(_here, "messages", None)
            if messages is not None and issubclass(category, TOLD):
                messages.append(str(message))
            else:
                shown(message, category, *rest, **more)

        warnings.showwarning = show
        yield


@contextmanager
def capture_warnings() -> Iterator[list[str]]:
    """Gather what this thread is warned of, while the block runs."""
    _here.messages = messages = list[str]()
    try:
        yield messages
    finally:
        _here.messages = None
