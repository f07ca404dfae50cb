"""Sweeps: one parameter slowly increased or decreased, every value from the last state before."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from typing import TYPE_CHECKING, Literal

import numpy as np

from mems_impact.analysis.run import check_direction
from mems_impact.analysis.state import State, is_number, whole
from mems_impact.analysis.system import System
from mems_impact.analysis.verbs import takes_system
from mems_impact.engines.options import Options
from mems_impact.errors import InvalidParameter
from mems_impact.interruptions import StudyInterrupted, SweepInterrupted
from mems_impact.studies.chains import SweepStudy
from mems_impact.studies.running import run_study

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike

__all__ = ["sweep"]

TRANSIENT, PERIODS = 300, 60  # of a system with forcing, where nothing is said
CHAINS = {"up": ("up",), "down": ("down",), "both": ("up", "down")}


@takes_system(start="initial")
def sweep(
    system: System,
    parameter: str,
    values: ArrayLike,
    *,
    direction: Literal["up", "down", "both"] = "up",
    transient: float | None = None,
    periods: int | None = None,
    duration: float | None = None,
    section: Literal[1, -1, 0] = 1,
    initial: State | Mapping[str, State] | None = None,
    options: Options = Options(),  # noqa: B008 - immutable
    progress: bool | Callable[[float], None] = False,
    workers: int | None = None,
    store: str | os.PathLike[str] | None = None,
    executor: Executor | Callable[[], Executor] | None = None,
) -> pd.DataFrame:
    """Vary one parameter slowly; every value starts from the last state of the value before.

    Parameters
    ----------
    system : System, or Actuator and Drive
    parameter : str
        One of the system's: of an actuator, a number of the drive (``"amplitude"``, ``"omega"``, …)
        or of the device.
    values : array_like of float
        Values of the parameter, in any order.
    direction : {"up", "down", "both"}, optional
        Ascending, descending, or one chain of each.
    transient, periods : int, optional
        Forcing periods that each value is given to settle, and that are then measured; 300 and 60
        by default.
    duration : float, optional
        The time to measure, where nothing forces the system; `transient` is a time there, too, and
        both have to be given.
    section : {1, -1, 0}, optional
        Which crossings of the Poincaré section are kept: upwards, downwards or both. A system
        without a section is looked at where its forcing periods begin; where nothing forces it, at
        the local maxima of each state.
    initial : State or mapping of str to State, optional
        Where each chain starts: one state for all, or one for ``"up"`` and one for ``"down"``; the
        system's start by default. Of an actuator, up starts at rest in the middle and down with a
        kick (see `kicked`), so that a range with two attractors shows both.
    options : Options, optional
    progress : bool or callable, optional
        Show how far it is, if the sweep takes over a second: a bar on a terminal, else a line now
        and then. A function is called with the values done.
    workers : int, optional
        Threads; each chain is run by one at a time. The results do not depend on it.
    store : str or os.PathLike, optional
        A directory in which values are kept as they are done: a sweep that is interrupted or
        killed goes on from there.
    executor : concurrent.futures.Executor or callable, optional
        What computes: threads by default; processes, a cluster's, or a function that makes one.

    Returns
    -------
    DataFrame
        One row a crossing of the section: the parameter, direction ("up" or "down"), period
        (counted from the end of the transient), v2, v1, and for each value impacts per period,
        blows per period (see `mems_impact.Blows`), displacement per period and per impact (the
        step; NaN without an impact), mean speed and status. A value without any crossing is one
        row with NaN for what belongs to a crossing. So is one that failed, with NaN for all; its
        status is the reason rather than "ok", and the chain goes on from the last good state.
        Where nothing forces the system, crossings have a number, from 0, in place of the period,
        and impacts are counted per time. Of maxima the k-th of each state stand in one row, with
        NaN where a state has no more; a state at rest has its value for the only one.

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or a value is not allowed for the parameter.
    SweepInterrupted
        On Ctrl-C; its ``table`` holds the values done.

    See Also
    --------
    sweep_summary, plot_sweep, operating_map, continue_orbit

    Notes
    -----
    Where the forcing period changes, the phase of the drive is carried over as a fraction of it.

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> table = mi.sweep(actuator, drive, "amplitude", [0.2, 0.24], transient=100, periods=10)
    >>> summary = mi.sweep_summary(table)
    >>> summary["impacting"].tolist()  # from rest: off, then on
    [False, True]
    """
    if direction not in CHAINS:
        raise InvalidParameter("direction", direction, f"one of {', '.join(CHAINS)}")
    check_direction("section", section)
    settling, length = _spans(system, transient, periods, duration)
    system.check_parameter(parameter)
    ascending = np.sort(_numbers(values)).tolist()
    ends = {"up": ascending[0], "down": ascending[-1]}
    study = SweepStudy(
        system=system,
        parameter=parameter,
        values=tuple(ascending),
        starts={
            name: _initial(initial, name, system.changed(**{parameter: ends[name]}))
            for name in CHAINS[direction]
        },
        transient=settling,
        length=length,
        section=section,
        options=options,
    )
    for number in range(len(ascending)):
        study.case(number)  # all values are checked before the first is computed
    for start in study.starts.values():
        system.instant(start, system.problem(options))
    try:
        return run_study(
            study,
            store=store,
            executor=executor,
            workers=workers,
            progress=progress,
            # An interruption shall cost one value, where values need not go far to be kept.
            chunk=1 if store is None and executor is None else None,
        )
    except StudyInterrupted as stop:
        raise SweepInterrupted(stop.table, stop.done, stop.total) from None


def _spans(
    system: System, transient: float | None, periods: int | None, duration: float | None
) -> tuple[float, float]:
    """Return how long each value settles and is measured: forcing periods, or times without."""
    if system.forced:
        if duration is not None:
            problem = "the system has a forcing period, by which a sweep counts: give periods="
            raise InvalidParameter("duration", duration, "", problem=problem)
        settling = TRANSIENT if transient is None else whole("transient", transient, 0)
        return settling, PERIODS if periods is None else whole("periods", periods, 1)
    if periods is not None:
        problem = "the system has no forcing period: give duration=, a time"
        raise InvalidParameter("periods", periods, "", problem=problem)
    if transient is None or duration is None:
        problem = (
            "nothing forces the system: say how long each value settles and is measured, in time "
            "(transient=…, duration=…)"
        )
        missing = "duration" if duration is None else "transient"
        raise InvalidParameter(missing, None, "", problem=problem)
    for field, value, least in (("transient", transient, ">= 0"), ("duration", duration, "> 0")):
        if not is_number(value) or value < 0.0 or (value == 0.0 and field == "duration"):
            raise InvalidParameter(field, value, f"a finite number {least}")
    return float(transient), float(duration)


def _initial(initial: State | Mapping[str, State] | None, name: str, system: System) -> State:
    if isinstance(initial, Mapping):
        unknown = set(initial) - {"up", "down"}
        if unknown:
            raise InvalidParameter("initial", sorted(unknown), "given for 'up' and 'down' alone")
        initial = initial.get(name)
    if initial is None:
        return system.start_of(name)
    if not isinstance(initial, State):
        raise InvalidParameter("initial", initial, "a State, or a mapping of 'up', 'down' to State")
    return initial


def _numbers(values: ArrayLike) -> np.ndarray:
    allowed = "one or more finite numbers"
    try:
        numbers = np.atleast_1d(np.asarray(values, dtype=float))
    except (TypeError, ValueError):
        raise InvalidParameter("values", values, allowed) from None
    if numbers.ndim != 1 or numbers.size == 0 or not np.isfinite(numbers).all():
        raise InvalidParameter("values", values, allowed)
    return numbers
