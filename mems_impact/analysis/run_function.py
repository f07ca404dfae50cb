"""Functions of runs as functions of parameters, with exact derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.analysis.run import Run
from mems_impact.analysis.run_derivatives import INITIAL, derivatives_of
from mems_impact.analysis.simulate import simulate
from mems_impact.errors import InvalidParameter
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.dispatch import takes_system
from mems_impact.systems.state import State


@dataclass(frozen=True)
class RunFunction:
    """A function of runs, as a function of parameters and initial states."""

    system: HybridSystem
    function: Callable[[Run], Any]
    parameters: Sequence[str]
    arguments: Mapping[str, Any]

    def run(self, values: Any) -> Run:
        """Return the run with these values."""
        numbers = np.atleast_1d(values).tolist()
        if len(numbers) != len(self.parameters):
            raise InvalidParameter(
                "values", values, f"one for each of {', '.join(self.parameters)}"
            )
        chosen = dict(zip(self.parameters, numbers, strict=True))
        inner = {name: value for name, value in chosen.items() if not name.startswith(INITIAL)}
        starts = {name.removeprefix(INITIAL): chosen[name] for name in chosen.keys() - inner.keys()}
        given = self.arguments.get("initial") or {}
        if isinstance(given, State):
            initial: Any = given.replace(**starts)
        else:
            initial = {**given, **starts} or None
        return simulate(self.system.changed(**inner), **{**self.arguments, "initial": initial})

    def value(self, values: Any) -> Floats:
        """Return the value, a number or an array."""
        return np.asarray(self.function(self.run(values)), dtype=float)

    def __call__(self, values: Any) -> tuple[Any, Floats]:
        """Return the value and its derivatives."""
        run = self.run(values)
        value = np.asarray(self.function(run), dtype=float)
        jacobian = derivatives_of(run, self.parameters).jacobian(self.function)
        return (float(value), jacobian[0]) if value.ndim == 0 else (value, jacobian)


@takes_system(start="initial", recurrent=False)
def value_and_jacobian(
    system: HybridSystem,
    /,
    function: Callable[[Run], Any],
    parameters: Sequence[str],
    **arguments: Any,
) -> Callable[[Any], tuple[Any, Floats]]:
    """Return a function of parameters that simulates a system, with exact derivatives.

    Parameters
    ----------
    system : System, or Actuator and Drive
    function : callable
        ``function(run)``, one number or m numbers, such as differences from a record.
    parameters : sequence of str
        Parameters of the system, and initial states: ``"x0.x"`` is the initial value of x.
    **arguments
        Arguments of `simulate`.

    Returns
    -------
    callable
        Of s values of the parameters; it returns the value of `function` and its derivatives,
        shape (s,), or (m, s) for m numbers.

    See Also
    --------
    RunDerivatives, jax_function, simulate

    Examples
    --------
    The speed at which a ball must start to reach x = 3 m after 0.5 s:

    >>> import mems_impact as mi
    >>> from scipy import optimize
    >>> ball = mi.System(
    ...     states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -p.g), parameters={"g": 9.8},
    ... )
    >>> miss = mi.value_and_jacobian(
    ...     ball, lambda run: (run.final.x - 3.0) ** 2, ["x0.v"], duration=0.5
    ... )
    >>> found = optimize.minimize(miss, [1.0], jac=True)
    >>> found.x.round(6).tolist()
    [8.45]
    """
    return RunFunction(system, function, tuple(parameters), arguments)
