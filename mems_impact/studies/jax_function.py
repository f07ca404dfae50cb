"""Functions of runs for JAX."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np

from mems_impact.analysis.run import Run
from mems_impact.analysis.run_derivatives import derivatives_of
from mems_impact.analysis.run_function import RunFunction
from mems_impact.analysis.simulate import simulate
from mems_impact.errors import InvalidParameter
from mems_impact.studies.engine.executors import cores, stoppable_threads
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.dispatch import takes_system
from mems_impact.systems.state import whole


@takes_system(start="initial", recurrent=False)
def jax_function(
    system: HybridSystem,
    /,
    function: Callable[[Run], Any],
    parameters: Sequence[str],
    *,
    workers: int | None = None,
    **arguments: Any,
) -> Callable[[Any], Any]:
    """Return a function for JAX that simulates a system, with exact first derivatives.

    It works under ``jit``, ``grad``, ``jacfwd`` and ``jacrev``. Under ``vmap`` the values of a
    batch are simulated side by side.

    Parameters
    ----------
    system : System, or Actuator and Drive
    function : callable
        ``function(run)``, one number or m numbers, always as many.
    parameters : sequence of str
        Parameters of the system, and initial states: ``"x0.x"`` is the initial value of x.
    workers : int, optional
        Number of threads under ``vmap``; all cores by default.
    **arguments
        Arguments of `simulate`.

    Returns
    -------
    callable
        Of an array of s values of the parameters, shape (s,); of the shape of `function`. Runs
        have 64 bits; set ``jax_enable_x64`` of JAX to keep them in values and derivatives.

    Raises
    ------
    InvalidParameter
        If JAX is missing, or an argument is out of range. Later errors are those of JAX, with the
        error of the run in their text.

    See Also
    --------
    value_and_jacobian, RunDerivatives

    Notes
    -----
    Second derivatives do not exist: JAX raises an error.

    Examples
    --------
    >>> import jax
    >>> import mems_impact as mi
    >>> jax.config.update("jax_enable_x64", True)
    >>> ball = mi.System(
    ...     states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -p.g),
    ...     parameters={"g": 9.8, "e": 0.8}, initial={"x": 1.0},
    ...     parts=[mi.Stopper("floor", "x", "v", lower=0.0, restitution="e")],
    ... )
    >>> energy = mi.jax_function(
    ...     ball, lambda run: 9.8 * run.final.x + run.final.v**2 / 2, ["e"], duration=1.0
    ... )
    >>> jax.grad(energy)(jax.numpy.array([0.8])).round(6).tolist()  # 2 g e, after one bounce
    [15.68]
    """
    if find_spec("jax") is None:
        problem = "needs JAX, which is not installed: pip install 'mems-impact[jax]'"
        raise InvalidParameter("jax_function", None, "", problem=problem)
    import jax

    names = tuple(parameters)
    simulated = RunFunction(system, function, names, arguments)
    threads = cores() if workers is None else whole("workers", workers, 1)
    run = simulate(system, **arguments)
    derivatives_of(run, names)  # checks their names
    shape = np.shape(function(run))

    def batch(evaluate: Callable[[Any], Any], values: Any) -> list[Any]:
        rows = np.asarray(values, dtype=float).reshape(-1, len(names))
        with stoppable_threads(min(threads, len(rows))) as (executor, _):
            return list(executor.map(evaluate, rows))

    def value(x: Any) -> Any:
        return np.reshape(batch(simulated.value, x), (*np.shape(x)[:-1], *shape))

    def both(x: Any) -> Any:
        values, jacobians = zip(*batch(simulated, x), strict=True)
        lead = np.shape(x)[:-1]
        return np.reshape(values, (*lead, *shape)), np.reshape(
            jacobians, (*lead, *shape, len(names))
        )

    @jax.custom_jvp
    def called(x: Any) -> Any:
        if x.shape != (len(names),):
            raise InvalidParameter("x", x.shape, f"of shape ({len(names)},): {', '.join(names)}")
        result = jax.ShapeDtypeStruct(shape, x.dtype)
        return jax.pure_callback(value, result, x, vmap_method="broadcast_all")

    @called.defjvp
    def _(primals: Any, tangents: Any) -> Any:
        (x,), (direction,) = primals, tangents
        results = (
            jax.ShapeDtypeStruct(shape, x.dtype),
            jax.ShapeDtypeStruct((*shape, len(names)), x.dtype),
        )
        result, jacobian = jax.pure_callback(both, results, x, vmap_method="broadcast_all")
        return result, jacobian @ direction

    return lambda x: called(jax.numpy.asarray(x, dtype=float))
