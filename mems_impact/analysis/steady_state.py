"""Steady state that a run approaches."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from mems_impact.analysis.orbit import ORBIT_OPTIONS, Orbit, find_orbit
from mems_impact.analysis.run import Run
from mems_impact.analysis.settling import SETTLING_RTOL
from mems_impact.analysis.simulate import simulate
from mems_impact.errors import InvalidParameter, OrbitError, RunError
from mems_impact.systems.result import check_kind
from mems_impact.systems.settling import CHANGING, FLUCTUATING, SETTLED

LONGEST = 64.0  # length of the continuation, relative to that of the run
FLUCTUATION = 4.0  # the same for a motion that does not become periodic
ATTRACTING = 1.0 - 1e-5  # largest modulus of the multipliers of an orbit
AGREEMENT = 3.0  # errors of a limit within which the orbit has it


def steady_state(run: Run, *, progress: bool | Callable[[float], None] = False) -> Run:
    """Continue a run until its statistics have settled.

    A run that has settled is returned unchanged. Otherwise the stable periodic orbit near its end
    is measured, if its statistics are the limits that the run approaches. Without such an orbit the
    run is continued until it has settled, for up to 64 times its length. A motion that does not
    become periodic is continued for four times its length; `Run.settling` has the statistical
    error.

    Parameters
    ----------
    run : Run
    progress : bool or callable, optional
        As for `simulate`.

    Returns
    -------
    Run
        A run with a window of the same length, or of whole periods of the orbit.

    Raises
    ------
    RunError
        If the continuation fails.

    See Also
    --------
    Settling, simulate, find_orbit

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> run = mi.simulate(actuator, mi.Sine(amplitude=0.24, omega=0.5), periods=30)
    >>> run.settling.kind, mi.steady_state(run).settling.kind
    ('changing', 'settled')
    """
    check_kind(run, "run", Run, "a Run, as mems_impact.simulate returns it")
    first, last = run.window
    measured, begin = last - first, run.extent[0] * run.unit
    done = last - begin
    longest, irregular = LONGEST * done, FLUCTUATION * done
    while run.settling.kind != SETTLED:
        settled = _on_orbit(run, measured, progress)
        if settled is not None:
            return settled
        if done >= longest or (run.settling.kind == FLUCTUATING and done >= irregular):
            return run
        wanted = run.settling.periods - done if math.isfinite(run.settling.periods) else done
        more = min(max(wanted, 0.5 * done), 4.0 * done, longest - done)
        run = _continued(run, math.ceil(more) if run.system.forced else more, measured, progress)
        done += more
    return run


def _continued(run: Run, more: float, measured: float, progress: Any) -> Run:
    """Return a run from the end of another run, with a window of the same length at its end."""
    return _measured(run, run.final, max(more, measured), measured, progress)


def _measured(run: Run, start: Any, length: float, measured: float, progress: Any) -> Run:
    last = length + (start.time / run.system.forcing_period if run.system.forced else 0.0)
    extent: dict[str, Any] = {"periods" if run.system.forced else "duration": length}
    again: Run = simulate(
        run.system,
        **extent,
        initial=start,
        window=(last - measured, last),
        keep=run.keep,
        options=run.options,
        progress=progress,
    )
    return again


def _on_orbit(run: Run, measured: float, progress: Any) -> Run | None:
    """Return a run on the stable orbit that a run approaches; None without one."""
    try:
        options = replace(ORBIT_OPTIONS, engine=run.options.engine)
        system = run.system.without_integrals  # whose orbits are less work
        start: dict[str, Any] = {} if system is run.system else {"guess": run.final}
        orbit: Orbit = find_orbit(system if start else run, options=options, **start)
        if not (orbit.admissible and np.abs(orbit.multipliers).max(initial=0.0) < ATTRACTING):
            return None
        n = orbit.periods if run.system.forced else orbit.period
        length = n * math.ceil(measured / n - 1e-9)
        other = _measured(run, orbit.state, length, length, progress)
    except (InvalidParameter, OrbitError, RunError):
        return None
    if other.settling.kind == CHANGING:
        return None
    for name, row in run.settling.rows.items():
        value = other._scaled_statistics.get(name, math.nan)
        apart = abs(value - row.limit) - SETTLING_RTOL * abs(value)
        if math.isfinite(row.error) and apart > AGREEMENT * row.error:
            return None
    return other
