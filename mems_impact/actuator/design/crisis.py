"""Where an attractor with impacts ceases to exist, by simulation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mems_impact.actuator.drives import Drive
from mems_impact.actuator.parameters import Actuator
from mems_impact.actuator.system import kicked
from mems_impact.analysis.simulate import simulate
from mems_impact.analysis.state import State
from mems_impact.analysis.threads import Watch
from mems_impact.engines.options import Options
from mems_impact.errors import OrbitError

if TYPE_CHECKING:
    pass

__all__ = ["crisis"]

RAMP = 21  # amplitudes from where the attractor is first looked for to the on-boundary
TRIALS = 6  # states of the attractor from which the next amplitude is tried
SIMULATION = Options()


def crisis(
    actuator: Actuator,
    drive: Drive,
    *,
    below: float,
    begin: float | None = None,
    width: float | None = None,
    start: State | None = None,
    tolerance: float = 1e-6,
    periods: int = 2000,
    options: Options = SIMULATION,
    watch: Watch | None = None,
) -> float:
    """Find by simulation the amplitude at which an attractor with impacts ceases to exist.

    The amplitude is lowered in ever longer steps, each from states of the attractor before it,
    until none of them goes on impacting; the last step is then halved.

    Parameters
    ----------
    actuator : Actuator
    drive : Drive
        Its amplitude does not matter.
    below : float
        An amplitude at which there is such an attractor, such as the on-boundary.
    begin : float, optional
        The amplitude at which it is looked for first; `below` by default. Near a fold
        a run lingers where the orbit has vanished, so that a little above it is better.
    width : float, optional
        How far to look, `below` itself by default.
    start : State, optional
        From which it is looked for first; a kick by default.
    tolerance : float, optional
        Width of the last step, as a part of `below`.
    periods : int, optional
        Forcing periods for which the attractor has to persist. Just below the crisis a transient
        may last as long, so that the result is a little low; it rises with `periods`.
    options : Options, optional
    watch : callable, optional
        Called with the periods of the present run that are done, several times a second; an
        exception that it raises ends the search.

    Returns
    -------
    float
        The smallest amplitude at which the attractor was seen.

    Raises
    ------
    OrbitError
        If there is no such attractor at `below`, or it is still there `width` lower.
    """
    progress = watch or False

    def attractor(amplitude: float, starts: list[State]) -> list[State]:
        """Return states of the attractor at `amplitude`; none if all `starts` lead off it."""
        here = drive.replace(amplitude=amplitude)
        for start in starts:
            run = simulate(actuator, here, periods, initial=start, keep="statistics",
                           window=(0.75 * periods, periods), options=options,
                           progress=progress)  # fmt: skip
            if run.statistics["impacts"] > 0.0:
                states = [run.final]
                for _ in range(TRIALS - 1):
                    more = simulate(actuator, here, 7, initial=states[-1], options=options)
                    states.append(more.final)
                return states
        return []

    top, begin = below, below if begin is None else begin
    states = attractor(begin, [kicked(actuator) if start is None else start])
    if not states:
        raise OrbitError(f"no attractor with impacts at amplitude {begin:.9g}", "begin higher")
    for amplitude in np.linspace(begin, below, RAMP)[1:].tolist() if begin != below else ():
        here = drive.replace(amplitude=amplitude)
        states = [simulate(actuator, here, 50, initial=s, options=options).final for s in states]
    step, bottom = tolerance * below, 0.0
    least = below - (below if width is None else width)
    while True:
        trial = top - step
        if trial <= least:
            reason = f"the attractor with impacts is still there at amplitude {top:.9g}"
            raise OrbitError(reason, "look further down", top)
        found = attractor(trial, states)
        if not found:
            bottom = trial
            break
        top, states, step = trial, found, 2.0 * step
    while top - bottom > tolerance * below:
        trial = 0.5 * (top + bottom)
        found = attractor(trial, states)
        if found:
            top, states = trial, found
        else:
            bottom = trial
    return top
