"""What is said of a study while it runs: how far it is, how fast, how long still, what failed."""

from __future__ import annotations

import logging
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["Notice", "Progress", "noticed"]

_log = logging.getLogger("mems_impact")

Progress = bool | Callable[[float], None]
Notice = Callable[[float, int], None]  # points done so far, and those of them that failed

SHORT = 1.0  # s of work of which nothing is said
SELDOM = 30.0  # s after which a line is due
SHARE = 0.1  # of all points after which one is


@contextmanager
def noticed(progress: Progress, kind: str, before: int, total: int) -> Iterator[Notice | None]:
    """Give what is called now and then with what is done; None where nobody listens.

    Parameters
    ----------
    progress : bool or callable
        True: on a terminal a bar, elsewhere a line now and then, both where the work takes over a
        second. A function is called with the points done so far.
    kind : str
        What runs.
    before, total : int
        How many points were done by earlier runs, and how many there are.
    """
    if callable(progress):
        yield lambda done, failed: progress(done)
    elif not progress:
        yield None
    elif sys.stderr is not None and sys.stderr.isatty():
        yield from _bar(kind, before, total)
    else:
        yield _Lines(kind, before, total)


def _bar(kind: str, before: int, total: int) -> Iterator[Notice]:
    from tqdm import tqdm

    with tqdm(desc=kind, initial=before, total=total, delay=SHORT, unit=" points") as bar:

        def show(done: float, failed: int) -> None:
            if failed:
                bar.set_postfix_str(f"{failed} failed", refresh=False)
            bar.update(int(done) - bar.n)

        yield show


class _Lines:
    """Lines for a log, as that of a batch job: soon, then every 10 % or 30 s, and at the end."""

    def __init__(self, kind: str, before: int, total: int) -> None:
        self.kind, self.before, self.total = kind, before, total
        self.begin = time.monotonic()
        self.told = -math.inf
        self.share = before

    def __call__(self, done: float, failed: int) -> None:
        now = time.monotonic()
        due = done - self.share >= SHARE * self.total or now - self.told >= SELDOM
        if now - self.begin < SHORT or not (due or done == self.total):
            return
        self.told, self.share = now, int(done)
        _say(self.line(done, failed, now - self.begin))

    def line(self, done: float, failed: int, seconds: float) -> str:
        """Return how far it is."""
        parts = [f"{self.kind}: {int(done)} of {self.total} points ({done / self.total:.0%})"]
        rate = (done - self.before) / seconds
        if rate > 0.0:
            parts.append(f"{rate:.3g} points/s")
        if rate > 0.0 and done < self.total:
            parts.append(f"{_duration((self.total - done) / rate)} left")
        parts.append(f"{failed} failed")
        return ", ".join(parts)


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
