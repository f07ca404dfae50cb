"""The voltages between which an orbit of one forcing period lasts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mems_impact.actuator.drives import Drive
from mems_impact.actuator.parameters import Actuator
from mems_impact.analysis.state import State
from mems_impact.analysis.values import Summarized
from mems_impact.errors import InvalidParameter, OrbitError

if TYPE_CHECKING:
    pass

__all__ = ["Window", "period_one_window"]


@dataclass(frozen=True, kw_only=True)
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

    low: float
    high: float
    low_kind: str
    high_kind: str

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

    The orbit is continued both ways until it grazes, folds or loses its stability.

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
    from mems_impact.analysis.branch import continue_orbit
    from mems_impact.analysis.finding import find_orbit

    amplitude = float(drive.amplitude)  # type: ignore[attr-defined]
    if not low < amplitude < high:
        raise InvalidParameter("amplitude", amplitude, f"between low = {low:g} and high = {high:g}")
    start = kicked(actuator) if guess is None else guess
    orbit = find_orbit(actuator, drive, guess=start, periods=1, transient=transient)
    if not (orbit.stable and orbit.admissible and len(orbit.impacts)):
        reason = f"at amplitude = {amplitude:g} there is no stable orbit with impacts of one period"
        raise OrbitError(reason, "take an amplitude inside the window", orbit)
    ends = []
    for stop in (low, high):
        branch = continue_orbit(orbit, "amplitude", stop=stop)
        first = branch.special_points[0] if branch.special_points else None
        ends.append((first.value, first.kind) if first is not None else (stop, "bound"))
    return Window(low=ends[0][0], low_kind=ends[0][1], high=ends[1][0], high_kind=ends[1][1])
