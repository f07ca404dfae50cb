"""A switching surface on which the flow is discontinuous, with sliding."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, ClassVar

from mems_impact.hybrid.automaton import GENERATED
from mems_impact.hybrid.definition import RATE_STEP
from mems_impact.systems.components.base import CodeNames, Constraint, GuardSpec, Part, Quantity

ABOVE, BELOW, SLIDING = 0, 1, 2


@dataclass(frozen=True)
class SwitchingSurface(Part):
    """A switching surface ``h = 0`` with sliding, by Filippov's convex method.

    The flow reads ``mode.name`` as 1 where ``h > 0`` and as -1 where ``h < 0``. A state that
    reaches the surface crosses it if the flow on the other side leads away. If both flows lead
    towards the surface, the state slides with the flow ``(f+ L- - f- L+)/(L- - L+)``, where L+ and
    L- are the derivatives of h along both flows, until L+ or L- changes its sign.

    Parameters
    ----------
    name : str
    h : str, mapping of str to float or str, or callable
        A state; a linear combination of states with numbers or parameters as coefficients, ``{"x":
        "c", "v": 1.0}`` for c x + v; or ``h(t, y, p)``.
    level : float, str or callable, optional
        Value subtracted from h: a number (0 by default), a parameter or a function of ``p``.

    See Also
    --------
    Relay, Friction, Part, System

    Notes
    -----
    Modes: above, below and sliding. Events: ``NAME`` where the surface is reached, ``NAME leaves
    up`` and ``NAME leaves down``. Where several surfaces meet and no motion leads away, the state
    slides on their intersection, with the velocity of the convex combinations of all flows around
    the intersection that keep every h at zero. If these combinations have several velocities, or if
    several motions lead away, the run ends with an error that gives two velocities or motions; a
    start there is a `StartWarning`.

    References
    ----------
    .. [1] A. F. Filippov, "Differential Equations with Discontinuous Righthand Sides", Kluwer,
       1988.

    Examples
    --------
    >>> import mems_impact as mi
    >>> def control(mode, t, y, p):
    ...     return y.v, -p.u * mode.line
    >>> braked = mi.System(
    ...     states=("x", "v"), flow=control, parameters={"u": 1.0, "c": 1.0}, initial={"x": 2.0},
    ...     parts=[mi.SwitchingSurface("line", {"x": "c", "v": 1.0})],
    ... )
    >>> mi.simulate(braked, duration=10.0).final.mode
    'sliding'
    """

    h: str | Mapping[str, float | str] | tuple[tuple[str, float | str], ...] | Callable[..., float]
    level: Quantity = field(default=0.0, kw_only=True)

    modes: ClassVar[tuple[str, ...]] = ("above", "below", "sliding")
    signs: ClassVar[tuple[int, ...]] = (1, -1, 0)

    def __post_init__(self) -> None:
        if isinstance(self.h, Mapping):
            object.__setattr__(self, "h", tuple(self.h.items()))  # hashable

    def height(self, names: CodeNames) -> str:
        """Return h as an expression."""
        level = names.value("level", self.level)
        if callable(self.h):
            return f"({names.call(self.h, 't, y, p')} - {level})"
        return f"({self.along(names, 'y')} - {level})"

    def along(self, names: CodeNames, slopes: str) -> str:
        """Return the derivative of h for derivatives ``slopes[j]``, as an expression."""
        if callable(self.h):
            return self.derivative(names, [f"{slopes}[{j}]" for j in range(len(names.states))])
        terms = self.terms(names)
        return " + ".join(f"{factor} * {slopes}[{index}]" for index, factor in terms)

    def terms(self, names: CodeNames) -> list[tuple[int, str]]:
        """Return the components of the state in a linear h, each with its coefficient."""
        terms: Any = ((self.h, 1.0),) if isinstance(self.h, str) else self.h
        return [
            (names.index("h", state), names.value(f"factor of {state}", factor))
            for state, factor in terms
        ]

    def derivative(self, names: CodeNames, slopes: Sequence[str], time: str = "1.0") -> str:
        """Return the derivative of a callable h for these derivatives of states and time."""
        state = ", ".join(f"with_rate(y[{j}], {slope})" for j, slope in enumerate(slopes))
        step = f"{RATE_STEP!r} * ({names.time_scale})"
        moving = f"with_rate(t, {time}, y[0]), State({state})"
        return f"along({names.name_of(_with_mode(self.h))}, {step}, 0, {moving}, p)[1]"

    def constraints(self, names: CodeNames) -> list[Constraint]:
        """Return the constraint h = 0 of sliding."""
        height = self.height(names)
        if not callable(self.h):
            slopes: dict[int, str] = {}
            for index, factor in self.terms(names):
                slopes[index] = f"{slopes[index]} + {factor}" if index in slopes else factor
            return [Constraint(mode=SLIDING, value=height, slopes=slopes)]
        n = len(names.states)
        units = (["1.0" if i == j else "0.0" for i in range(n)] for j in range(n))
        slopes = {j: self.derivative(names, unit, "0.0") for j, unit in enumerate(units)}
        return [Constraint(mode=SLIDING, value=height, slopes=slopes, linear=False)]

    def mode_conditions(self, names: CodeNames) -> list[str]:
        """Return the conditions of above, below and sliding."""
        h, along = self.height(names), f"({self.along(names, 'x')})"
        # If no event has changed the state, it stays on its side despite rounding of h.
        stays = f"{names.last} == {{}} if jumped == 0 else {h} {{}} 0.0"
        return [
            f"{along} >= 0.0 if {names.on} else ({stays.format(ABOVE, '>')})",
            f"{along} <= 0.0 if {names.on} else ({stays.format(BELOW, '<')})",
            f"{names.on} and {names.room} > 0.0",
        ]

    def guards(self, names: CodeNames) -> list[GuardSpec]:
        """Return the guards of reaching the surface and of leaving it to either side."""
        sign = f"(1.0 if {names.mode} == {ABOVE} else -1.0)"
        return [
            GuardSpec(
                name=self.name, modes=(ABOVE, BELOW), margin=f"{sign} * {self.height(names)}"
            ),
            *(
                GuardSpec(
                    name=f"{self.name} leaves {way}",
                    modes=(SLIDING,),
                    margin=f"exit_room(mode, {names.number}, {side}, t, y, p)",
                    leads=str(side),
                )
                for way, side in (("up", ABOVE), ("down", BELOW))
            ),
        ]


@cache
def _with_mode(h: Callable[..., float]) -> Callable[..., float]:
    """Return h as a function of mode, time, state and parameters."""
    space: dict[str, Any] = {"h": h, "SOURCE": "def height(mode, t, y, p):\n    return h(t, y, p)"}
    exec(compile(space["SOURCE"], GENERATED, "exec"), space)
    return space["height"]
