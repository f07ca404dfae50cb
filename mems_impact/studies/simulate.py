"""One run of the actuator under a drive, from an initial state."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import get_args

import numpy as np

from mems_impact.actuator.drive import Drive
from mems_impact.actuator.modes import STATES
from mems_impact.actuator.parameters import Actuator
from mems_impact.engines.options import Options
from mems_impact.errors import InvalidParameter, RunError, RunInterrupted
from mems_impact.hybrid import run as hybrid
from mems_impact.hybrid.trajectory import Events, Instant, Trajectory
from mems_impact.studies.impacts import concatenate
from mems_impact.studies.run import Keep, Run, problem_of
from mems_impact.studies.state import State, is_number
from mems_impact.studies.statistics import Accumulator

__all__ = ["simulate"]


def simulate(
    actuator: Actuator,
    drive: Drive,
    periods: float = 300,
    *,
    initial: State = State(),  # noqa: B008 - immutable
    window: tuple[float, float] | None = None,
    keep: Keep = "events",
    options: Options = Options(),  # noqa: B008 - immutable
    progress: bool | Callable[[float], None] = False,
) -> Run:
    """Simulate the actuator under a drive.

    Parameters
    ----------
    actuator : Actuator
    drive : Drive
        In the units of the actuator, as all that is given and returned.
    periods : float, optional
        Length of the run in forcing periods, > 0.
    initial : State, optional
        At rest in the middle by default. A sliding frame is allowed; a block on a stopper that
        moves into it strikes at once. The frame at rest stays so if static friction holds it.
    window : tuple of float, optional
        First and last forcing period of the statistics, within the run; its last half by default.
        Periods are counted from the start of the forcing period in which the run begins.
    keep : {"events", "statistics"}, optional
        ``"statistics"`` keeps no events, so that memory does not grow with the run.
    options : Options, optional
        How it is integrated.
    progress : bool or callable, optional
        True: show a progress bar if the run takes over a second. A function is called with the
        periods done, several times a second; an exception that it raises ends the run.

    Returns
    -------
    Run

    Raises
    ------
    InvalidParameter
        If an argument is out of range.
    RunError
        If the run cannot go on; its ``trajectory`` is the `Run` up to there.

    Notes
    -----
    Equations (1) to (6) of the paper, and rest contact, which the paper leaves out. The initial
    mode follows from Equation (4).
    """
    problem = problem_of(actuator, drive, options)
    start = instant_of_state(actuator, drive, initial)
    if not is_number(periods) or periods <= 0.0:
        raise InvalidParameter("periods", periods, "a finite number > 0")
    if keep not in get_args(Keep):
        raise InvalidParameter("keep", keep, f"one of {', '.join(get_args(Keep))}")
    window = _window(window, start.time / problem.period, periods)
    accumulator = Accumulator(actuator.to_dimensionless(), problem.period, start, window)
    kept: list[Events] = []

    def consume(events: Events) -> None:
        accumulator(events)
        if keep == "events":
            kept.append(events)

    def finished(trajectory: Trajectory) -> Run:
        if kept:
            trajectory = replace(trajectory, events=concatenate(kept))
        return Run(
            actuator=actuator,
            drive=drive,
            options=options,
            keep=keep,
            window=window,
            trajectory=trajectory,
            _accumulator=accumulator,
        )

    with _reporting(progress, periods) as report:
        try:
            trajectory = hybrid.run(problem, start, periods, consume=consume, progress=report)
        except (RunError, RunInterrupted) as error:
            if isinstance(error.trajectory, Trajectory):
                error.trajectory = finished(error.trajectory)
            raise
    return finished(trajectory)


def instant_of_state(actuator: Actuator, drive: Drive, initial: State) -> Instant:
    if not isinstance(initial, State):
        raise InvalidParameter("initial", initial, "a State(x2=…, v2=…)")
    if not abs(initial.x2) <= actuator.delta:
        delta = f"{actuator.delta:g}"
        raise InvalidParameter("x2", initial.x2, f"between the stoppers at -{delta} and {delta}")
    if not initial.time < drive.period:
        raise InvalidParameter("time", initial.time, f"below the forcing period {drive.period:g}")
    initial = initial.inner(actuator.scales)
    problem = problem_of(actuator, drive, Options())
    y = np.array([getattr(initial, name) for name in STATES], dtype=float)
    time = min(float(initial.time), math.nextafter(problem.period, 0.0))  # scaling may round it up
    automaton = problem.automaton
    mode = automaton.transition(0, automaton.switch_code, time, y, problem.parameters)
    return Instant(0, time, mode, y)


def _window(
    window: tuple[float, float] | None, phase: float, periods: float
) -> tuple[float, float]:
    end = phase + periods
    if window is None:
        return phase + 0.5 * periods, end
    allowed = f"(first, last) with 0 <= first < last <= {end:g}, the length of the run"
    try:
        first, last = window
    except (TypeError, ValueError):
        raise InvalidParameter("window", window, allowed) from None
    numbers = is_number(first) and is_number(last)
    # The last digits of a phase shall not matter.
    if not (numbers and 0.0 <= first < last <= end * (1.0 + 1e-12) and last > phase):
        raise InvalidParameter("window", window, allowed)
    return max(float(first), phase), min(float(last), end)


@contextmanager
def _reporting(
    progress: bool | Callable[[float], None], periods: float
) -> Iterator[Callable[[float], None] | None]:
    """Give what the event loop calls with the periods done; with a bar while it is shown."""
    if callable(progress) or not progress:
        yield progress or None
        return
    from tqdm import tqdm

    with tqdm(total=round(periods, 3), delay=1.0, unit=" periods") as bar:
        yield lambda done: bar.update(done - bar.n) and None
