"""Simulation of a system."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Literal, get_args

from mems_impact._util.progress import progress_bar
from mems_impact._util.warning_scopes import warn
from mems_impact.analysis.run import Keep, Run
from mems_impact.analysis.settling import checkpoint_grid
from mems_impact.errors import FunctionError, Interrupted, InvalidParameter, LengthWarning, RunError
from mems_impact.hybrid.simulation import Events, Trajectory
from mems_impact.hybrid.simulation import run as integrate
from mems_impact.integrators.options import Options
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.dispatch import takes_system
from mems_impact.systems.observables import EventRecorder
from mems_impact.systems.state import State, is_number, positive
from mems_impact.systems.statistics import LazyStatistics
from mems_impact.systems.window_statistics import TimeWindow

# --- Runs until standstill

UNTIL_STILL = "still"
FIRST_PERIODS = 64  # of the first attempt
LENGTH_FACTOR = 4  # of the next attempt


def run_until_standstill(
    standstill_test: Callable[[Trajectory], float | None],
    attempt: Callable[[float], Run],
    run: Callable[[float], Run],
    max_periods: float,
) -> Run:
    """Return the run until standstill, or over `max_periods` periods if there is none.

    The steps of a run do not depend on its length, so that a standstill found in a longer run holds
    for the run that ends there. ``standstill_test(trajectory)`` returns the number of periods until
    standstill, or None; `attempt` and `run` return the run over a number of periods, with events
    and with the requested options.
    """
    length = min(float(FIRST_PERIODS), max_periods)
    while True:
        after = standstill_test(attempt(length).trajectory)
        if after is not None:
            return replace(run(after), ended=UNTIL_STILL)
        if length >= max_periods:
            return run(max_periods)
        length = min(LENGTH_FACTOR * length, max_periods)


# --- Simulation

DEFAULT_PERIODS_FORCED = 300  # of a system with forcing, by default
DEFAULT_TIME_SCALES = 100_000  # of a run of an autonomous system until an event, by default


@takes_system(start="initial", recurrent=False)
def simulate(
    system: HybridSystem,
    periods: float | None = None,
    *,
    duration: float | str | None = None,
    until: Callable[..., float] | Literal["still"] | None = None,
    initial: State | Mapping[str, float] | None = None,
    start: float | None = None,
    window: tuple[float, float] | None = None,
    keep: Keep = "events",
    options: Options = Options(),  # noqa: B008 - immutable
    progress: bool | Callable[[float], None] = False,
) -> Run:
    """Simulate a system, or an actuator under a drive: ``simulate(actuator, drive, …)``.

    Parameters
    ----------
    system : System, or Actuator and Drive
    periods : float, optional
        Length of the run in forcing periods, > 0; 300 by default.
    duration : float, optional
        Length of the run in time, instead of `periods`.
    until : callable or "still", optional
        ``until(mode, t, y, p)``, positive during the run, which ends where it falls through zero.
        For an actuator ``p`` holds the eleven parameters of the device, and ``"still"`` ends the
        run when the motion repeats without net displacement of the frame, or after `periods`;
        `Run.ended` holds the reason. Without a length, such a run takes at most 300 periods; of an
        autonomous system, 100,000 of its time scales.
    initial : State or mapping of str to float, optional
        Initial state; by default the initial state of the system.
    start : float, optional
        Time at which the run begins; by default the phase of the initial state, which is 0 without
        forcing. A run that continues another run, ``initial=run.final``, keeps the time with
        ``start=run.end``.
    window : tuple of float, optional
        First and last forcing period of the statistics, within the run and counted from the time
        0; by default the second half of the run. With `until`, the default is the whole run. Times
        for an autonomous system.
    keep : {"events", "statistics"}, optional
        ``"statistics"`` discards events, so that memory does not grow with the length of the run.
    options : Options, optional
        Options of the integration; method "adams" by default, and "auto" with a stiff term.
    progress : bool or callable, optional
        True: show progress if the run takes over a second. A function is called with the periods
        done, several times a second; an exception that it raises ends the run.

    Returns
    -------
    Run

    Raises
    ------
    InvalidParameter
        If an argument is out of range.
    RunError
        If the run fails; ``partial`` is the `Run` up to the failure.
    FunctionError
        If a function is wrong in a mode that this run is the first to reach; ``partial`` is the
        `Run`.

    Warns
    -----
    LengthWarning
        If `until` has not fallen through zero within the default length.

    See Also
    --------
    Run, find_orbit, sweep, System

    Notes
    -----
    By default an actuator starts at rest in the middle. The frame may slide at the start; a block
    on a stopper that moves towards the stopper strikes at once. A frame at rest sticks if static
    friction can hold the frame: the initial mode follows from Equation (4) of the paper.

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> run = mi.simulate(actuator, drive, periods=300)
    >>> run.statistics["impacts per period"].item()
    1.0
    >>> f"{run.statistics['displacement per period']:.3e}"
    '3.666e-04'
    >>> run.impacts["stopper"].iloc[-1]
    'right'
    """
    problem = system.problem(options)
    if isinstance(until, str):
        if until != UNTIL_STILL:
            raise InvalidParameter("until", until, "a function (mode, t, y, p), or 'still'")
        still = system.statistics.standstill_test()
        longest = _length(system, periods, duration, None, problem.period)
        again = partial(
            simulate, system, initial=initial, start=start, options=options, progress=progress
        )
        return run_until_standstill(still, again, partial(again, window=window, keep=keep), longest)
    if until is not None:
        system = system.ending(until)
        problem = system.problem(options)
    begin = system.state_space.instant(initial, problem, start=start)
    system.checks.start_side(problem, begin)
    unit = 1.0 if system.forced else float(system.units.out("time", problem.period))
    bounded = periods is not None or duration is not None
    periods = _length(system, periods, duration, until, problem.period)
    if keep not in get_args(Keep):
        raise InvalidParameter("keep", keep, f"one of {', '.join(get_args(Keep))}")
    half = until is None  # the end of the run is unknown, so all of it counts
    first, last = _window(window, begin.cycle + begin.time / problem.period, periods, unit, half)
    gather = partial(
        system.statistics.accumulator, problem, begin, TimeWindow(first, last, problem.period)
    )
    gatherer, recorder = gather(), EventRecorder()
    observers = [
        *system.checks.observers(problem, begin),
        recorder if keep == "events" else gatherer,
    ]

    def consume(events: Events) -> None:
        for observer in observers:
            observer(events)

    def finished(trajectory: Trajectory) -> Run:
        for observer in observers:
            observer.warn(trajectory)
        if recorder.chunks:
            trajectory = trajectory.with_events(Events.joined(recorder.chunks))
        lengths = [len(events) for events in recorder.chunks]
        return (system._run_type or Run)(
            system=system,
            options=problem.options,
            keep=keep,
            window=(first * unit, last * unit),
            trajectory=trajectory,
            ended="until" if trajectory.ended else "time",
            _gatherer=LazyStatistics(gather, trajectory.events, lengths) if lengths else gatherer,
        )

    with progress_bar(progress, "periods", periods, "simulate") as report:
        try:
            grid = checkpoint_grid(periods, last - first, forced=system.forced)
            trajectory = integrate(
                problem, begin, periods, consume=consume, progress=report, checkpoints=grid
            )
        except (RunError, Interrupted) as error:
            if isinstance(error.partial, Trajectory):
                error.partial = finished(error.partial)
            raise
    run = finished(trajectory)
    try:
        for observer in observers:
            observer.check()
        system.checks.run(run.trajectory)
    except FunctionError as error:
        error.partial = run
        raise
    if until is not None and not bounded and not trajectory.ended:
        length = f"periods={periods:g}" if system.forced else f"duration={periods * unit:g}"
        message = (
            f"until has not fallen through zero within the default length, {length}; give another "
            "length, or a function that falls"
        )
        warn(message, LengthWarning)
    return run


def _length(
    system: HybridSystem, periods: float | None, duration: Any, until: Any, period: float
) -> float:
    """Return the length of a run in periods of the problem."""
    duration = system.units.parse("time", duration, "duration")
    for field, value in (("periods", periods), ("duration", duration)):
        if value is not None:
            positive(field, value)
    if duration is not None:
        if periods is not None:
            raise InvalidParameter("duration", duration, "None where periods is given")
        return float(system.units.into("time", duration)) / period
    if system.forced:
        return float(DEFAULT_PERIODS_FORCED if periods is None else periods)
    if periods is not None or until is None:
        field = "duration" if periods is None else "periods"
        problem = "the system has no forcing period: give the duration"
        raise InvalidParameter(field, periods, "", problem=problem)
    return float(DEFAULT_TIME_SCALES)


def _window(
    window: tuple[float, float] | None, phase: float, periods: float, unit: float, half: bool
) -> tuple[float, float]:
    """Return the window in periods of the problem; `unit` is the unit of the argument."""
    end = phase + periods
    if window is None:
        return phase + (0.5 * periods if half else 0.0), end
    allowed = f"(first, last) with 0 <= first < last <= {end * unit:g}, the length of the run"
    try:
        first, last = (value / unit for value in window)
    except (TypeError, ValueError):
        raise InvalidParameter("window", window, allowed) from None
    numbers = is_number(first) and is_number(last)
    # The comparison must not depend on the last digits of a phase.
    if not (numbers and 0.0 <= first < last <= end * (1.0 + 1e-12) and last > phase):
        raise InvalidParameter("window", window, allowed)
    return max(float(first), phase), min(float(last), end)
