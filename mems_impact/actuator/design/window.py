"""The voltages between which an orbit of one forcing period lasts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mems_impact.actuator.drives import Drive
from mems_impact.actuator.parameters import Actuator
from mems_impact.analysis.state import State
from mems_impact.analysis.values import Summarized
from mems_impact.errors import InvalidParameter, OrbitError, RunError

if TYPE_CHECKING:
    from mems_impact.analysis.branch import Branch
    from mems_impact.analysis.orbit import Orbit
    from mems_impact.analysis.special import SpecialPoint

__all__ = ["Window", "end_of", "lasts_until", "period_one_window"]

BIFURCATIONS = ("G", "CF", "PD", "NS", "BP")  # labels of points at which a stable orbit ends
AHEAD = 1e-4  # part of an amplitude by which a run is beyond a jump
JUMPS = 10  # that a window may span


@dataclass(frozen=True, kw_only=True, repr=False)
class Window(Summarized):
    """The voltages between which an orbit lasts.

    Attributes
    ----------
    low, high : float
        Amplitudes [V] at the ends.
    low_kind, high_kind : str
        What happens there: "grazing", "fold", "period-doubling", …, or "bound" where the search
        ended.
    margin : float
        Half the width over the middle: how far off, relatively, a voltage in the middle may be.
    si : bool
        Whether these are in SI, those of a device that is.

    See Also
    --------
    period_one_window

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> window = mi.period_one_window(actuator, drive, low=0.17, high=0.26)
    >>> window.low < drive.amplitude < window.high
    True
    """

    si_units = {"low": "V", "high": "V"}  # noqa: RUF012 - ClassVar in Summarized

    low: float
    high: float
    low_kind: str
    high_kind: str
    si: bool = False

    @property
    def margin(self) -> float:  # noqa: D102 - above
        return (self.high - self.low) / (self.high + self.low)


def period_one_window(
    actuator: Actuator,
    drive: Drive,
    *,
    low: float,
    high: float,
    guess: State | None = None,
    transient: int = 300,
) -> Window:
    """Return between which amplitudes the stable orbit of one forcing period at `drive` lasts.

    The orbit is continued both ways until it grazes, folds or loses its stability. Where only the
    slips of the frame change, it goes on, also where the motion jumps to a stable orbit of one
    period with as many impacts.

    Parameters
    ----------
    actuator : Actuator
    drive : Drive
        With an ``amplitude`` at which the orbit is stable.
    low, high : float
        Where the search ends.
    guess : State, optional
        A state that leads to the orbit; a kick by default.
    transient : int, optional
        Forcing periods to run before the orbit is read.

    Returns
    -------
    Window

    Raises
    ------
    OrbitError
        If the run from the guess does not lead to a stable orbit with impacts.

    See Also
    --------
    Window, continue_orbit, operating_chart

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> window = mi.period_one_window(actuator, drive, low=0.17, high=0.26)
    >>> window.low_kind, f"{window.low:.6f}"
    ('fold', '0.176515')
    """
    from mems_impact.actuator.system import kicked
    from mems_impact.analysis.finding import find_orbit

    amplitude = float(drive.amplitude)  # type: ignore[attr-defined]
    if not low < amplitude < high:
        raise InvalidParameter("amplitude", amplitude, f"between low = {low:g} and high = {high:g}")
    start = kicked(actuator) if guess is None else guess
    orbit = find_orbit(actuator, drive, guess=start, periods=1, transient=transient)
    if not (orbit.stable and orbit.admissible and len(orbit.impacts)):
        reason = f"at amplitude = {amplitude:g} there is no stable orbit with impacts of one period"
        raise OrbitError(reason, "take an amplitude inside the window", orbit)
    (low, low_kind, _), (high, high_kind, _) = (
        lasts_until(orbit, stop, transient) for stop in (low, high)
    )
    return Window(
        low=low, low_kind=low_kind, high=high, high_kind=high_kind, si=actuator.scales.named
    )


def lasts_until(
    orbit: Orbit, stop: float, transient: int
) -> tuple[float, str, SpecialPoint | None]:
    """Return the end of the window between `orbit` and an amplitude, and what happens there.

    With the special point at which it ends, if it does at one.
    """
    from mems_impact.analysis.branch import continue_orbit
    from mems_impact.analysis.finding import find_orbit

    value, kind = math.nan, ""
    ends: list[SpecialPoint] = []
    for _ in range(JUMPS):
        branch = continue_orbit(orbit, "amplitude", stop=stop)
        value, kind = end_of(branch, stop)
        ends = [special for special in branch.special_points if special.value == value]
        if kind == "bound" or any(special.label in BIFURCATIONS for special in ends):
            break
        last = min(branch.orbits, key=lambda each: abs(each.system.value("amplitude") - value))
        ahead = value + math.copysign(AHEAD * value, stop - value)
        if (stop - ahead) * (stop - value) <= 0.0:
            break
        try:
            system = last.system.changed(amplitude=ahead)
            orbit = find_orbit(system, guess=last.state, periods=1, transient=transient)
        except (OrbitError, RunError):
            break
        if not orbit.stable or len(orbit.impacts) != len(last.impacts):
            break
    return value, kind, ends[0] if ends else None


def end_of(branch: Branch, stop: float) -> tuple[float, str]:
    """Return where the stable orbit ends with which a branch begins, and what happens there.

    Events of the frame, such as the end of a slip that meets an impact, may leave it stable.

    Parameters
    ----------
    branch : Branch
    stop : float
        Where it was to end: its end is a "bound" then.
    """
    values = [orbit.system.value(branch.parameter) for orbit in branch.orbits]
    way = math.copysign(1.0, stop - values[0])
    for special in branch.special_points:
        beyond = (
            orbit.stable and orbit.admissible
            for value, orbit in zip(values, branch.orbits, strict=True)
            if way * (value - special.value) > 0.0
        )
        if special.label in BIFURCATIONS or not next(beyond, False):
            return special.value, special.kind
    reached = math.isclose(values[-1], stop, rel_tol=1e-9)
    return (stop, "bound") if reached else (values[-1], branch.ended)
