"""Types of sliding bifurcations and of other bifurcations at discontinuities."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

from mems_impact.continuation.branch import OrbitEvent
from mems_impact.continuation.sliding import TYPE_LABELS, discontinuity
from mems_impact.hybrid.event_loop.workspace import NONE
from mems_impact.hybrid.state import HybridState
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.state import State


@dataclass(frozen=True, eq=False)
class SlidingType(str):
    """Type of a bifurcation at a discontinuity: a string, with the numbers of its criterion.

    At the boundary of the sliding region of a surface (sticking, for dry friction), where one of
    the two fields is tangent to the surface:

    - "grazing-sliding": the orbit arrives and departs with the tangent field;
    - "crossing-sliding": the orbit arrives with the other field, departs with the tangent field;
    - "switching-sliding": the orbit arrives with the other field, and slides;
    - "adding-sliding": a sliding orbit touches the boundary.

    Elsewhere:

    - "border collision": an event coincides with a switching time of the forcing, which is a
      border of the map over one period;
    - "corner collision": events of two guards coincide, where their surfaces intersect;
    - "surface grazing": the orbit touches a surface on which it does not slide.

    Attributes
    ----------
    value : str
        The type.
    surfaces : tuple of str
        The guards that meet at the point.
    modes : tuple of str
        Modes in which the orbit arrives and departs.
    state : State
        The state at the point.
    time : float
        Time since the start of the period.
    tangent, other, sliding : str
        Modes of the tangent field, of the other field, and of sliding; empty if there is none.
    rates : tuple of float
        Derivatives of the margin of the surface's guard, positive on the side of the tangent field,
        along the tangent and the other field.
    second, third : float
        Second and third derivative along the tangent field.
    tangency : str
        "visible" (second > 0), "invisible" (second < 0), "cubic" (second = 0); empty where the
        first derivative is not zero, as with a static friction above the dynamic friction.

    See Also
    --------
    SpecialPoint, GrazingType

    Examples
    --------
    >>> import mems_impact as mi
    >>> def flow(mode, t, y, p):
    ...     if mode.wall == 1:
    ...         return -1.0, 0.0
    ...     r = y.x**2 + y.y**2
    ...     return (p.mu - r) * y.x - y.y, y.x + (p.mu - r) * y.y
    >>> system = mi.System(
    ...     states=("x", "y"), flow=flow, parameters={"mu": 0.8}, initial={"x": 0.5},
    ...     parts=[mi.SwitchingSurface("wall", "x", level=1.0)],
    ... )
    >>> branch = mi.continue_solution(mi.find_orbit(system, transient=50), "mu", stop=1.2)
    >>> found = branch.special_points[0].type
    >>> found.label, found.tangent, found.tangency, round(found.second, 6)
    ('GS', 'below', 'visible', 1.0)
    """

    value: str
    surfaces: tuple[str, ...] = ()
    modes: tuple[str, str] = ("", "")
    state: State | None = None
    time: float = math.nan
    tangent: str = ""
    other: str = ""
    sliding: str = ""
    rates: tuple[float, float] = (math.nan, math.nan)
    second: float = math.nan
    third: float = math.nan
    tangency: str = ""

    def __new__(cls, value: str, *_: Any, **__: Any) -> Self:
        """Return the string."""
        return super().__new__(cls, value)

    @property
    def label(self) -> str:
        """The abbreviation in figures: GS, CS, SS, AS, CO, BC or SG."""
        return TYPE_LABELS[self.value]


def sliding_type(system: HybridSystem, special: OrbitEvent) -> SlidingType:
    """Return the type of a point at a discontinuity; see `SpecialPoint.type`."""
    event = discontinuity(special)
    names = system.modes
    begin, end = event.modes
    instant = HybridState(0, event.time, begin, event.state)
    location: dict[str, Any] = {
        "surfaces": tuple(system.automaton.guards[j].name for j in event.guards),
        "modes": (names[begin], names[end]),
        "state": system.state_space.state(instant),
        "time": float(system.units.out("time", event.time)),
    }
    tangency = event.tangency
    if tangency is None:
        return SlidingType(event.type, **location)
    time = system.units.factor("time")
    unit = system.units.margin_factor(system.automaton.guards[tangency.guard].name)
    first, other = (rate * unit / time for rate in tangency.rates)
    numbered = (tangency.tangent, tangency.other, tangency.sliding)
    tangent, across, sliding = (names[mode] if mode != NONE else "" for mode in numbered)
    return SlidingType(
        event.type,
        **location,
        tangent=tangent,
        other=across,
        sliding=sliding,
        rates=(first, other),
        second=tangency.second * unit / time**2,
        third=tangency.third * unit / time**3,
        tangency=tangency.kind,
    )
