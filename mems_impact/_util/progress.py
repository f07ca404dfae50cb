"""Progress of long computations: a bar on a terminal, lines in a log, or a callback."""

from __future__ import annotations

import itertools
import logging
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

Progress = bool | Callable[[float], None]
Watch = Callable[[float], None]
"""Called by a computation with its progress; an exception that it raises ends the computation."""

_log = logging.getLogger("mems_impact")

QUIET_SECONDS = 1.0  # s before a bar appears
MIN_LINE_SECONDS = 3.0  # s before the first line, and the least time between two lines
MAX_LINE_SECONDS = 30.0  # s after which a line is due
UPDATE_SHARE = 0.1  # share of the work after which a line is due


class Report(Protocol):
    """Takes the amount of finished work, and a note that is shown with it."""

    def __call__(self, done: float, note: str = "") -> None:
        """Report progress; an exception ends the computation."""


@contextmanager
def progress_bar(
    progress: Progress,
    unit: str,
    total: float | None = None,
    work: str = "",
    finished_work: float = 0.0,
) -> Iterator[Report | None]:
    """Yield a function to be called with the amount of finished work; None without listener.

    `progress` True shows a bar after one second on a terminal, and elsewhere lines after three
    seconds; a function is called with the amount. Work is counted in `unit`, and named by `work`;
    `finished_work` was done by earlier runs.
    """
    if callable(progress):
        yield lambda done, note="": progress(done)
    elif not progress:
        yield None
    elif is_interactive():
        from tqdm import tqdm

        # Whole numbers, but for a few periods and a part of one.
        whole = total is None or total >= 10.0 or float(total).is_integer()
        total = total and (round(total) if whole else round(total, 3))
        with tqdm(
            desc=work or None,
            initial=int(finished_work) if whole else finished_work,
            total=total,
            delay=QUIET_SECONDS,
            unit=f" {unit}",
        ) as bar:
            created, started = time.time(), False

            def show(done: float, note: str = "") -> None:
                nonlocal started
                if note:
                    bar.set_postfix_str(note, refresh=False)
                amount = int(done) if whole else round(done, 3)
                if started:
                    bar.update(amount - bar.n)
                    return
                # The time until here holds loading and compiling, which the rate does not count.
                started, bar.last_print_t = True, time.time()
                bar.initial = bar.n = bar.last_print_n = amount
                if bar.last_print_t - created > QUIET_SECONDS:
                    bar.refresh()

            yield show
    else:
        yield ProgressLog(unit, total, finished_work, work)


@contextmanager
def parameter_progress(
    progress: Progress, name: str, unit: str, out: Callable[[float], float]
) -> Iterator[Watch | None]:
    """Yield a function to be called with each value of a parameter that a continuation passes.

    Work is counted in `unit`, one per value; `out` converts a value from the units of the numerics
    to the user's units. `progress` as in `progress_bar`.
    """
    if callable(progress):
        yield lambda value: progress(out(value))
        return
    with progress_bar(progress, unit, work=f"continue in {name}") as report:
        passed = itertools.count(1)
        yield report and (lambda value: report(next(passed), f"{name} = {out(value):.6g}"))


def is_interactive() -> bool:
    """Return whether standard error is a terminal; it may be closed."""
    return sys.stderr is not None and sys.stderr.isatty()


class ProgressLog:
    """Progress lines for a log: after 3 s, then every 10 % or 30 s, and at the end.

    Work shorter than 3 s is not reported. Arguments as in `progress_bar`; `kind` names the
    computation.
    """

    def __init__(
        self, unit: str, total: float | None = None, finished_work: float = 0.0, kind: str = ""
    ) -> None:
        self.unit, self.total = unit, total
        self.kind = f"{kind}: " if kind else ""
        self.begin = time.monotonic()
        self.first: tuple[float, float] | None = None  # time and amount of the first report
        self.last_line = -math.inf
        self.share = finished_work

    def __call__(self, done: float, note: str = "") -> None:
        """Write a line if one is due, with the note at its end."""
        now = time.monotonic()
        # The time until the first report holds loading and compiling.
        self.first = self.first or (now, done)
        since = now - self.last_line
        due = since >= MAX_LINE_SECONDS
        if self.total is not None:
            due |= since >= MIN_LINE_SECONDS and done - self.share >= UPDATE_SHARE * self.total
            due |= done == self.total and self.last_line > -math.inf
        if now - self.begin < MIN_LINE_SECONDS or not due:
            return
        self.last_line, self.share = now, done
        begin, finished_work = self.first
        rate = (done - finished_work) / (now - begin) if now > begin else 0.0
        _say(self.line(done, rate, note))

    def line(self, done: float, rate: float, note: str = "") -> str:
        """Return a progress line."""
        if self.total is None:
            parts = [f"{self.kind}{int(done)} {self.unit}"]
        else:
            of = f"{int(done)} of {int(self.total)} {self.unit}"
            parts = [f"{self.kind}{of} ({done / self.total:.0%})"]
        if rate > 0.0:
            parts.append(f"{rate:.3g} {self.unit}/s")
        if self.total is not None and rate > 0.0 and done < self.total:
            parts.append(f"{_duration((self.total - done) / rate)} left")
        return ", ".join([*parts, note] if note else parts)


def _duration(seconds: float) -> str:
    for unit, size in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.0f} s"


def _say(text: str) -> None:
    """Write a line to the log if it has a handler, and otherwise to standard error."""
    if _log.hasHandlers() and _log.isEnabledFor(logging.INFO):
        _log.info(text)
    elif sys.stderr is not None:
        sys.stderr.write(f"mems-impact: {text}\n")
        sys.stderr.flush()
