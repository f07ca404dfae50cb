"""A relay with hysteresis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

from mems_impact.systems.components.base import CodeNames, GuardSpec, Limit, Part, Quantity

LOW, HIGH = 0, 1


@dataclass(frozen=True)
class Relay(Part):
    """A relay with hysteresis: high when its input rises to `upper`, low when it falls to `lower`.

    Between the thresholds the relay keeps its mode. The flow reads 0 or 1 as ``mode.name``. A run
    that starts between the thresholds starts low, unless ``State(mode="high")`` is given.

    Parameters
    ----------
    name : str
    input : str or callable
        A state, or ``input(t, y, p)``.
    lower, upper : float, str or callable
        Numbers, parameters or functions of ``p``, `lower` below `upper`.

    See Also
    --------
    SwitchingSurface, Part, System

    Notes
    -----
    Modes: low and high. Events: ``NAME rises`` and ``NAME falls``. A relay without hysteresis
    slides along its threshold: use a `SwitchingSurface`.

    Examples
    --------
    >>> import mems_impact as mi
    >>> def room(mode, t, y, p):
    ...     return (-y.T + (0.0 if mode.thermostat == 1 else p.power),)
    >>> heated = mi.System(
    ...     states=("T",), flow=room, parameters={"power": 2.0}, time_scale=1.0,
    ...     parts=[mi.Relay("thermostat", "T", lower=0.9, upper=1.1)],
    ... )
    >>> len(mi.simulate(heated, duration=2.0).events)
    6
    """

    input: str | Callable[..., float]
    lower: Quantity = field(kw_only=True)
    upper: Quantity = field(kw_only=True)

    modes: ClassVar[tuple[str, ...]] = ("low", "high")
    signs: ClassVar[tuple[int, ...]] = (0, 1)

    def terms(self, names: CodeNames) -> tuple[str, str, str]:
        """Return the input and the thresholds."""
        lower, upper = names.value("lower", self.lower), names.value("upper", self.upper)
        if callable(self.input):
            return names.call(self.input, "t, y, p"), lower, upper
        return f"y[{names.index('input', self.input)}]", lower, upper

    def limits(self) -> list[Limit]:
        """Return the limit of the upper threshold."""
        upper, lower = (f"{field} of {self.name!r}" for field in ("upper", "lower"))
        return [Limit(upper, self.upper, low=self.lower, of_low=lower)]

    def mode_conditions(self, names: CodeNames) -> list[str]:
        """Return the conditions of low and high."""
        signal, lower, upper = self.terms(names)
        return [
            f"{signal} <= {lower} or ({signal} < {upper} and {names.last} == {LOW})",
            f"{signal} >= {upper} or ({signal} > {lower} and {names.last} == {HIGH})",
        ]

    def guards(self, names: CodeNames) -> list[GuardSpec]:
        """Return both changes."""
        signal, lower, upper = self.terms(names)
        return [
            GuardSpec(
                name=f"{self.name} rises",
                modes=(LOW,),
                margin=f"{upper} - {signal}",
                leads=str(HIGH),
            ),
            GuardSpec(
                name=f"{self.name} falls",
                modes=(HIGH,),
                margin=f"{signal} - {lower}",
                leads=str(LOW),
            ),
        ]
