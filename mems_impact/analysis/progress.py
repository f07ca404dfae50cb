"""Progress of long work: one bar for all kinds of it, shown where somebody waits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["Report", "progress_bar", "values_of"]

Report = Callable[[float], None]


@contextmanager
def progress_bar(
    progress: bool | Callable[[float], None], unit: str, total: float | None = None
) -> Iterator[Report | None]:
    """Give what is called with all that is done so far; None where nobody listens.

    Parameters
    ----------
    progress : bool or callable
        True: a bar, if the work takes over a second. A function is handed on.
    unit : str
        What is counted.
    total : float, optional
        Where it ends, if that is known.
    """
    if callable(progress) or not progress:
        yield progress or None
        return
    from tqdm import tqdm

    with tqdm(total=total and round(total, 3), delay=1.0, unit=f" {unit}") as bar:
        yield lambda done: bar.update(done - bar.n) and None


@contextmanager
def values_of(
    progress: bool | Callable[[float], None], name: str, unit: str, out: Callable[[float], float]
) -> Iterator[Report | None]:
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
        return
    if not progress:
        yield None
        return
    from tqdm import tqdm

    with tqdm(delay=1.0, unit=f" {unit}") as bar:

        def show(value: float) -> None:
            bar.set_postfix_str(f"{name} = {out(value):.6g}", refresh=False)
            bar.update()

        yield show
