"""A limit of the rate of a state, such as the largest current of a source."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from mems_impact.systems.components.base import CodeNames, GuardSpec, Limit, Part, Quantity

WITHIN, LARGEST, SMALLEST = 0, 1, 2


@dataclass(frozen=True)
class RateLimit(Part):
    """A limit of the rate of a state: a saturation, such as a slew rate or a current limit.

    The state changes at the rate of the flow, at most at the limit in either direction.

    Parameters
    ----------
    name : str
    state : str
        The state.
    limit : float, str or callable
        The largest absolute rate, > 0: a number, a parameter or a function of ``p``.

    See Also
    --------
    Relay, SwitchingSurface, Part, System

    Notes
    -----
    Modes: within, largest and smallest, which the flow reads as 0, 1 and -1. Event: ``NAME``, where
    the rate of the flow crosses the limit.

    Examples
    --------
    >>> import mems_impact as mi
    >>> def charging(mode, t, y, p):
    ...     return (p.v - y.q,)
    >>> source = mi.System(
    ...     states=("q",), flow=charging, parameters={"v": 3.0}, time_scale=1.0,
    ...     parts=[mi.RateLimit("source", "q", limit=1.0)],
    ... )
    >>> f"{mi.simulate(source, duration=3.0).events['t'].iloc[0]:.9f}"
    '2.000000000'
    """

    state: str
    limit: Quantity = field(kw_only=True)

    modes: ClassVar[tuple[str, ...]] = ("within", "largest", "smallest")
    signs: ClassVar[tuple[int, ...]] = (0, 1, -1)

    def rates(self, names: CodeNames) -> dict[int, dict[int, str]]:
        """Return the rates in place of those of the flow, by mode and component."""
        index, limit = names.index("state", self.state), names.value("limit", self.limit)
        return {LARGEST: {index: limit}, SMALLEST: {index: f"-{limit}"}}

    def limits(self) -> list[Limit]:
        """Return the limit of the limit."""
        return [Limit(f"limit of {self.name!r}", self.limit, exclusive=True)]

    def mode_conditions(self, names: CodeNames) -> list[str]:
        """Return the conditions of a rate within the limits, above and below them."""
        rate, limit = self.rate(names), names.value("limit", self.limit)
        return [f"abs({rate}) <= {limit}", f"{rate} >= {limit}", f"{rate} <= -{limit}"]

    def rate(self, names: CodeNames) -> str:
        """Return the rate of the flow, without the limit."""
        return f"{names.unlimited}[{names.index('state', self.state)}]"

    def guards(self, names: CodeNames) -> list[GuardSpec]:
        """Return the guard of crossing the limit."""
        rate, limit, mode = self.rate(names), names.value("limit", self.limit), names.mode
        beyond = f"({rate} if {mode} == {LARGEST} else -{rate}) - {limit}"
        reached = f"({LARGEST} if {rate} > 0.0 else {SMALLEST})"
        return [
            GuardSpec(
                name=self.name,
                modes=(WITHIN, LARGEST, SMALLEST),
                margin=f"{limit} - abs({rate}) if {mode} == {WITHIN} else {beyond}",
                leads=f"{reached} if {mode} == {WITHIN} else {WITHIN}",
            )
        ]
