"""The voltage window of a period-1 orbit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mems_impact._util.formatting import stability_name
from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.parameters import numbers_for
from mems_impact.actuator.terms.base import drive_unit
from mems_impact.errors import InvalidParameter, OrbitError, RunError
from mems_impact.systems.result import SummaryRepr
from mems_impact.systems.state import State

if TYPE_CHECKING:
    from mems_impact._util.progress import Watch
    from mems_impact.analysis.branch import Branch
    from mems_impact.analysis.orbit import Orbit
    from mems_impact.analysis.special_points import SpecialPoint

STABILITY_LOSS_LABELS = (
    "G",
    "CF",
    "PD",
    "NS",
    "BP",
)  # labels of points at which a stable orbit ends
AMPLITUDE_STEP_BEYOND_JUMP = 1e-4  # relative distance beyond a jump of a run
JUMPS = 10  # that a window may span


@dataclass(frozen=True, kw_only=True, repr=False)
class PeriodOneWindow(SummaryRepr):
    """The voltage window of a stable period-1 orbit.

    Attributes
    ----------
    low, high : float
        Amplitudes [V] at the ends.
    low_kind, high_kind : str
        Special point at each end: "grazing", "fold", "period-doubling", …, or "bound" where the
        search ended.
    margin : float
        Half the width divided by the middle: the relative tolerance of a voltage in the middle.
    si : bool
        Whether the quantities are in SI, as of a device in SI.
    drive_unit : str
        SI unit of the amplitudes: "C" under a `ChargeDrive`.

    See Also
    --------
    period_one_window

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> window = mi.period_one_window(actuator, drive, (0.17, 0.26))
    >>> window.low < drive.amplitude < window.high
    True
    """

    low: float
    high: float
    low_kind: str
    high_kind: str
    si: bool = False
    drive_unit: str = "V"

    @property
    def _si_units(self) -> Mapping[str, str]:  # type: ignore[override]
        """SI units of the amplitudes."""
        return dict.fromkeys(("low", "high"), self.drive_unit)

    def summary(self) -> dict[str, Any]:
        """Return the ends, their special points and the margin."""
        return {name: each for name, each in super().summary().items() if name != "drive_unit"}

    @property
    def margin(self) -> float:  # noqa: D102 - above
        return (self.high - self.low) / (self.high + self.low)


def period_one_window(
    actuator: Actuator,
    drive: Drive,
    bounds: tuple[float, float],
    *,
    guess: State | None = None,
    transient: int = 300,
) -> PeriodOneWindow:
    """Compute the range of amplitudes of the stable period-1 orbit at `drive`.

    The orbit is continued in both directions until it grazes, folds or loses stability. A change of
    the slips of the frame does not end the window, nor does a jump to a stable period-1 orbit with
    as many impacts.

    Parameters
    ----------
    actuator : Actuator
    drive : Drive
        A drive with an ``amplitude`` at which the orbit is stable.
    bounds : tuple of float
        The lowest and the highest amplitude of the search [V].
    guess : State, optional
        An initial state that leads to the orbit; a kick by default.
    transient : int, optional
        Forcing periods to run before the orbit is computed.

    Returns
    -------
    PeriodOneWindow

    Raises
    ------
    OrbitError
        If the run from the guess does not lead to a stable orbit with impacts.

    See Also
    --------
    PeriodOneWindow, continue_solution, operating_chart

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> window = mi.period_one_window(actuator, drive, (0.17, 0.26))
    >>> window.low_kind, f"{window.low:.6f}"
    ('fold', '0.176515')
    """
    from mems_impact.actuator.state_space import kicked_state
    from mems_impact.analysis.orbit import find_orbit

    amplitude = float(drive.amplitude)  # type: ignore[attr-defined]
    low, high = numbers_for(actuator, "bounds", bounds, "V")
    if not low < amplitude < high:
        raise InvalidParameter("amplitude", amplitude, f"between the bounds {low:g} and {high:g}")
    start = kicked_state(actuator) if guess is None else guess
    orbit = find_orbit(actuator, drive, guess=start, periods=1, transient=transient)
    if not (orbit.stable and orbit.admissible and len(orbit.impacts)):
        flaw = stability_name(orbit.stable) if orbit.admissible else "inadmissible"
        flaw = flaw if len(orbit.impacts) else "without impacts"
        reason = f"at amplitude = {amplitude:g} the initial state leads to an orbit that is {flaw}"
        raise OrbitError(reason, "take an amplitude inside the window, or another guess", orbit)
    (low, low_kind, _), (high, high_kind, _) = (
        lasts_until(orbit, stop, transient) for stop in (low, high)
    )
    return PeriodOneWindow(
        low=low,
        low_kind=low_kind,
        high=high,
        high_kind=high_kind,
        si=actuator.scales.named,
        drive_unit=drive_unit(actuator.terms),
    )


def lasts_until(
    orbit: Orbit, stop: float, transient: int, watch: Watch | None = None
) -> tuple[float, str, SpecialPoint | None]:
    """Return the end of the window between `orbit` and an amplitude, and its kind.

    The third value is the special point at the end, if there is one. `watch` is called with each
    amplitude; an exception that it raises ends the search.
    """
    from mems_impact.analysis.branch import continue_solution
    from mems_impact.analysis.orbit import find_orbit

    value, kind = math.nan, ""
    ends: list[SpecialPoint] = []
    for _ in range(JUMPS):
        branch = continue_solution(
            orbit, "amplitude", stop, stop_at=STABILITY_LOSS_LABELS, progress=watch or False
        )
        value, kind = end_of(branch, stop)
        ends = [special for special in branch.special_points if special.value == value]
        if kind == "bound" or any(special.label in STABILITY_LOSS_LABELS for special in ends):
            break
        last = min(branch.orbits, key=lambda each: abs(each.system.parameters["amplitude"] - value))
        ahead = value + math.copysign(AMPLITUDE_STEP_BEYOND_JUMP * value, stop - value)
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
    """Return where the stable orbit at the start of a branch ends, and the kind of this end.

    The kind at the bound `stop` of the branch is "bound". Events of the frame, such as the end of a
    slip that coincides with an impact, may leave the orbit stable.
    """
    values = [orbit.system.parameters[branch.parameter] for orbit in branch.orbits]
    sign = math.copysign(1.0, stop - values[0])
    for special in branch.special_points:
        beyond = (
            orbit.stable and orbit.admissible
            for value, orbit in zip(values, branch.orbits, strict=True)
            if sign * (value - special.value) > 0.0
        )
        if special.label in STABILITY_LOSS_LABELS or not next(beyond, False):
            return special.value, special.kind
    reached = math.isclose(values[-1], stop, rel_tol=1e-9)
    return (stop, "bound") if reached else (values[-1], branch.ended)
