"""Progress of long computations: a bar on a terminal, lines in a log, or a callback."""

from __future__ import annotations

import logging
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["ProgressLog", "Watch", "is_interactive", "parameter_progress", "progress_bar"]

Watch = Callable[[float], None]
"""What work calls now and then with how much is done; what it raises ends the work."""

_log = logging.getLogger("mems_impact")

QUIET_SECONDS = 1.0  # s of work of which no bar is shown
SOON = 3.0  # s after which the first line is due, and at least between two
SELDOM = 30.0  # s after which a line is due
UPDATE_SHARE = 0.1  # of all after which one is


@contextmanager
def progress_bar(
    progress: bool | Callable[[float], None], unit: str, total: float | None = None
) -> Iterator[Watch | None]:
    """Give what is called with all that is done so far; None where nobody listens.

    Parameters
    ----------
    progress : bool or callable
        True: on a terminal a bar, elsewhere a line now and then, where the work takes over a
        second, or three. A function is handed on.
    unit : str
        What is counted.
    total : float, optional
        Where it ends, if that is known.
    """
    if callable(progress) or not progress:
        yield progress or None
    elif is_interactive():
        from tqdm import tqdm

        with tqdm(total=total and round(total, 3), delay=QUIET_SECONDS, unit=f" {unit}") as bar:
            yield lambda done: bar.update(done - bar.n) and None
    else:
        yield ProgressLog(unit, total)


@contextmanager
def parameter_progress(
    progress: bool | Callable[[float], None], name: str, unit: str, out: Callable[[float], float]
) -> Iterator[Watch | None]:
    """Give what is called with every value of a parameter that work passes, however many.

    Parameters
    ----------
    progress : bool or callable
        As of `progress_bar`.
    name : str
        The parameter.
    unit : str
        What there is one of for each value.
    out : callable
        From the value in the units of the numerics to that of the user.
    """
    if callable(progress):
        yield lambda value: progress(out(value))
    elif not progress:
        yield None
    elif is_interactive():
        from tqdm import tqdm

        with tqdm(delay=QUIET_SECONDS, unit=f" {unit}") as bar:

            def show(value: float) -> None:
                bar.set_postfix_str(f"{name} = {out(value):.6g}", refresh=False)
                bar.update()

            yield show
    else:
        lines, passed = ProgressLog(unit), 0

        def tell(value: float) -> None:
            nonlocal passed
            passed += 1
            lines(passed, f"{name} = {out(value):.6g}")

        yield tell


def is_interactive() -> bool:
    """Return whether somebody may be watching standard error, which may be closed."""
    return sys.stderr is not None and sys.stderr.isatty()


class ProgressLog:
    """Lines for a log, as that of a batch job: soon, then every 10 % or 30 s, and at the end.

    Nothing is said of work that is done soon.

    Parameters
    ----------
    unit : str
        What is counted.
    total : float, optional
        Where it ends, if that is known.
    before : float, optional
        What was done by earlier runs.
    kind : str, optional
        What runs.
    """

    def __init__(
        self, unit: str, total: float | None = None, before: float = 0.0, kind: str = ""
    ) -> None:
        self.unit, self.total, self.before = unit, total, before
        self.kind = f"{kind}: " if kind else ""
        self.begin = time.monotonic()
        self.told = -math.inf
        self.share = before

    def __call__(self, done: float, more: str = "") -> None:
        """Say how far it is, if a line is due; `more` comes at its end."""
        now = time.monotonic()
        since = now - self.told
        due = since >= SELDOM
        if self.total is not None:
            due |= since >= SOON and done - self.share >= UPDATE_SHARE * self.total
            due |= done == self.total and self.told > -math.inf
        if now - self.begin < SOON or not due:
            return
        self.told, self.share = now, done
        _say(self.line(done, now - self.begin, more))

    def line(self, done: float, seconds: float, more: str = "") -> str:
        """Return how far it is."""
        if self.total is None:
            parts = [f"{self.kind}{int(done)} {self.unit}"]
        else:
            of = f"{int(done)} of {int(self.total)} {self.unit}"
            parts = [f"{self.kind}{of} ({done / self.total:.0%})"]
        rate = (done - self.before) / seconds
        if rate > 0.0:
            parts.append(f"{rate:.3g} {self.unit}/s")
        if self.total is not None and rate > 0.0 and done < self.total:
            parts.append(f"{_duration((self.total - done) / rate)} left")
        return ", ".join([*parts, more] if more else parts)


def _duration(seconds: float) -> str:
    for unit, size in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.0f} s"


def _say(text: str) -> None:
    """Say it in the log if somebody keeps one, for it was asked for: else on standard error."""
    if _log.hasHandlers() and _log.isEnabledFor(logging.INFO):
        _log.info(text)
    elif sys.stderr is not None:
        sys.stderr.write(f"mems-impact: {text}\n")
        sys.stderr.flush()
