"""What is said of a study: how far it is, how fast, how long still, what failed; warnings once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from mems_impact.analysis.progress import SHORT, Lines, is_watched
from mems_impact.studies.study import Study
from mems_impact.telling import Told, first_of_each, tell
from mems_impact.warnings import StartWarning

__all__ = ["Notice", "Progress", "noticed", "warned"]

Progress = bool | Callable[[float], None]
Notice = Callable[[float, int], None]  # points done so far, and those of them that failed


@contextmanager
def noticed(progress: Progress, kind: str, before: int, total: int) -> Iterator[Notice | None]:
    """Give what is called now and then with what is done; None where nobody listens.

    Parameters
    ----------
    progress : bool or callable
        True: on a terminal a bar, elsewhere a line now and then, where the work takes over a
        second, or three. A function is called with the points done so far.
    kind : str
        What runs.
    before, total : int
        How many points were done by earlier runs, and how many there are.
    """
    if callable(progress):
        yield lambda done, failed: progress(done)
    elif not progress:
        yield None
    elif is_watched():
        yield from _bar(kind, before, total)
    else:
        lines = Lines("points", total, before, kind)
        yield lambda done, failed: lines(done, f"{failed} failed")


def _bar(kind: str, before: int, total: int) -> Iterator[Notice]:
    from tqdm import tqdm

    with tqdm(desc=kind, initial=before, total=total, delay=SHORT, unit=" points") as bar:

        def show(done: float, failed: int) -> None:
            if failed:
                bar.set_postfix_str(f"{failed} failed", refresh=False)
            bar.update(int(done) - bar.n)

        yield show


@contextmanager
def warned(study: Study) -> Iterator[list[Told]]:
    """Give a list for what is told of points; each subject is told once, with where it is met."""
    told: list[Told] = []
    try:
        yield told
    finally:
        told.sort(key=lambda each: each.point)
        for first in first_of_each(told):
            alike = (first.category, first.subject)
            points = {each.point for each in told if (each.category, each.subject) == alike}
            where = study.place(first.point)
            if first.category is StartWarning:  # all starts are looked at, jumps but now and then
                count = f"{len(points)} of {study.points} points"
                where = f"{count}, first {where}" if len(points) > 1 else f"{count}, {where}"
            message = f"{study.kind} ({where}): {first.message}"
            tell(message, first.category, first.subject)
