"""How far an orbit is from its next bifurcation, along single parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from mems_impact.analysis.orbit import Orbit
from mems_impact.analysis.special import check_kind
from mems_impact.analysis.state import is_number
from mems_impact.continuation.branch import OrbitBranch, Steps, points_of
from mems_impact.errors import InvalidParameter
from mems_impact.studies.moving import BIFURCATIONS

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["margins"]


class _End(NamedTuple):
    at: float
    what: str


def margins(orbit: Orbit, parameters: Sequence[str], reach: float = 0.5) -> pd.DataFrame:
    """Return how far parameters may move, one at a time, before an orbit bifurcates.

    The orbit is followed both ways, until it grazes, folds, doubles its period or otherwise loses
    its stability, or until what else ends it.

    Parameters
    ----------
    orbit : Orbit
        Stable.
    parameters : sequence of str
    reach : float, optional
        How far to look: the part of a parameter's value, in (0, 1].

    Returns
    -------
    DataFrame
        One row a parameter and direction: parameter, value, direction ("down", "up"), at (where it
        happens; the end of the way where nothing does), margin (to there), relative (to the value)
        and what happens ("" for nothing).

    Raises
    ------
    InvalidParameter
        If there is no such parameter, or it is 0, or `reach` is out of range.

    See Also
    --------
    sensitivity, continue_orbit, period_one_window

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked(actuator))
    >>> table = mi.margins(orbit, ["amplitude"])
    >>> table.columns.tolist()
    ['parameter', 'value', 'direction', 'at', 'margin', 'relative', 'what']
    """
    import pandas as pd

    check_kind(orbit, "orbit", Orbit, "an Orbit, from find_orbit")
    if not (is_number(reach) and 0.0 < reach <= 1.0):
        raise InvalidParameter("reach", reach, "in (0, 1]")
    system, rows = orbit.system, []
    for name in parameters:
        system.check_continued(name)
        here = system.value(name)
        if here == 0.0:
            raise InvalidParameter(name, here, "another value than 0, of which reach is a part")
        for direction, sign in (("down", -1.0), ("up", 1.0)):
            stop = _allowed(orbit, name, here + sign * reach * abs(here))
            end = _next(orbit, name, stop)
            margin = abs(end.at - here)
            rows.append((name, here, direction, end.at, margin, margin / abs(here), end.what))
    headings = ["parameter", "value", "direction", "at", "margin", "relative", "what"]
    table = pd.DataFrame(rows, columns=headings)
    table.attrs = {"system": repr(system)}
    return table


def _allowed(orbit: Orbit, name: str, stop: float) -> float:
    """Return `stop`, or what is nearest to it of what a parameter may be."""
    here = orbit.system.value(name)
    for part in (1.0, 0.9, 0.75, 0.5, 0.25, 0.1, 0.01):
        try:
            orbit.system.changed(**{name: here + part * (stop - here)})
        except InvalidParameter:
            continue
        return here + part * (stop - here)
    return here


def _next(orbit: Orbit, name: str, stop: float) -> _End:
    system, here = orbit.system, orbit.found.family.value(name)
    end = system.into(name, stop)
    if end == here:
        return _End(stop, "the end of its range")
    branch, last = OrbitBranch(name), here
    low, high = min(here, end), max(here, end)
    sign = math.copysign(1.0, end - here)
    steps = Steps(largest=0.02)
    for point in points_of(branch, orbit.found, low=low, high=high, direction=sign, steps=steps):
        for each in branch.special_points:
            if each.label in BIFURCATIONS:
                return _End(float(system.out(name, each.value)), each.kind)
        last = point.value
        if last == end:
            return _End(stop, "")
    return _End(float(system.out(name, last)), branch.ended)
