"""Functions that accept a system, or an actuator and a drive."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import fields
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar, cast, overload

from mems_impact._util.warning_scopes import warned_once
from mems_impact.errors import InvalidParameter, RunError
from mems_impact.integrators.options import Options
from mems_impact.systems.base import HybridSystem

P = ParamSpec("P")
R = TypeVar("R")
Result = TypeVar("Result", covariant=True)


class Drivable(Protocol):
    """A model that makes a system from a drive."""

    def under(self, drive: Any) -> HybridSystem:
        """Return the system."""


class Done(Protocol):
    """A run or an orbit, which provides its system and its last state."""

    @property
    def system(self) -> HybridSystem:
        """System of the object."""


class Verb(Protocol[P, Result]):
    """A function whose first argument is a system, or an actuator and a drive."""

    __name__: str

    @overload
    def __call__(
        self, system: HybridSystem | Done, /, *rest: P.args, **named: P.kwargs
    ) -> Result: ...

    @overload
    def __call__(
        self, model: Drivable, drive: Any, /, *rest: P.args, **named: P.kwargs
    ) -> Result: ...

    @overload
    def __call__(self, model: Drivable, /, *, drive: Any, **named: Any) -> Result: ...

    @overload
    def __call__(self, /, **named: Any) -> Result: ...


def takes_system(
    start: str, *, recurrent: bool = True
) -> Callable[[Callable[Concatenate[HybridSystem, P], R]], Verb[P, R]]:
    """Decorate a function of a system to accept an actuator and a drive, a run or an orbit.

    ``simulate(actuator, drive, …)`` is equivalent to ``simulate(actuator.under(drive), …)``, for
    any model with a method ``under``. A run or an orbit provides its system and, for the argument
    `start`, its last state. A `recurrent` verb needs a system whose motions may be periodic.
    """

    def decorated(verb: Callable[Concatenate[HybridSystem, P], R]) -> Verb[P, R]:
        first, *names = parameters = inspect.signature(verb).parameters
        takes_any = any(each.kind is each.VAR_KEYWORD for each in parameters.values())

        @functools.wraps(verb)
        def called(*arguments: Any, **keywords: Any) -> Any:
            rest = list(arguments)
            typed = "actuator" if "actuator" in keywords else first
            model = rest.pop(0) if rest else keywords.pop(typed, None)
            if isinstance(getattr(model, "system", None), HybridSystem):
                current = getattr(model, "final", getattr(model, "state", None))
                if current is None:
                    allowed = "a System, an Actuator and a Drive, a Run or an Orbit"
                    raise InvalidParameter(typed, model, allowed)
                system, keywords = model.system.without_until, {start: current, **keywords}
            elif isinstance(model, HybridSystem):
                system = model
            elif hasattr(model, "under"):
                drive = (
                    keywords.pop("drive") if "drive" in keywords else rest.pop(0) if rest else None
                )
                system = model.under(drive)
            else:
                allowed = "a System, or an Actuator (see load_actuator) and a Drive"
                raise InvalidParameter(typed, model, allowed)
            for name in () if takes_any else (each for each in keywords if each not in names):
                problem = f"{verb.__name__}() got an unexpected keyword argument {name!r}"
                if "options" in names and name in {each.name for each in fields(Options)}:
                    raise TypeError(f"{problem}: give options=Options({name}=…)")
                raise TypeError(f"{problem}; its arguments are {', '.join([first, *names])}")
            if recurrent:
                system.checks.recurrence()
            try:
                with warned_once():
                    return verb(system, *rest, **keywords)
            except RunError as error:
                error.convert(system.units, forced=system.forced)
                raise

        return cast("Verb[P, R]", called)

    return decorated
