"""Progress of a study, and its warnings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from mems_impact._util.progress import QUIET_SECONDS, ProgressLog, is_interactive
from mems_impact._util.warning_scopes import CollectedWarning, first_of_each, warn
from mems_impact.errors import StartWarning
from mems_impact.studies.engine.study import Study

__all__ = ["Progress", "StudyProgress", "study_progress", "warned"]

Progress = bool | Callable[[float], None]
StudyProgress = Callable[[float, int], None]  # points done so far, and those of them that failed


@contextmanager
def study_progress(
    progress: Progress, kind: str, before: int, total: int
) -> Iterator[StudyProgress | None]:
    """Yield the progress callback of a study; None without progress.

    Parameters
    ----------
    progress : bool or callable
        True: a bar on a terminal, lines elsewhere, if the work takes more than one second, or
        three. A function is called with the points done so far.
    kind : str
        Kind of the study.
    before, total : int
        Number of points completed by earlier runs, and of all points.
    """
    if callable(progress):
        yield lambda done, failed: progress(done)
    elif not progress:
        yield None
    elif is_interactive():
        yield from _bar(kind, before, total)
    else:
        lines = ProgressLog("points", total, before, kind)
        yield lambda done, failed: lines(done, f"{failed} failed")


def _bar(kind: str, before: int, total: int) -> Iterator[StudyProgress]:
    from tqdm import tqdm

    with tqdm(desc=kind, initial=before, total=total, delay=QUIET_SECONDS, unit=" points") as bar:

        def show(done: float, failed: int) -> None:
            if failed:
                bar.set_postfix_str(f"{failed} failed", refresh=False)
            bar.update(int(done) - bar.n)

        yield show


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
            where = study.place(first.point)
            if first.category is StartWarning:  # all starts are checked, jumps only occasionally
                count = f"{len(points)} of {study.points} points"
                where = f"{count}, first {where}" if len(points) > 1 else f"{count}, {where}"
            message = f"{study.kind} ({where}): {first.message}"
            warn(message, first.category, first.subject)
