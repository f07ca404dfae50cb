from typing import Any, ParamSpec, Protocol, TypeVar, overload

from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.results import ActuatorOrbit, ActuatorRun
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.analysis.orbit import Orbit
from mems_impact.analysis.orbit import find_orbit as find_orbit_of_system
from mems_impact.analysis.run import Run
from mems_impact.analysis.simulate import simulate as simulate_system
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.dispatch import Verb

__all__ = ["find_orbit", "simulate"]

P = ParamSpec("P")
R = TypeVar("R")
S = TypeVar("S")
Result = TypeVar("Result", covariant=True)
Special = TypeVar("Special", covariant=True)
OfActuator = ActuatorSystem[Any] | ActuatorRun[Any] | ActuatorOrbit[Any]

class ActuatorVerb(Protocol[P, Result, Special]):
    __name__: str

    @overload
    def __call__(self, system: OfActuator, /, *rest: P.args, **named: P.kwargs) -> Special: ...
    @overload
    def __call__(
        self, system: HybridSystem | Run | Orbit, /, *rest: P.args, **named: P.kwargs
    ) -> Result: ...
    @overload
    def __call__(
        self, actuator: Actuator, drive: Drive, /, *rest: P.args, **named: P.kwargs
    ) -> Special: ...
    @overload
    def __call__(self, actuator: Actuator, /, *, drive: Drive, **named: Any) -> Special: ...
    @overload
    def __call__(self, *, actuator: Actuator, drive: Drive, **named: Any) -> Special: ...
    @overload
    def __call__(self, *, system: HybridSystem, **named: Any) -> Result: ...

def _with_overloads(verb: Verb[P, R], _special: type[S]) -> ActuatorVerb[P, R, S]: ...

simulate = _with_overloads(simulate_system, ActuatorRun[Actuator])
find_orbit = _with_overloads(find_orbit_of_system, ActuatorOrbit[Actuator])
